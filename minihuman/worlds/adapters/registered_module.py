"""The modules of environments, looked up in Gymnasium's registry without importing them."""

import gymnasium


def find_registered_module(world_id: str) -> str:
    """Return the module of an environment's entry point, or else the module in its id; "" if there is neither."""
    module, _, name = world_id.rpartition(":")
    spec = gymnasium.registry.get(name)
    if spec is None:
        return module
    entry = spec.entry_point
    if isinstance(entry, str):
        return entry.partition(":")[0]
    return str(getattr(entry, "__module__", module))
