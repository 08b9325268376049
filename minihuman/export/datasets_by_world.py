"""One dataset a world: what has another observation cannot lie in the same one."""

import copy
import hashlib
import json
import re
import sys
from operator import attrgetter
from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec

from minihuman.data.chosen import Chosen
from minihuman.export.asked import most_steps_of


def dataset_name(chosen: Chosen) -> str:
    """A folder name for the world an episode was played in: "minigrid-fourrooms-v0", other options another name."""
    plan = chosen.episode.plan
    name = re.sub(r"[^a-z0-9]+", "-", plan.world.rsplit("/", 1)[-1].rsplit(":", 1)[-1].lower()).strip("-")
    if not plan.options:
        return name
    options = json.dumps(plan.options, sort_keys=True, default=str)
    stem, _, version = name.rpartition("-v")
    mark = hashlib.sha256(options.encode()).hexdigest()[:6]
    return f"{stem}-{mark}-v{version}" if stem else f"{name}-{mark}"


def env_spec(chosen: Chosen) -> EnvSpec | None:
    """The Gymnasium spec of an episode's world, options and the protocol's step limit included, as a file can hold it.

    The module that registers the world is imported by then. None where the world cannot be made by name elsewhere: its
    class has no module of its own, or an option is no plain value.
    """
    spec = copy.deepcopy(gymnasium.spec(chosen.episode.plan.world.rsplit(":", 1)[-1]))
    kwargs: dict[str, Any] = {**spec.kwargs, **chosen.episode.plan.options}
    spec.kwargs = kwargs
    limit = most_steps_of(chosen)
    spec.max_episode_steps = limit if spec.max_episode_steps is None else min(limit, spec.max_episode_steps)
    if not isinstance(spec.entry_point, str):
        spec.entry_point = _importable(spec.entry_point)
    try:
        return EnvSpec.from_json(spec.to_json()) if spec.entry_point else None
    except (TypeError, ValueError):
        return None


def _importable(made_by: Any) -> str | None:
    """Where a class or function can be imported from, "module:name"; None if nowhere."""
    module, name = getattr(made_by, "__module__", ""), getattr(made_by, "__qualname__", "")
    found = attrgetter(name)(sys.modules[module]) if module in sys.modules and name.isidentifier() else None
    return f"{module}:{name}" if found is made_by and module != "__main__" else None
