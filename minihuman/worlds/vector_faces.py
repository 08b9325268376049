"""Vector environments of the worlds that have no batch class: the worlds are stepped one after the other."""

from functools import partial
from typing import Any

from gymnasium.envs.registration import load_env_creator
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from minihuman.errors import WorldError


def step_in_turn(
    entry_point: str,
    *,
    num_envs: int = 1,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    **options: Any,
) -> SyncVectorEnv:
    """Return a vector environment that steps worlds with the same options one after the other.

    Args:
        entry_point: the module and function that makes one world.
        num_envs: the number of worlds.
        autoreset_mode: Gymnasium's name for the behaviour after an episode's end.
        options: the options of each world.

    Raises:
        WorldError: if the number is not 1 or more.
    """
    if num_envs < 1:
        raise WorldError(f"num_envs is {num_envs!r}; use 1 or more")
    make: Any = load_env_creator(entry_point)
    return SyncVectorEnv([partial(make, **options)] * num_envs, autoreset_mode=AutoresetMode(autoreset_mode))


_ENTRY_POINTS = "minihuman.worlds.inside.entry_points"
make_go_to_obj_batch = partial(step_in_turn, f"{_ENTRY_POINTS}:make_go_to_obj_world")
make_level_batch = partial(step_in_turn, f"{_ENTRY_POINTS}:make_drawn_level")
