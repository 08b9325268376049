"""Makes the environment behind a world, and checks that it says what a world has to know."""

from collections.abc import Collection, Mapping
from typing import Any

import gymnasium

from minihuman.errors import WorldError
from minihuman.worlds.adapters.returned_values import describe_value
from minihuman.worlds.adapters.seat import SeatEnv, make_seat
from minihuman.worlds.contract import NativeWorld
from minihuman.worlds.hashing import resolve_files


def has_own_rule(native: Any) -> bool:
    """Return whether the author says, by the ``reward_and_done`` of our classes, which end earns a reward."""
    if isinstance(native, SeatEnv):
        inner = native.team
    else:
        inner = vars(native).get("grid", native)  # of a grid that is seen from inside
    return isinstance(native, NativeWorld) and hasattr(inner, "reward_and_done")


def is_built_in(env: gymnasium.Env[Any, Any]) -> bool:
    """Tell whether a world and all wrappers around it are this package's own, or Gymnasium's wrappers."""
    while isinstance(env, gymnasium.Wrapper):
        if not type(env).__module__.startswith(("minihuman.", "gymnasium.wrappers.")):
            return False
        env = env.env
    team = getattr(env, "team", env)  # of a seat
    return type(env).__module__.startswith("minihuman.") and type(team).__module__.startswith("minihuman.")


def make_environment(world_id: str, options: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    """Make the environment of a world: a seat of a team world, or what Gymnasium makes of the id.

    Raises:
        WorldError: if it cannot be made, or does not render pictures.
    """
    try:
        seat = make_seat(world_id, options)
        env = (
            seat
            if seat is not None
            else gymnasium.make(world_id, render_mode="rgb_array", disable_env_checker=True, **resolve_files(options))
        )
    except ModuleNotFoundError as error:
        raise WorldError(
            f"{world_id}: {error}; install the package that provides this world, or trust the protocol's folder that "
            "has it: minihuman check PROTOCOL"
        ) from error
    except gymnasium.error.InvalidMetadata as error:
        raise WorldError(f"{world_id}: its metadata is no dict; set it to {{'render_modes': ['rgb_array']}}") from error
    except gymnasium.error.Error as error:
        raise WorldError(f"{world_id}: {error}") from error
    except WorldError as error:
        raise WorldError(f"{world_id}: {error}") from error
    except TypeError as error:
        if options:
            reason = f"the options {options!r} are invalid: {error}"
        else:
            reason = f"it cannot be created: {error}"
        raise WorldError(f"{world_id}: {reason}") from error
    except Exception as error:  # a constructor may raise whatever it likes of an id or an option
        raise WorldError(
            f"{world_id} cannot be created with the options {options!r} ({type(error).__name__}: {error})"
        ) from error
    if "rgb_array" not in _render_modes(world_id, env):
        env.close()
        raise WorldError(f"{world_id} has no render mode 'rgb_array', which a session needs to show pictures; add it")
    return env


def _render_modes(world_id: str, env: gymnasium.Env[Any, Any]) -> Collection[Any]:
    """Return the render modes that an environment states."""
    if isinstance(env.metadata, Mapping):
        modes = env.metadata.get("render_modes", ())
    else:
        modes = None
    if isinstance(modes, Collection):
        return modes
    raise WorldError(
        f"{world_id}: its metadata lists no render modes; write metadata = {{'render_modes': ['rgb_array']}}"
    )


def require_stated_space(world_id: str, env: gymnasium.Env[Any, Any], name: str) -> None:
    """Refuse an environment that does not say what it takes, or what it shows.

    Raises:
        WorldError: if the space of that name is none of Gymnasium's.
    """
    space = getattr(env, name, None)
    if not isinstance(space, gymnasium.Space):
        raise WorldError(
            f"{world_id}: its {name} is {describe_value(space)}; set it to a space of Gymnasium's in __init__"
        )
