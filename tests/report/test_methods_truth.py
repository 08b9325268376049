"""Every sentence of the methods text is true of each participant whom it is about: compared with their plan."""

import re
import tomllib
from pathlib import Path

import msgspec
import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.recording_quality import PlanOutline
from minihuman.experiment.machine.events import SessionStarted
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import Participant, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.codec import encode_event
from minihuman.reporting.methods import build_methods
from tests.counts import count
from tests.recompute.methods import check_methods
from tests.recompute.tables import Session

FOLDER = Path(__file__).parents[2]
SHIPPED = [FOLDER / "protocols" / f"{name}.toml" for name in ("two-days", "fourrooms-transfer", "demo")]
INVENTED = sorted((FOLDER / "tests/recompute/protocols").glob("*.toml"))
BLOCK = """
[[blocks]]
name = "{name}"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 3
actions = ["left", "right", "forward"]
max_steps = 30
{more}
"""
HEAD = """
[study]
name = "truth"
version = "1"
seed = 4
participants = 24
[keys]
keyboard_check = false
pool = ["1", "2", "3", "4", "5", "6", "7"]
"""
THREE_GROUPS = (
    HEAD
    + "".join(f'[[groups]]\nname = "{group}"\nblocks = ["practice", "main"]\n' for group in ("find", "see", "fast"))
    + BLOCK.format(name="practice", more="stop_criterion = { successes = 2, of = 3 }")
    + BLOCK.format(
        name="main",
        more='[blocks.group_overrides.see]\nkey_map = "shown"\n'
        '[blocks.group_overrides.fast]\npace = "real_time"\nstep_period_ms = 250\nmax_steps = 12\nepisodes = 2',
    )
)
TWO_SESSIONS = (
    HEAD
    + '[[groups]]\nname = "a"\n[[groups]]\nname = "b"\n'
    + '[[sessions]]\nname = "one"\nparts = ["walk"]\n[[sessions]]\nname = "two"\nparts = ["walk"]\n'
    + '[[orders]]\nname = "walk"\nparts = ["first", "second"]\norder = "latin-square"\n'
    + BLOCK.format(name="first", more='key_map = "constant"')
    + BLOCK.format(name="second", more='key_map = "constant"\n[blocks.group_overrides.b]\nshow_keys = true')
)
FIXED = HEAD + '[[groups]]\nname = "all"\nblocks = ["one"]\n' + BLOCK.format(
    name="one", more='key_map = "fixed"\nfixed_keys = { "1" = "left", "2" = "right", "3" = "forward" }'
)  # fmt: skip
# keys that come back after others were drawn, and three keys of three, which are drawn alike now and then
RETURNING = (
    HEAD.replace('["1", "2", "3", "4", "5", "6", "7"]', '["1", "2", "3"]')
    + '[[groups]]\nname = "all"\nblocks = ["one", "other", "again"]\n'
    + BLOCK.format(name="one", more='key_map = "constant"')
    + BLOCK.format(name="other", more="")
    + BLOCK.format(name="again", more='key_map = "constant"')
)
STUDIES = {
    "three groups": THREE_GROUPS, "two sessions": TWO_SESSIONS, "fixed keys": FIXED, "returning keys": RETURNING,
}  # fmt: skip


def enrol(study: Protocol, many: int) -> list[Participant]:
    """So many participants, in turn of each stratum where groups are drawn after an answer."""
    if not study.allocation.stratify_by:
        return [enrol_participant(study, index) for index in range(many)]
    question, item = study.allocation.stratify_by.split(".")
    asked = next(one for part in study.questions if part.name == question for one in part.items if one.name == item)
    strata = [str(code) for code in asked.all_codes]
    people = [enrol_participant(study, at // len(strata), stratum=strata[at % len(strata)]) for at in range(many)]
    return [msgspec.structs.replace(one, id=f"sub-{at + 1:02d}") for at, one in enumerate(people)]


def expand(study: Protocol, many: int) -> list[SessionPlan]:
    sessions = range(1, max(len(study.sessions), 1) + 1)
    people = enrol(study, min(many, study.study.participants))
    return [expand_protocol(study, person, session=session) for person in people for session in sessions]


def studies() -> list[Protocol]:
    return [decode_protocol(toml.encode()) for toml in STUDIES.values()] + [
        read_protocol(path) for path in (*SHIPPED, *INVENTED)
    ]


IDS = [*STUDIES, *(path.stem for path in (*SHIPPED, *INVENTED))]


def as_logged(plan: SessionPlan) -> Session:
    """A session as the checkers read it from a log: its plan's message, and nothing played yet."""
    _, message = encode_event(SessionStarted(0, plan, {}))
    facts = [("minihuman.facts", {"player": "human"})]
    protocol = tomllib.loads(plan.protocol_toml.decode())
    return Session(
        Path(plan.participant.id), message, protocol, facts, [], 1, "cut_off", 0, {}, [], [], [], [], [], [], [], [0]
    )


@pytest.mark.parametrize("study", studies(), ids=IDS)
def test_each_sentence_is_true_of_each_participant_it_is_about(study: Protocol) -> None:
    for many in (1, 2, 5, count(12, 400)):  # of a few, chance makes things look alike
        plans = expand(study, many)
        text = build_methods([PlanOutline.of(plan) for plan in plans], [], protocols=[study])
        tally = check_methods(text, [as_logged(plan) for plan in plans])
        assert tally.wrong == []
        assert tally.compared > 15 * len(plans)


NUMBER = re.compile(r"(?<![\w.-])\d+(?:\.\d+)?(?![\w-])(?! % )")


@pytest.mark.parametrize("study", studies()[-6:], ids=IDS[-6:])
def test_a_number_that_is_changed_in_a_sentence_is_found(study: Protocol) -> None:
    plans = expand(study, 4)
    text = build_methods([PlanOutline.of(plan) for plan in plans], [], protocols=[study])
    logged = [as_logged(plan) for plan in plans]
    for place, paragraph in enumerate(text):
        for match in NUMBER.finditer(paragraph):
            changed = f"{paragraph[: match.start()]}{float(match[0]) + 1:g}{paragraph[match.end() :]}"
            assert check_methods([*text[:place], changed, *text[place + 1 :]], logged).wrong, changed


def test_a_sentence_of_no_kind_that_is_known_is_found() -> None:
    study = decode_protocol(FIXED.encode())
    plans = expand(study, 2)
    text = build_methods([PlanOutline.of(plan) for plan in plans], [], protocols=[study])
    for place in range(len(text)):
        more = [*text[:place], f"{text[place]} All slept well.", *text[place + 1 :]]
        assert check_methods(more, [as_logged(plan) for plan in plans]).wrong


def test_who_missed_the_second_session_is_not_said_to_have_come() -> None:
    plans = expand(decode_protocol(TWO_SESSIONS.encode()), 4)[:-1]
    people = build_methods([PlanOutline.of(plan) for plan in plans], [])[0]
    assert people.startswith("4 participants took part in 2 sessions (4 in session 1, 3 in session 2)")


def test_what_one_group_saw_is_not_said_of_the_others() -> None:
    text = build_methods([PlanOutline.of(plan) for plan in expand(decode_protocol(THREE_GROUPS.encode()), 12)], [])
    [main] = [paragraph for paragraph in text if paragraph.startswith("Block main")]
    assert "Block main, group see: 3 episodes" in main
    assert main.count("were shown on the screen") == 1
    assert "Block main, group fast: 2 episodes" in main
    assert main.count("every 250 ms") == 1
