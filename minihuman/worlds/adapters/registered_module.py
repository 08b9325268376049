"""Which module an environment is registered from, by Gymnasium's registry. Imports none of them."""

import gymnasium


def find_registered_module(world_id: str) -> str:
    """Return the module that has an environment: its entry point's, else the one that its id names; "" for neither."""
    module, _, name = world_id.rpartition(":")
    spec = gymnasium.registry.get(name)
    if spec is None:
        return module
    entry = spec.entry_point
    if isinstance(entry, str):
        return entry.partition(":")[0]
    return str(getattr(entry, "__module__", module))
