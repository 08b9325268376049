"""The state of a world's wrappers, which is saved, restored and hashed with the world's state."""

import copy
from collections import deque
from typing import Any

import gymnasium
import numpy as np
from gymnasium import wrappers

from minihuman.errors import WorldError
from minihuman.worlds.hashing import hash64

_HOUSEKEEPING = (
    *(wrappers.OrderEnforcing, wrappers.PassiveEnvChecker, wrappers.TimeLimit, wrappers.RecordEpisodeStatistics),
    *(wrappers.RecordVideo, wrappers.HumanRendering, wrappers.RenderCollection),
)
# attributes that Gymnasium sets on every wrapper
_NOT_STATE = frozenset(
    {"env", "_action_space", "_observation_space", "_metadata", "_cached_spec", "_saved_kwargs", "spec"}
    | {"action_space", "observation_space", "metadata"}
)
_ABSENT = object()


class WrapperState:
    """The state of the wrappers around a world, from the outermost in, and whether they redraw the picture.

    An episode begins with the wrappers in their initial state, so that nothing leaks from one episode to the next. What
    they change during an episode is state: numbers, texts, arrays, random streams, and tuples, lists, dicts, sets and
    deques of these.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self._wrappers: list[Any] = []
        while isinstance(env, gymnasium.Wrapper):
            if not isinstance(env, _HOUSEKEEPING):
                self._wrappers.append(env)
            env = env.env
        self.any = bool(self._wrappers)
        self.redraw = any(type(wrapper).render is not gymnasium.Wrapper.render for wrapper in self._wrappers)
        # references to the objects themselves, by which `changes` recognises those that cannot be hashed
        self._initial = [dict(_attributes(wrapper)) for wrapper in self._wrappers]
        self._digests = [{name: _digest(value) for name, value in attributes.items()} for attributes in self._initial]
        self._copies = self.save()

    def begin(self) -> None:
        """Restore the wrappers' initial state."""
        if self.changes():
            self.restore(self._copies)

    def changes(self) -> list[Any]:
        """Return the attributes that have changed since the wrappers were made, for hashing; [] if none has.

        Each is a tuple of the wrapper's number, the attribute's name, and its content in a form that can be hashed.

        Raises:
            WorldError: if a wrapper holds a value that cannot be hashed.
        """
        changes = []
        for number, wrapper in enumerate(self._wrappers):
            initial = self._initial[number]
            digests = self._digests[number]
            for name, value in _attributes(wrapper):
                digest = _digest(value)
                if digest is None and value is not initial.get(name, _ABSENT):
                    raise WorldError(
                        f"{type(wrapper).__name__}.{name} is a {type(value).__name__}; a wrapper's state may hold only "
                        "numbers, strings, arrays, tuples, lists and dicts"
                    )
                if digest is not None and digest != digests.get(name):
                    changes.append((number, name, _to_hashable(value)))
        return changes

    def save(self) -> list[dict[str, Any]]:
        """Return, for each wrapper, copies of its attributes that can change, by name."""
        return [
            {name: copy.deepcopy(value) for name, value in _attributes(wrapper) if _digest(value) is not None}
            for wrapper in self._wrappers
        ]

    def restore(self, saved: list[dict[str, Any]]) -> None:
        """Restore the attributes that `save` returned; they can be restored again."""
        for wrapper, attributes in zip(self._wrappers, saved, strict=True):
            for name, value in list(_attributes(wrapper)):
                if name not in attributes and _digest(value) is not None:
                    delattr(wrapper, name)
            vars(wrapper).update(copy.deepcopy(attributes))


def _attributes(wrapper: Any) -> list[tuple[str, Any]]:
    """Return a wrapper's attributes that Gymnasium does not set, sorted by name."""
    return sorted((name, value) for name, value in vars(wrapper).items() if name not in _NOT_STATE)


def _digest(value: Any) -> int | None:
    """Return the hash of an attribute's value; None if it cannot be hashed."""
    try:
        return hash64(_to_hashable(value))
    except TypeError:
        return None


def _to_hashable(value: Any) -> Any:
    """Return a value in a form that can be hashed."""
    match value:
        case set() | frozenset():
            return sorted(value)
        case deque():
            return list(value)
        case np.random.Generator():
            return value.bit_generator.state
        case _:
            return value
