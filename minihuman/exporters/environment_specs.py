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


def build_environment_spec(included: IncludedEpisode) -> EnvSpec | None:
    """Return the Gymnasium specification of an episode's world, in the form in which it would be read from a file.

    It has the world's options and the protocol's step limit. The module that registers the world must have been
    imported. Return None if another machine could not create the world from it: its class is not importable, or an
    option is not a plain value.
    """
    spec = copy.deepcopy(gymnasium.spec(included.episode.plan.world.rsplit(":", 1)[-1]))
    kwargs: dict[str, Any] = {**spec.kwargs, **resolve_files(included.episode.plan.options)}
    spec.kwargs = kwargs
    limit = get_step_limit(included)
    if spec.max_episode_steps is None:
        spec.max_episode_steps = limit
    else:
        spec.max_episode_steps = min(limit, spec.max_episode_steps)
    if not isinstance(spec.entry_point, str):
        spec.entry_point = _find_import_path(spec.entry_point)
    try:
        if spec.entry_point:
            return EnvSpec.from_json(spec.to_json())
        return None
    except (TypeError, ValueError):
        return None


def _find_import_path(creator: Any) -> str | None:
    """Return the import path "module:name" of a class or function; None if it cannot be imported."""
    module = getattr(creator, "__module__", "")
    name = getattr(creator, "__qualname__", "")
    if module in sys.modules and name.isidentifier():
        imported = attrgetter(name)(sys.modules[module])
    else:
        imported = None
    if imported is creator and module != "__main__":
        return f"{module}:{name}"
    return None


env_spec = build_environment_spec  # its earlier name
