"""The messages from which a page combines held keys, axes and named actions as the session does."""

import msgspec


class VectorRules(msgspec.Struct):
    """How named actions and axes make a vector, as `VectorActions` does."""

    elements: list[tuple[int, float]]  # for each action from number 1: the component that it sets, and the number
    rest: list[float]  # the number of each component without an action
    low: list[float]
    high: list[float]
    adds: list[bool]  # by component: whether opposite directions cancel each other
    whole: list[bool]  # by component: whether it takes whole numbers only


class HeldRules(msgspec.Struct):
    """How keys that are held and axes combine in the step that time makes."""

    axes: dict[str, tuple[int, float]]  # by name: component and scale
    chords: list[tuple[list[int], int]]  # the actions that are replaced if held together, and their replacement


class HeldInputs(msgspec.Struct):
    """The keys and axes that the session takes for held."""

    down: list[str]  # keys, the latest last
    pressed: list[str]  # since the last step, the latest last
    axes: dict[str, float]  # positions; for the mouse's axes, pixels since the last step
