"""What the screen of a team's play shows beyond that of one person: messages and marks."""

from typing import NotRequired, TypedDict

from minihuman.experiment.machine.screens import TextField


class PlayMessages(TypedDict):
    """The messages and marks of people who play together, for a window to draw."""

    new_entry: TextField | None  # the field that Enter opens; None where people do not write
    hint: str
    lines: list[tuple[str, str]]  # author, text
    entry: TextField | None
    cells: list[tuple[float, float, bool]]  # x and z of a mark, and whether it is the person's own
    bounds: tuple[float, float, float, float] | tuple[()]  # of the map: left, top, right, bottom; () without marks


class TeamPageFields(TypedDict):
    """The fields that a team adds to the page's screen of play."""

    messages: NotRequired[PlayMessages]
