"""Strata: which answers people can be told apart by, and groups that balance within each."""

import re
from collections import Counter

import pytest

from minihuman.errors import AllocationError, ProtocolError
from minihuman.experiment.machine.events import Answered, PartEnded
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list, find_slot
from minihuman.experiment.plan.dry_run import describe_strata
from minihuman.experiment.protocol.strata import NO_ANSWER, build_strata
from tests.study.studies import CORRIDOR, protocol

GROUPS = """
[[groups]]
name = "a"
allocation_ratio = 2
parts = ["you", "corridor"]
[[groups]]
name = "b"
parts = ["you", "corridor"]
"""
ASKED = """
[[questions]]
name = "you"
[[questions.items]]
name = "hand"
kind = "choice"
ask = "Which hand?"
options = ["Left", "Right", "Both"]
codes = ["left", "right", "both"]
right = "right"
[[questions.items]]
name = "age"
kind = "number"
ask = "How old?"
required = false
[[questions.items]]
name = "why"
kind = "text"
ask = "Why?"
"""
HAND = '[allocation]\nstratify_by = "you.hand"\n'
AGE = '[allocation]\nstratify_by = "you.age"\ncut_points = [30, 60]\n'


def study(allocated: str, groups: str = GROUPS, more: str = "", participants: int = 300):
    return protocol(allocated + groups + ASKED + CORRIDOR + more, participants=participants)


def answered(item: str, value: str, *, attempt: int = 1, right: bool | None = None) -> Answered:
    return Answered(1, 0, "you", item, "choice", attempt, value, "", 0, 0, 0, right)


def test_every_option_is_a_stratum_unless_some_are_taken_together():
    assert build_strata(study(HAND)).names == ("left", "right", "both")
    together = build_strata(study(HAND + 'strata = { right = ["right"], other = ["both", "left"] }\n'))
    assert together.names == ("right", "other")
    assert [together.of(code) for code in ("left", "right", "both")] == ["other", "right", "other"]


def test_a_number_is_cut_and_an_optional_one_may_be_missing():
    strata = build_strata(study(AGE))
    assert strata.names == ("below 30", "30 to below 60", "60 or more", NO_ANSWER)
    assert [strata.of(value) for value in (29, 30, 59.5, 60, None)] == [
        *("below 30", "30 to below 60", "30 to below 60", "60 or more", NO_ANSWER),
    ]


def test_the_answer_that_counts_is_the_last_before_the_part_is_over_for_good():
    strata = build_strata(study(HAND))
    said = [answered("hand", '"left"'), answered("hand", '"right"')]
    assert strata.find_stratum(said) is None
    assert strata.find_stratum([*said, PartEnded(2, 0, "again", 0)]) is None
    later = [answered("hand", '"both"', attempt=2), PartEnded(3, 0, "done", 1), answered("hand", '"left"', attempt=3)]
    assert strata.find_stratum([*said, PartEnded(2, 0, "again", 0), *later]) == "both"


def test_a_score_is_the_number_of_right_answers_at_the_first_try():
    strata = build_strata(study('[allocation]\nstratify_by = "you"\ncut_points = [1]\n'))
    wrong, right = answered("hand", '"left"', right=False), answered("hand", '"right"', attempt=2, right=True)
    assert strata.find_stratum([wrong, right, PartEnded(2, 0, "done", 1)]) == "below 1"


@pytest.mark.parametrize("allocated", [HAND, AGE])
def test_groups_balance_within_each_stratum_and_keys_too(allocated):
    its = study(allocated)
    slots = build_allocation_list(its)
    for stratum in build_strata(its).names:
        mine = [slot for slot in slots if slot.stratum == stratum]
        assert len(mine) == 300
        for many in (30, 60, 150, 300):
            assert Counter(slot.group for slot in mine[:many])["a"] == pytest.approx(2 * many / 3, abs=6)
        forward = Counter(slot.positions[0][1] for slot in mine)
        assert max(forward.values()) - min(forward.values()) <= 1
    assert [find_slot(its, 7, name).index for name in build_strata(its).names] == [
        7 * len(build_strata(its).names) + place for place in range(len(build_strata(its).names))
    ]


def test_strata_have_lists_of_their_own():
    slots = build_allocation_list(study(HAND))
    lists = [[slot.group for slot in slots if slot.stratum == name] for name in ("left", "right", "both")]
    assert lists[0] != lists[1] != lists[2] != lists[0]


def test_a_longer_list_begins_with_a_shorter_one_and_one_without_strata_keeps_its_hash():
    assert build_allocation_list(study(HAND, participants=300))[:60] == build_allocation_list(
        study(HAND, participants=20)
    )
    plain = study("", participants=20)
    assert (
        allocation_sha256(build_allocation_list(plain))
        == "a1d1d25fddd416f9143ec0d63c7954a6ff8e9aa5ff72664e2ca144a29ca66774"
    )
    assert allocation_sha256(build_allocation_list(study(HAND, participants=20))) != allocation_sha256(
        build_allocation_list(plain)
    )


def test_check_counts_the_slots_of_each_stratum():
    lines = list(describe_strata(study(HAND, participants=30)))
    assert lines[1].startswith("strata of you.hand")
    assert [line.split()[0] for line in lines[2:]] == ["left", "right", "both"]
    for line in lines[2:]:
        assert sum(int(number) for number in re.findall(r"[ab] (\d+)", line)) == 30
    assert list(describe_strata(study(""))) == []


def test_a_stratum_that_is_none_is_refused():
    with pytest.raises(AllocationError, match="'up' is not a stratum; use one of left, right, both"):
        find_slot(study(HAND), 0, "up")
    with pytest.raises(AllocationError, match="has no strata"):
        find_slot(study(""), 0, "left")


LATE = GROUPS.replace('["you", "corridor"]', '["corridor", "you"]')
OTHERS = GROUPS.replace('name = "b"\nparts = ["you"', 'name = "b"\nparts = ["hello", "you"')
HELLO = '[[pages]]\nname = "hello"\ntext = "Hello"\n'


@pytest.mark.parametrize(
    ("allocated", "groups", "more", "said"),
    [
        ('[allocation]\nstratify_by = "me.hand"\n', GROUPS, "", "there are no questions 'me'; there are you"),
        (
            '[allocation]\nstratify_by = "you.foot"\n',
            GROUPS,
            "",
            "is not a question; there are you.hand, you.age, you.why",
        ),
        (
            '[allocation]\nstratify_by = "you.why"\n',
            GROUPS,
            "",
            "of kind 'text'; use a question whose answer is a number or an option",
        ),
        ('[allocation]\nstratify_by = "you.age"\n', GROUPS, "", "cut_points is missing, but 'you.age' is a number"),
        ('[allocation]\nstratify_by = "you"\n', GROUPS, "", "cut_points is missing"),
        ('[allocation]\nstratify_by = "you.age"\ncut_points = [60, 30]\n', GROUPS, "", "give them in rising order"),
        (HAND + "cut_points = [1]\n", GROUPS, "", "'you.hand' is not a number"),
        (HAND + 'strata = { right = ["right"] }\n', GROUPS, "", "leaves out left, both"),
        (HAND + 'strata = { all = ["right", "left", "both"] }\n', GROUPS, "", "makes 1 strata; use 2 to 20"),
        (HAND + 'strata = { a = ["right", "left"], b = ["left", "both"] }\n', GROUPS, "", "the code 'left' twice"),
        (HAND + 'strata = { a = ["right", "up"], b = ["left", "both"] }\n', GROUPS, "", "the code 'up'"),
        ('[allocation]\ncut_points = [1]\n', GROUPS, "", "stratify_by names no question"),
        (HAND, GROUPS.split("[[groups]]\nname = \"b\"")[0], "", "there is one group"),
        (HAND, LATE, "", "asks 'you' after 'corridor', which is played"),
        (HAND, OTHERS, HELLO, "after parts that are others for group 'b'"),
        (HAND, GROUPS, "[questions.group_overrides.a]\ntitle = 'A'\n", "'you' is another for some groups"),
        (HAND, GROUPS.replace('["you", "corridor"]', '["corridor"]'), "", "is not a part of the first session"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_its_line_and_a_way_out(allocated, groups, more, said):
    asked = ASKED if "group_overrides" not in more else ASKED.replace('name = "you"\n', 'name = "you"\n' + more, 1)
    with pytest.raises(ProtocolError) as refused:
        protocol(allocated + groups + asked + CORRIDOR + (more if "group_overrides" not in more else ""))
    assert said in str(refused.value)
    assert "[allocation]" in str(refused.value) or "$.allocation" in str(refused.value)
