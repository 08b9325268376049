"""The wrappers around a world that are not Gymnasium's own housekeeping: what they keep, and whether they redraw.

An episode begins with wrappers as they were made, so that nothing leaks from one to the next; what they change in it
counts as state. It is made of numbers, texts, arrays, and tuples, lists, dicts, sets and deques of them, and streams.
"""

import copy
from collections import deque
from typing import Any

import gymnasium
import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.hashing import hash64

_HOUSEKEEPING = (
    gymnasium.wrappers.OrderEnforcing,
    gymnasium.wrappers.PassiveEnvChecker,
    gymnasium.wrappers.TimeLimit,
    gymnasium.wrappers.RecordEpisodeStatistics,
    gymnasium.wrappers.RecordVideo,
    gymnasium.wrappers.HumanRendering,
    gymnasium.wrappers.RenderCollection,
)
# what Gymnasium keeps on every wrapper
_NOT_STATE = frozenset(
    {"env", "_action_space", "_observation_space", "_metadata", "_cached_spec", "_saved_kwargs", "spec"}
    | {"action_space", "observation_space", "metadata"}
)
_ABSENT = object()


class Wrappers:
    """Of one world, from outside in."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self._each: list[Any] = []
        while isinstance(env, gymnasium.Wrapper):
            if not isinstance(env, _HOUSEKEEPING):
                self._each.append(env)
            env = env.env
        self.any = bool(self._each)
        self.redraw = any(type(each).render is not gymnasium.Wrapper.render for each in self._each)
        self._made = [dict(_attributes(each)) for each in self._each]  # by reference, to know them again
        self._digests = [{name: _digest(value) for name, value in made.items()} for made in self._made]
        self._copies = self.save()

    def begin(self) -> None:
        """Bring them to what they were when they were made."""
        if self.changes():
            self.restore(self._copies)

    def changes(self) -> list[Any]:
        """What is otherwise than when they were made, in a form that can be hashed; empty where nothing is.

        Raises:
            WorldError: if something is of which nobody can tell what it amounts to.
        """
        found = []
        for place, wrapper in enumerate(self._each):
            made, digests = self._made[place], self._digests[place]
            for name, value in _attributes(wrapper):
                digest = _digest(value)
                if digest is None and value is not made.get(name, _ABSENT):
                    raise WorldError(
                        f"{type(wrapper).__name__} keeps {name!r}, a {type(value).__name__}, in an episode; what a "
                        "wrapper keeps is made of numbers, texts, arrays, and tuples, lists and dicts of them"
                    )
                if digest is not None and digest != digests.get(name):
                    found.append((place, name, _plain(value)))
        return found

    def save(self) -> list[dict[str, Any]]:
        """A copy of all that they keep and that can change."""
        return [
            {name: copy.deepcopy(value) for name, value in _attributes(each) if _digest(value) is not None}
            for each in self._each
        ]

    def restore(self, saved: list[dict[str, Any]]) -> None:
        """Go back to a copy, which is not consumed."""
        for wrapper, kept in zip(self._each, saved, strict=True):
            for name, value in list(_attributes(wrapper)):
                if name not in kept and _digest(value) is not None:
                    delattr(wrapper, name)
            vars(wrapper).update(copy.deepcopy(kept))


def _attributes(wrapper: Any) -> list[tuple[str, Any]]:
    return sorted((name, value) for name, value in vars(wrapper).items() if name not in _NOT_STATE)


def _digest(value: Any) -> int | None:
    try:
        return hash64(_plain(value))
    except TypeError:
        return None


def _plain(value: Any) -> Any:
    match value:
        case set() | frozenset():
            return sorted(value)
        case deque():
            return list(value)
        case np.random.Generator():
            return value.bit_generator.state
        case _:
            return value
