"""Exclusions by an answer: stated before data, refused where none can answer them, counted, and undone beside."""

import json
import re
from pathlib import Path

import pytest

from minihuman.admin.status import count_participant_flow
from minihuman.dataset.selection import ANSWER_RULES, RULES, ExclusionRule, Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.tables import select
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import Answered
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.answer_exclusions import describe_answer_exclusion
from minihuman.experiment.protocol.protocol import ExclusionSpec, decode_logged_protocol, decode_protocol
from minihuman.planning.preregistration import build_preregistration
from minihuman.reporting.build import build_report
from minihuman.runtime.simulated_session import simulate

FAILED = "failed the attention check"
BASE = """
[study]
name = "attentive"
version = "1"
seed = 4
participants = 40
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "a"
[[groups]]
name = "b"
[[sessions]]
name = "day"
parts = ["check", "walk"]
[[questions]]
name = "check"
[[questions.items]]
name = "colour"
kind = "choice"
ask = "Choose blue."
options = ["Red", "Blue"]
codes = ["red", "blue"]
[[questions.items]]
name = "age"
kind = "number"
ask = "How old are you?"
required = false
[[questions.items]]
name = "tired"
kind = "likert"
ask = "I am tired."
points = 5
[[questions.items]]
name = "seen"
kind = "choices"
ask = "What did you see?"
options = ["A cat", "A dog"]
codes = ["cat", "dog"]
[[questions.items]]
name = "words"
kind = "text"
ask = "Anything else?"
required = false
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 2
actions = ["back", "forward", "dive"]
max_steps = 9
"""


def with_rule(fields: str, *, level: str = "participant") -> bytes:
    return f'{BASE}[[exclusions]]\nreason = "{FAILED}"\nlevel = "{level}"\n{fields}\n'.encode()


ATTENTION = with_rule('measure = "answer:check.colour"\nis_none_of = ["blue"]')


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    list(simulate(decode_protocol(ATTENTION), folder, participants=12, seed=2, player="random"))
    return folder / "attentive"


@pytest.fixture(scope="module")
def inattentive(study: Path) -> set[str]:
    """Who did not choose blue, by their logs."""
    return {
        session.log.plan.participant.id
        for session in StudySessions(study, Selection(with_=(RULES,)))
        for event in session.log.part_events
        if isinstance(event, Answered) and event.item == "colour" and json.loads(event.value) != "blue"
    }


def test_who_fails_the_check_is_excluded_and_nobody_else(study: Path, inattentive: set[str]) -> None:
    assert 0 < len(inattentive) < 12
    sessions = list(StudySessions(study))
    assert {one.log.plan.participant.id for one in sessions if one.session_reason == FAILED} == inattentive
    assert {one.log.plan.participant.id for one in sessions if one.places}.isdisjoint(inattentive)


def test_rules_on_answers_can_be_left_out_alone(study: Path) -> None:
    for included in (ANSWER_RULES, RULES):
        assert not any(one.session_reason for one in StudySessions(study, Selection(with_=(included,))))


def test_the_report_counts_them_and_shows_the_result_with_and_without(
    study: Path, inattentive: set[str], tmp_path: Path
) -> None:
    with select(study) as tables:
        page, *_ = build_report(tables, tmp_path / "report")
    text = " ".join(re.sub(r"<[^>]+>", " ", page.read_text(encoding="utf-8")).split())
    n_excluded = len(inattentive)
    assert f"excluded: {FAILED} {n_excluded} " in text
    assert f"included in this report {12 - n_excluded} " in text
    rule = f"whose answer to check.colour is none of &#39;blue&#39; ({FAILED}: {n_excluded} excluded)."
    assert f"By rules that the protocol states, blind to the results, participants are excluded {rule}" in text
    before, after = text.split("If the participants excluded by their answers are included:")
    sizes = re.compile(r"(\d+) and (\d+) participants\)")
    assert sum(map(int, sizes.findall(before)[0])) == 12 - n_excluded
    assert sum(map(int, sizes.findall(after)[0])) == 12
    assert sum(count_participant_flow(study).courses[1].complete.values()) == 12


REFUSED = {
    'measure = "answer:check.color"\nis_none_of = ["blue"]': "is not a question; there are answer:check.colour",
    'measure = "answer:check"\nabove = 3': "is not a question",
    'measure = "answer:check.colour"\nabove = 1': "use is_one_of or is_none_of",
    'measure = "answer:check.colour"\nis_none_of = ["Blue"]': "'Blue', which is not an option's code",
    'measure = "answer:check.tired"\nis_one_of = [9]': "codes: 1, 2, 3, 4, 5",
    'measure = "answer:check.age"\nis_one_of = ["18"]': "give numbers",
    'measure = "answer:check.seen"\nbelow = 2': "use is_one_of or is_none_of",
    'measure = "answer:check.words"\nis_one_of = ["blue"]': "use is_missing, or ask a choice",
    'measure = "answer:check.words"\nbelow = 1': "use is_missing, or ask for a number",
    'measure = "answer:check.colour"\nis_missing = true': "is required; set required = false",
    'measure = "answer:check.age"\nbelow = 18\nwhere = { side = "left" }': "is of trials",
    'measure = "answer:check.age"': "compares nothing",
    'measure = "steps"\nis_one_of = [3]': "use it with measure = 'answer:QUESTIONS.ITEM'",
}


@pytest.mark.parametrize(("fields", "message"), REFUSED.items())
def test_a_rule_that_no_question_can_answer_is_refused(fields: str, message: str) -> None:
    with pytest.raises(ProtocolError, match=re.escape(message)):
        decode_protocol(with_rule(fields))


def test_an_answer_excludes_no_single_episode() -> None:
    with pytest.raises(ProtocolError, match="use level = 'participant'"):
        decode_protocol(with_rule('measure = "answer:check.age"\nbelow = 18', level="episode"))


def test_a_rule_that_is_refused_today_is_still_read_from_a_log() -> None:
    (rule,) = decode_logged_protocol(with_rule('measure = "answer:gone.age"\nbelow = 18')).exclusions
    assert rule.question == "gone.age"


@pytest.mark.parametrize(
    ("fields", "excluded", "included"),
    [
        ({"below": 18}, [17, 0.5], [18, 99, None, "18"]),
        ({"below": 18, "above": 65}, [17, 66], [18, 65]),
        ({"is_one_of": ("red",)}, ["red", ["blue", "red"]], ["blue", [], None]),
        ({"is_none_of": ("blue",)}, ["red", ["red"], []], ["blue", ["blue", "red"], None]),
        ({"is_missing": True}, [None], ["", 0, [], "red"]),
        ({"is_one_of": (1, 2)}, [1, 2], [3]),
    ],
)
def test_which_answers_a_rule_excludes(fields: dict, excluded: list, included: list) -> None:
    spec = ExclusionSpec(FAILED, "participant", "answer:check.colour", **fields)
    rule = ExclusionRule(spec)
    assert [rule.broken_by({spec.measure: [answer]}) for answer in excluded] == [True] * len(excluded)
    assert [rule.broken_by({spec.measure: [answer]}) for answer in included] == [False] * len(included)
    assert not rule.broken_by({spec.measure: []})  # they did not get as far as the question
    assert describe_answer_exclusion(spec).startswith("whose answer to check.colour is ")


def test_the_preregistration_states_the_rule() -> None:
    protocol = decode_protocol(ATTENTION)
    text = build_preregistration(protocol, expand_protocol(protocol, enrol_participant(protocol, 0)))
    assert f"- A participant whose answer to check.colour is none of 'blue': {FAILED}." in text
