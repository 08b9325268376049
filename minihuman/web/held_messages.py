"""What a page is told of keys that are held, axes and named actions, to combine them as the session does."""

import msgspec


class VectorRules(msgspec.Struct):
    """How named actions and axes make a vector, as `VectorActions` does."""

    elements: list[tuple[int, float]]  # of each action from number 1: the component that it moves, and where to
    rest: list[float]  # by component
    low: list[float]
    high: list[float]
    adds: list[bool]  # opposite directions cancel each other
    whole: list[bool]  # it takes whole numbers alone


class HeldRules(msgspec.Struct):
    """How keys that are held and axes combine in the step that time makes."""

    axes: dict[str, tuple[int, float]]  # by name: component and scale
    chords: list[tuple[list[int], int]]  # numbered actions that together are another


class HeldInputs(msgspec.Struct):
    """What the session knows to be held."""

    down: list[str]  # keys, the latest last
    pressed: list[str]  # since the last step, the latest last
    axes: dict[str, float]  # where they are; the mouse's: pixels since the last step
