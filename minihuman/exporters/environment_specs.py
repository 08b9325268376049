"""The Gymnasium specification of an episode's world, in a form that a file can hold and another machine can use."""

import copy
import sys
from operator import attrgetter
from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec

from minihuman.dataset.included_episodes import IncludedEpisode
from minihuman.exporters.study_metadata import get_step_limit
from minihuman.worlds.hashing import resolve_files


def build_environment_spec(chosen: IncludedEpisode) -> EnvSpec | None:
    """Return the Gymnasium specification of an episode's world, with options and the protocol's step limit, for a file.

    The module that registers the world must have been imported. Return None if it cannot be created by name elsewhere:
    its class is not importable, or an option is not a plain value.
    """
    spec = copy.deepcopy(gymnasium.spec(chosen.episode.plan.world.rsplit(":", 1)[-1]))
    kwargs: dict[str, Any] = {**spec.kwargs, **resolve_files(chosen.episode.plan.options)}
    spec.kwargs = kwargs
    limit = get_step_limit(chosen)
    if spec.max_episode_steps is None:
        spec.max_episode_steps = limit
    else:
        spec.max_episode_steps = min(limit, spec.max_episode_steps)
    if not isinstance(spec.entry_point, str):
        spec.entry_point = _importable(spec.entry_point)
    try:
        if spec.entry_point:
            return EnvSpec.from_json(spec.to_json())
        return None
    except (TypeError, ValueError):
        return None


def _importable(made_by: Any) -> str | None:
    """Return the import path "module:name" of a class or function; None if it cannot be imported."""
    module = getattr(made_by, "__module__", "")
    name = getattr(made_by, "__qualname__", "")
    if module in sys.modules and name.isidentifier():
        importable = attrgetter(name)(sys.modules[module])
    else:
        importable = None
    if importable is made_by and module != "__main__":
        return f"{module}:{name}"
    return None


env_spec = build_environment_spec  # its earlier name
