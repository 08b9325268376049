"""Action spaces as actions that keys can do: a few named elementary actions, and their combinations.

A Discrete space has its own actions; two keys held together are another action if the environment says so. The actions
of any other space are vectors: a rest vector, and elements that each move one component away from rest. The module
knows neither keys nor time.
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import EnumMeta
from functools import cache
from importlib.resources import files
from itertools import islice
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError

ActionVector = tuple[float, ...]  # a value of a space that is not Discrete, flat; () for Discrete
Action = int | ActionVector  # by number, or a vector

REST = "rest"  # the name of the action that moves no component
CHORD = "chord"  # the name of every action that is not one element
MAX_BOUND_AXES = 4  # axes of Box spaces that keys move; two for each hand


@dataclass(frozen=True, slots=True)
class ActionElement:
    """The effect of one key on an action vector: a component and the value that it takes."""

    name: str
    component: int
    value: float


class DiscreteActions:
    """The numbered actions of a Discrete space.

    Args:
        names: the name of each action, in order
        first: the space's number of the first action
        chords: by the set of the numbers of actions pressed together, the number of the action that they stand for
    """

    is_discrete = True

    def __init__(self, names: Sequence[str], first: int, chords: Mapping[frozenset[int], int]) -> None:
        self.names = tuple(names)
        self.first = first
        self.chords = chords

    @property
    def numbers(self) -> range:
        """Return the numbers of the actions that a key can do."""
        return range(len(self.names))

    def combine(self, numbers: Sequence[int]) -> tuple[int, ActionVector]:
        """Return the number and vector () of the action of several pressed keys, of which the latest comes last.

        It is the environment's chord of the keys' actions, or else the action of the latest key.
        """
        return self.chords.get(frozenset(numbers), numbers[-1]), ()

    def resolve(self, action: Action) -> tuple[int, ActionVector]:
        """Return the number of an action and its vector, which is ()."""
        return action, ()  # type: ignore[return-value]

    def value(self, action: Action) -> Any:
        """Return an action in the form that the environment's ``step`` takes.

        Raises:
            WorldError: if the action does not exist.
        """
        if isinstance(action, tuple) or not 0 <= action < len(self.names):
            raise WorldError(f"action {action!r} does not exist; actions are 0 to {len(self.names) - 1}")
        return self.first + action


class VectorActions:
    """Actions that are vectors: of Box, MultiBinary and MultiDiscrete, and of Dict and Tuple of these and Discrete.

    ``names`` are rest, one per element, and ``chord`` for any other vector. The components of a Dict or Tuple are those
    of its spaces one after the other, in Gymnasium's order.

    Args:
        space: the environment's action space
        element_names: the environment's own names of the elements, in order; None for `axis_0_minus` and so on
        resolution: the number of steps per 1 to which each component is rounded before use; 0 for no rounding

    Raises:
        WorldError: if the space is of another kind, or there are not as many names as elements.
    """

    is_discrete = False

    def __init__(
        self, space: gymnasium.Space[Any], *, element_names: Sequence[str] | None = None, resolution: int = 0
    ) -> None:
        self._space = space
        self.resolution = resolution
        low: list[float] = []
        high: list[float] = []
        rest_vector: list[float] = []
        adds: list[bool] = []  # by component, whether opposite directions cancel each other
        is_integral: list[bool] = []  # by component, whether it takes only whole numbers
        elements: list[ActionElement] = []
        for leaf in _list_leaves(space):
            n_axes = len({element.component for element in elements if element.name.startswith("axis")})
            leaf_elements, leaf_low, leaf_rest, leaf_high = _read_leaf(leaf, len(rest_vector), MAX_BOUND_AXES - n_axes)
            elements += leaf_elements
            low += leaf_low.tolist()
            high += leaf_high.tolist()
            rest_vector += leaf_rest.tolist()
            adds += [isinstance(leaf, spaces.Box | spaces.MultiBinary)] * len(leaf_rest)
            is_integral += [leaf.dtype is not None and leaf.dtype.kind in "iub"] * len(leaf_rest)
        self._low = np.array(low)
        self._high = np.array(high)
        self._adds = adds
        self._is_integral = is_integral
        self.rest: ActionVector = tuple(rest_vector)
        self._elements = _rename(elements, element_names)
        self.names = (REST, *(element.name for element in self._elements), CHORD)

    @property
    def elements(self) -> tuple[ActionElement, ...]:
        """Return the elements of the actions from number 1, in order."""
        return self._elements

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the lowest and the highest value of each component."""
        return tuple(self._low.tolist()), tuple(self._high.tolist())

    @property
    def adds(self) -> tuple[bool, ...]:
        """Return for each component whether opposite directions cancel each other."""
        return tuple(self._adds)

    @property
    def is_whole(self) -> tuple[bool, ...]:
        """Return for each component whether it takes only whole numbers."""
        return tuple(self._is_integral)

    @property
    def unbound(self) -> int:
        """Return the number of components that no element moves, and that stay at rest."""
        return len(self.rest) - len({element.component for element in self._elements})

    @property
    def numbers(self) -> range:
        """Return the numbers of the actions that a key can do: rest and the elements."""
        return range(len(self._elements) + 1)

    def combine(self, numbers: Sequence[int]) -> tuple[int, ActionVector]:
        """Return the number and vector of the action of several pressed keys, of which the latest comes last.

        The moves of a component add up if its opposite directions cancel; otherwise the latest key's value counts.

        Raises:
            WorldError: if a number is not that of rest or of an element.
        """
        vector = list(self.rest)
        for number in numbers:
            if number not in self.numbers:
                raise WorldError(f"action {number!r} is not in {self._space}; use one of {', '.join(self.names[:-1])}")
            if number:  # 0 is rest
                element = self._elements[number - 1]
                if self._adds[element.component]:
                    base = self.rest[element.component]
                else:
                    base = vector[element.component]  # the latest key replaces earlier ones
                vector[element.component] += element.value - base
        clipped = tuple(np.clip(vector, self._low, self._high).tolist())
        return self._find_number(clipped), clipped

    def move(self, vector: ActionVector, component: int, share: float) -> ActionVector:
        """Return a vector with one component moved by a share (-1 to 1) of the way from rest to its bound.

        Without a bound, the whole way is 1. A component with whole numbers is rounded.

        Raises:
            WorldError: if the component does not exist.
        """
        self.require_component(component)
        end = (self._high if share > 0 else self._low)[component]
        if np.isfinite(end):
            reach = abs(end - self.rest[component])
        else:
            reach = 1.0
        moved = [*vector]
        moved[component] += round(share * reach) if self._is_integral[component] else share * reach
        return tuple(np.clip(moved, self._low, self._high).tolist())

    def point(self, vector: ActionVector, component: int, share: float) -> ActionVector:
        """Return a vector with one component at a share (0 to 1) of its range.

        A component with whole numbers takes the number of the cell in which the point lies.

        Raises:
            WorldError: if the component does not exist or has no bounds.
        """
        self.require_component(component)
        low = self._low[component]
        high = self._high[component]
        if not np.isfinite(high - low):
            raise WorldError(f"component {component} of {self._space} has no bounds, so no point of a picture is its")
        if self._is_integral[component]:
            n_cells = high - low + 1
            offset = min(np.floor(share * n_cells), n_cells - 1)
        else:
            offset = share * (high - low)
        return (*vector[:component], float(low + offset), *vector[component + 1 :])

    def require_component(self, component: int) -> None:
        """Check that a component exists.

        Raises:
            WorldError: if it does not.
        """
        if not 0 <= component < len(self.rest):
            raise WorldError(f"component {component} does not exist; {self._space} has {len(self.rest)}, from 0")

    def resolve(self, action: Action) -> tuple[int, ActionVector]:
        """Return the number and vector of an action, with its components rounded to the resolution."""
        if not isinstance(action, tuple):
            return self.combine([action])
        if self.resolution:
            action = tuple((np.round(np.array(action) * self.resolution) / self.resolution).tolist())
        return self._find_number(action), action

    def _find_number(self, vector: ActionVector) -> int:
        """Return the index in ``names`` of a vector: that of rest, of the element that it equals, or of ``chord``."""
        moved = [
            component
            for component, (coordinate, rest_coordinate) in enumerate(zip(vector, self.rest, strict=True))
            if coordinate != rest_coordinate
        ]
        if not moved:
            return 0
        single = (
            number
            for number, element in enumerate(self._elements, 1)
            if moved == [element.component] and vector[moved[0]] == element.value
        )
        return next(single, len(self.names) - 1)

    def value(self, action: Action) -> Any:
        """Return an action in the form that the environment's ``step`` takes, with the space's type and shape.

        Raises:
            WorldError: if the action does not exist.
        """
        vector = self.resolve(action)[1]
        if len(vector) != len(self.rest):
            raise WorldError(
                f"the action {vector!r} has {len(vector)} components; {self._space} needs {len(self.rest)}"
            )
        value = _assemble(self._space, iter(vector))
        if not self._space.contains(value):
            raise WorldError(f"the action {vector!r} is outside {self._space}; use one inside it")
        return value


def _read_leaf(
    leaf: gymnasium.Space[Any], start: int, most_axes: int
) -> tuple[Sequence[ActionElement], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the elements of a space without nested spaces, and its lowest vector, rest vector and highest vector.

    Args:
        leaf: the space
        start: the number of its first component
        most_axes: how many axes of a Box have elements at most, from the first

    Raises:
        WorldError: if the leaf is of a kind that keys cannot move.
    """
    match leaf:
        case spaces.Box():
            low, high = (np.asarray(end, np.float64).ravel() for end in (leaf.low, leaf.high))
            still = np.clip(np.zeros(low.size), low, high)
            return _axis_elements(low, high, still, start, most_axes), low, still, high
        case spaces.MultiBinary():
            still = np.zeros(int(np.prod(leaf.shape)))
            buttons = [ActionElement(f"button_{start + n}", start + n, 1.0) for n in range(len(still))]
            return buttons, still, still, still + 1
        case spaces.MultiDiscrete() | spaces.Discrete():
            counts = np.ravel(leaf.n if isinstance(leaf, spaces.Discrete) else leaf.nvec)
            still = np.asarray(leaf.start, np.float64).ravel()
            return list(_choice_elements(counts, still, start)), still, still, still + counts - 1
    raise WorldError(
        f"sessions do not support the action space {leaf}; "
        "use Discrete, MultiDiscrete, MultiBinary or Box, or Dict and Tuple of them"
    )


def _rename(elements: Sequence[ActionElement], names: Sequence[str] | None) -> tuple[ActionElement, ...]:
    """Return elements with an environment's own names; unchanged if ``names`` is None.

    Raises:
        WorldError: if there are not as many names as elements.
    """
    if names is None:
        return tuple(elements)
    if len(names) != len(elements):
        raise WorldError(f"it names {len(names)} of the {len(elements)} elements of its actions; name each, in order")
    return tuple(
        ActionElement(name, element.component, element.value) for name, element in zip(names, elements, strict=True)
    )


def _list_leaves(space: gymnasium.Space[Any]) -> list[gymnasium.Space[Any]]:
    """Return the leaves of nested Dict and Tuple spaces, depth first; any other space is its own leaf."""
    match space:
        case spaces.Dict() | spaces.Tuple():
            inner = space.spaces.values() if isinstance(space, spaces.Dict) else space.spaces
            return [leaf for part in inner for leaf in _list_leaves(part)]
    return [space]


def _assemble(space: gymnasium.Space[Any], components: Iterator[float]) -> Any:
    """Return a value of a space, assembled from the next components of an iterator."""
    match space:
        case spaces.Dict():
            return {name: _assemble(part, components) for name, part in space.spaces.items()}
        case spaces.Tuple():
            return tuple(_assemble(part, components) for part in space.spaces)
        case spaces.Discrete():
            return int(next(components))
    size = int(np.prod(space.shape or ()))
    return np.asarray(list(islice(components, size)), space.dtype).reshape(space.shape or ())


ActionInterface = DiscreteActions | VectorActions


def _axis_elements(
    low: np.ndarray[Any, np.dtype[np.float64]],
    high: np.ndarray[Any, np.dtype[np.float64]],
    rest_vector: np.ndarray[Any, np.dtype[np.float64]],
    start: int,
    most: int,
) -> list[ActionElement]:
    """Return elements for both directions of the first ``most`` axes, each to its bound, or by 1 without a bound.

    ``start`` is the number of the first axis among the components of the action.
    """
    elements = []
    for axis in range(max(0, min(len(low), most))):
        for sign, end in (("minus", low[axis]), ("plus", high[axis])):
            if np.isfinite(end):
                value = float(end)
            else:
                value = float(rest_vector[axis]) + (1.0 if sign == "plus" else -1.0)
            if value != rest_vector[axis]:
                elements.append(ActionElement(f"axis_{start + axis}_{sign}", start + axis, value))
    return elements


def _choice_elements(counts: NDArray[Any], first_choices: NDArray[np.float64], start: int) -> Iterator[ActionElement]:
    """Yield an element for each choice but the first, which is rest, of consecutive components.

    Args:
        counts: the number of choices of each component.
        first_choices: the number of the first choice of each component.
        start: the number of the first component.
    """
    for index, count in enumerate(counts.tolist()):
        component = start + index
        for choice in range(1, count):
            yield ActionElement(f"choice_{component}_{choice}", component, float(first_choices[index] + choice))


def find_chords(env: gymnasium.Env[Any, Any], count: int, first: int) -> dict[frozenset[int], int]:
    """Return the action that several actions pressed together stand for, by the set of their numbers.

    The environment's ``get_keys_to_action`` tells which action each combination of keys does. The keys themselves are
    not used: a single key identifies an action, and several keys the chord of their actions.

    Args:
        env: the environment
        count: the number of its actions
        first: the space's number of the first action
    """
    table = getattr(env, "get_keys_to_action", None)
    if not callable(table):
        return {}
    action_by_keys: dict[tuple[Any, ...], int] = {}
    for keys, action in table().items():
        key_tuple = tuple(keys) if isinstance(keys, tuple | list | str) else (keys,)
        if isinstance(action, int | np.integer) and 0 <= int(action) - first < count:
            action_by_keys[key_tuple] = int(action) - first
    action_by_key = {keys[0]: action for keys, action in action_by_keys.items() if len(keys) == 1}
    chords: dict[frozenset[int], int] = {}
    for keys, action in action_by_keys.items():
        if len(keys) > 1 and all(key in action_by_key for key in keys):
            chords[frozenset(action_by_key[key] for key in keys)] = action
    return chords


def build_actions(world_id: str, env: gymnasium.Env[Any, Any]) -> ActionInterface:
    """Return the named actions of an environment's action space.

    Raises:
        WorldError: if keys cannot do the actions, or not all actions have a name.
    """
    space = env.action_space
    native = env.unwrapped
    if not isinstance(space, gymnasium.spaces.Discrete):
        try:
            return VectorActions(
                space,
                element_names=getattr(native, "action_element_names", None),
                resolution=getattr(native, "action_resolution", 0),
            )
        except WorldError as error:
            raise WorldError(f"{world_id}: {error}") from error
    count = int(space.n)
    first = int(space.start)
    names = _action_names(native, count, first)
    if len(names) != count:
        raise WorldError(f"{world_id} names {len(names)} of its {count} actions; name each of them, in order")
    return DiscreteActions(names, first, find_chords(native, count, first))


def _action_names(env: Any, count: int, first: int) -> tuple[str, ...]:
    """Return the names that the environment gives its ``count`` actions, in order; their numbers if it names none.

    ``first`` is the space's number of the first action.
    """
    names = getattr(env, "action_names", None)
    if names is not None:
        return tuple(str(name) for name in names)[:count]
    kinds = getattr(env, "actions", getattr(env, "Actions", None))
    if isinstance(kinds, EnumMeta):
        numbered = [kind for kind in kinds if isinstance(kind.value, int)]  # type: ignore[var-annotated]
        named = {int(kind.value): str(kind.name) for kind in numbered}
        return tuple(named.get(first + action, str(action)) for action in range(count))
    by_number = getattr(getattr(env, "action_type", None), "actions", None)  # where highway-env keeps the names
    if isinstance(by_number, dict):
        return tuple(str(by_number.get(first + action, action)).lower() for action in range(count))
    meanings = getattr(env, "get_action_meanings", None)  # where Atari worlds keep the names
    if callable(meanings):
        return tuple(str(name).lower() for name in meanings())[:count]
    if type(env).__module__.startswith("gymnasium.envs.") and type(env).__name__ in _load_names():
        return tuple(_load_names()[type(env).__name__])
    return tuple(str(action) for action in range(count))


@cache
def _load_names() -> dict[str, list[str]]:
    """Return action names for environments of Gymnasium that state none, by the environment's class."""
    return tomllib.loads(files(__package__).joinpath("action_names.toml").read_text(encoding="utf-8"))
