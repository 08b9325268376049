"""Small studies with pages, questions and sessions, for tests."""

from minihuman.study.expand import enrol, expand
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Protocol, decode

_HEAD = """
[study]
name = "parts"
version = "1"
seed = 3
participants = {participants}
closing = ""
language = "{language}"
[keys]
pool = ["1", "2", "3", "4", "5", "6"]
check = false
"""
_GROUP = """
[[groups]]
name = "all"
parts = {parts}
"""
CORRIDOR = """
[[blocks]]
name = "corridor"
world = "tests.worlds.corridor:tests/Corridor-v0"
episodes = 4
max_steps = 5
actions = ["back", "forward", "dive", "crash"]
hold_ms = 0
"""


def protocol(rest: str, *, language: str = "en", participants: int = 20) -> Protocol:
    """A protocol from all but its first lines."""
    return decode((_HEAD.format(language=language, participants=participants) + rest).encode())


def plan_of(rest: str, parts: list[str], *, language: str = "en", index: int = 0, session: int = 1) -> SessionPlan:
    """The plan of a study of one group with these parts."""
    study = protocol(_GROUP.format(parts=parts) + rest, language=language)
    return expand(study, enrol(study, index), session=session)
