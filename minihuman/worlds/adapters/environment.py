"""Construction of the environment of a world, and checks that it states what a world must know."""

import re
from collections.abc import Collection, Mapping
from typing import Any

import gymnasium

from minihuman.errors import WorldError
from minihuman.worlds.adapters.foreign_code import describe_error
from minihuman.worlds.adapters.returned_values import describe_value
from minihuman.worlds.adapters.seat import SeatEnv, make_seat
from minihuman.worlds.contract import NativeWorld
from minihuman.worlds.hashing import resolve_files

_MISSING_ARGUMENTS = re.compile(
    r"missing \d+ required (?:positional|keyword-only) arguments?: (.+?)(?: was raised from|$)"
)

_UNEXPECTED_ARGUMENT = re.compile(r"unexpected keyword argument '(\w+)'")


def has_own_reward_rule(native: Any) -> bool:
    """Return whether a native world defines the reward for an episode's end by a method ``reward_and_done``."""
    if isinstance(native, SeatEnv):
        inner = native.team
    else:
        inner = vars(native).get("grid", native)  # a grid that is seen from inside has its world as `grid`
    return isinstance(native, NativeWorld) and hasattr(inner, "reward_and_done")


def is_built_in(env: gymnasium.Env[Any, Any]) -> bool:
    """Return whether a world and all of its wrappers are part of this package or are Gymnasium's wrappers."""
    while isinstance(env, gymnasium.Wrapper):
        if not type(env).__module__.startswith(("minihuman.", "gymnasium.wrappers.")):
            return False
        env = env.env
    team = getattr(env, "team", env)  # of a seat
    return type(env).__module__.startswith("minihuman.") and type(team).__module__.startswith("minihuman.")


def make_environment(world_id: str, options: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    """Make an environment that can draw pictures, from its id.

    Raises:
        WorldError: if the environment cannot be made, or has no render mode for pictures.
    """
    try:
        env: gymnasium.Env[Any, Any] | None = make_seat(world_id, options)
        if env is None:
            files = resolve_files(options)
            env = gymnasium.make(world_id, render_mode="rgb_array", disable_env_checker=True, **files)
    except ModuleNotFoundError as error:
        raise WorldError(f"{world_id}: {_explain_missing_module(error, world_id)}") from error
    except gymnasium.error.InvalidMetadata as error:
        raise WorldError(f"{world_id}: its metadata is no dict; set it to {{'render_modes': ['rgb_array']}}") from error
    except gymnasium.error.Error as error:
        raise WorldError(f"{world_id}: {error}") from error
    except WorldError as error:
        raise WorldError(f"{world_id}: {error}") from error
    except TypeError as error:
        raise WorldError(f"{world_id}: {_explain_arguments(error, options)}") from error
    except Exception as error:  # a constructor may raise whatever it likes of an id or an option
        with_options = f" with the options {options!r}" if options else ""
        raise WorldError(
            f"{world_id}: it cannot be created{with_options}: making it {describe_error(error)}"
        ) from error
    if "rgb_array" not in _render_modes(world_id, env):
        env.close()
        raise WorldError(f"{world_id} has no render mode 'rgb_array', which a session needs to show pictures; add it")
    return env


def _explain_missing_module(error: ModuleNotFoundError, world_id: str) -> str:
    """Return an error text that says what to install: the package of the world, or a module that its code imports."""
    provider = world_id.rpartition(":")[0].partition(".")[0]
    missing = (error.name or provider).partition(".")[0]
    if missing != provider:
        return f"its code needs the module {error.name!r}, which is not installed; install the package that has it"
    return (
        f"{error}; install the package that provides this world, or trust the protocol's folder that has it: "
        "minihuman check PROTOCOL"
    )


def _explain_arguments(error: TypeError, options: Mapping[str, Any]) -> str:
    """Return an error text for a TypeError of a world's constructor, which usually concerns one of its arguments."""
    missing = _MISSING_ARGUMENTS.search(str(error))
    if missing:
        return f"its constructor needs {missing[1]}; give it in the block, as options = {{ NAME = VALUE }}"
    unexpected = _UNEXPECTED_ARGUMENT.search(str(error))
    if unexpected and unexpected[1] == "render_mode":
        return "its constructor takes no render_mode; write def __init__(self, render_mode=None) and keep it"
    if unexpected and unexpected[1] not in options:
        return f"its constructor takes no {unexpected[1]}, which its registration gives; correct one of the two"
    if options:
        return f"the options {options!r} are invalid: {error}"
    return f"it cannot be created: making it {describe_error(error)}"


def _render_modes(world_id: str, env: gymnasium.Env[Any, Any]) -> Collection[Any]:
    """Return the render modes in an environment's metadata.

    Raises:
        WorldError: if the metadata lists no render modes.
    """
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
    """Check that an environment states one of its spaces.

    Raises:
        WorldError: if the attribute ``name`` is not a space of Gymnasium.
    """
    space = getattr(env, name, None)
    if not isinstance(space, gymnasium.Space):
        raise WorldError(
            f"{world_id}: its {name} is {describe_value(space)}; set it to a space of Gymnasium's in __init__"
        )
