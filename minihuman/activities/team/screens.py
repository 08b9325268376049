"""What a team's play shows beyond the play of one person: the words and the marks of its people."""

from typing import NotRequired, TypedDict

from minihuman.experiment.machine.screens import TextField


class PlayMessages(TypedDict):
    """What people who play together write and mark, for a window that draws it."""

    writes: bool
    hint: str
    lines: list[tuple[str, str]]  # author, text
    entry: TextField | None
    cells: list[tuple[float, float, bool]]  # x and z of a mark, and whether it is the person's own
    bounds: tuple[float, float, float, float] | tuple[()]  # of the map: left, top, right, bottom; () without marks


class TeamPageFields(TypedDict):
    """What a team adds to the screen of play in a page."""

    messages: NotRequired[PlayMessages]
