"""A column of a table: name, type, unit and meaning; and the columns that say whose row it is, and of when."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["text", "key", "whole", "number", "yes_no"]  # a key is a text, named so that nobody reads a number


@dataclass(frozen=True, slots=True)
class Column:
    """One column; the unit is "" for words, counts and numbers without one."""

    name: str
    kind: Kind
    unit: str
    meaning: str


WHO = (
    Column("study", "text", "", "The study's name in the protocol."),
    Column("version", "text", "", "The protocol's version and the start of its SHA-256: other bytes, another version."),
    Column("participant", "text", "", "The participant's code."),
    Column("group", "text", "", "The group the participant was allocated to."),
    Column("session", "whole", "", "The participant's session, 1 for the first."),
)
WHERE = (
    Column("segment", "whole", "", "The session's segment: 1, and one more after each resume."),
    Column("episode", "whole", "", "The session's episode, 1 for the first, as on the screen and in the figures."),
    Column("attempt", "whole", "", "1, or more where an interrupted episode was begun again."),
)
BLOCK = (Column("block", "text", "", "The block's name in the protocol."),)
LEFT_OUT = Column("left_out", "text", "", "Why the statistics leave this row out; empty where they do not.")
SEGMENT = (Column("segment", "whole", "", "The session's segment, 1 for the first; one more after each resume."),)
T_NS = Column("t_ns", "whole", "ns", "Session time: since the session's first segment began.")
