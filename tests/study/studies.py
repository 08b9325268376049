"""Small studies with pages, questions and sessions, for tests."""

import json

from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol

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
keyboard_check = false
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
success = "terminated and reward > 0"
episodes = 4
max_steps = 5
actions = ["back", "forward", "dive", "crash"]
final_frame_ms = 0
"""


def protocol(rest: str, *, language: str = "en", participants: int = 20) -> Protocol:
    """A protocol from all but its first lines."""
    return decode_protocol((_HEAD.format(language=language, participants=participants) + rest).encode())


def plan_of(rest: str, parts: list[str], *, language: str = "en", index: int = 0, session: int = 1) -> SessionPlan:
    """The plan of a study of one group with these parts."""
    study = protocol(_GROUP.format(parts=parts) + rest, language=language)
    return expand_protocol(study, enrol_participant(study, index), session=session)


_TWO_DAYS = """
[study]
name = "days"
version = "1"
seed = 3
participants = 9
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "all"
[[sessions]]
name = "one"
parts = ["walk"]
[[sessions]]
name = "two"
parts = ["walk"]
[[blocks]]
name = "walk"
world = "{world}"
actions = {actions}
max_steps = 5
episodes = 2
"""


def two_days(world: str, actions: list[str]) -> str:
    """A study of two sessions, each with the same block of two episodes of at most five steps."""
    return _TWO_DAYS.format(world=world, actions=json.dumps(actions))
