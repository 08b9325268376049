"""One dataset a world: what has another observation cannot lie in the same one."""

import copy
import hashlib
import json
import re
from typing import Any

import gymnasium

from minihuman.data.chosen import Chosen


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


def env_spec(chosen: Chosen) -> gymnasium.envs.registration.EnvSpec:
    """The Gymnasium spec of an episode's world, options included; the module that registers it is imported by then."""
    spec = copy.deepcopy(gymnasium.spec(chosen.episode.plan.world.rsplit(":", 1)[-1]))
    kwargs: dict[str, Any] = {**spec.kwargs, **chosen.episode.plan.options}
    spec.kwargs = kwargs
    return spec
