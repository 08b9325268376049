"""Strata: which answers people can be told apart by, and groups that balance within each."""

import re
from collections import Counter

import pytest

from minihuman.errors import AllocationError, ProtocolError
from minihuman.study.allocation import allocation, allocation_sha256, slot_of
from minihuman.study.dry_run import strata_lines
from minihuman.study.events import Answered, PartEnded
from minihuman.study.strata import NO_ANSWER, strata_of
from tests.study.studies import CORRIDOR, protocol

GROUPS = """
[[groups]]
name = "a"
ratio = 2
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
HAND = '[allocation]\nstratify = "you.hand"\n'
AGE = '[allocation]\nstratify = "you.age"\ncuts = [30, 60]\n'


def study(allocated: str, groups: str = GROUPS, more: str = "", participants: int = 300):
    return protocol(allocated + groups + ASKED + CORRIDOR + more, participants=participants)


def answered(item: str, value: str, *, attempt: int = 1, right: bool | None = None) -> Answered:
    return Answered(1, 0, "you", item, "choice", attempt, value, "", 0, 0, 0, right)


def test_every_option_is_a_stratum_unless_some_are_taken_together():
    assert strata_of(study(HAND)).names == ("left", "right", "both")
    together = strata_of(study(HAND + 'strata = { right = ["right"], other = ["both", "left"] }\n'))
    assert together.names == ("right", "other")
    assert [together.of(code) for code in ("left", "right", "both")] == ["other", "right", "other"]


def test_a_number_is_cut_and_an_optional_one_may_be_missing():
    strata = strata_of(study(AGE))
    assert strata.names == ("below 30", "30 to below 60", "60 or more", NO_ANSWER)
    assert [strata.of(value) for value in (29, 30, 59.5, 60, None)] == [
        *("below 30", "30 to below 60", "30 to below 60", "60 or more", NO_ANSWER),
    ]


def test_the_answer_that_counts_is_the_last_before_the_part_is_over_for_good():
    strata = strata_of(study(HAND))
    said = [answered("hand", '"left"'), answered("hand", '"right"')]
    assert strata.drawn(said) is None
    assert strata.drawn([*said, PartEnded(2, 0, "again", 0)]) is None
    later = [answered("hand", '"both"', attempt=2), PartEnded(3, 0, "done", 1), answered("hand", '"left"', attempt=3)]
    assert strata.drawn([*said, PartEnded(2, 0, "again", 0), *later]) == "both"


def test_a_score_is_the_number_of_right_answers_at_the_first_try():
    strata = strata_of(study('[allocation]\nstratify = "you"\ncuts = [1]\n'))
    wrong, right = answered("hand", '"left"', right=False), answered("hand", '"right"', attempt=2, right=True)
    assert strata.drawn([wrong, right, PartEnded(2, 0, "done", 1)]) == "below 1"


@pytest.mark.parametrize("allocated", [HAND, AGE])
def test_groups_balance_within_each_stratum_and_keys_too(allocated):
    its = study(allocated)
    slots = allocation(its)
    for stratum in strata_of(its).names:
        mine = [slot for slot in slots if slot.stratum == stratum]
        assert len(mine) == 300
        for many in (30, 60, 150, 300):
            assert Counter(slot.group for slot in mine[:many])["a"] == pytest.approx(2 * many / 3, abs=6)
        forward = Counter(slot.positions[0][1] for slot in mine)
        assert max(forward.values()) - min(forward.values()) <= 1
    assert [slot_of(its, 7, name).index for name in strata_of(its).names] == [
        7 * len(strata_of(its).names) + place for place in range(len(strata_of(its).names))
    ]


def test_strata_have_lists_of_their_own():
    slots = allocation(study(HAND))
    lists = [[slot.group for slot in slots if slot.stratum == name] for name in ("left", "right", "both")]
    assert lists[0] != lists[1] != lists[2] != lists[0]


def test_a_longer_list_begins_with_a_shorter_one_and_one_without_strata_keeps_its_hash():
    assert allocation(study(HAND, participants=300))[:60] == allocation(study(HAND, participants=20))
    plain = study("", participants=20)
    assert allocation_sha256(allocation(plain)) == "a1d1d25fddd416f9143ec0d63c7954a6ff8e9aa5ff72664e2ca144a29ca66774"
    assert allocation_sha256(allocation(study(HAND, participants=20))) != allocation_sha256(allocation(plain))


def test_check_counts_the_slots_of_each_stratum():
    lines = list(strata_lines(study(HAND, participants=30)))
    assert lines[1].startswith("strata of you.hand")
    assert [line.split()[0] for line in lines[2:]] == ["left", "right", "both"]
    for line in lines[2:]:
        assert sum(int(number) for number in re.findall(r"[ab] (\d+)", line)) == 30
    assert list(strata_lines(study(""))) == []


def test_a_stratum_that_is_none_is_refused():
    with pytest.raises(AllocationError, match="'up' is no stratum; there are left, right, both"):
        slot_of(study(HAND), 0, "up")
    with pytest.raises(AllocationError, match="has no strata"):
        slot_of(study(""), 0, "left")


LATE = GROUPS.replace('["you", "corridor"]', '["corridor", "you"]')
OTHERS = GROUPS.replace('name = "b"\nparts = ["you"', 'name = "b"\nparts = ["hello", "you"')
HELLO = '[[pages]]\nname = "hello"\ntext = "Hello"\n'


@pytest.mark.parametrize(
    ("allocated", "groups", "more", "said"),
    [
        ('[allocation]\nstratify = "me.hand"\n', GROUPS, "", "there are no questions 'me'; there are you"),
        ('[allocation]\nstratify = "you.foot"\n', GROUPS, "", "is no question; there are you.hand, you.age, you.why"),
        ('[allocation]\nstratify = "you.why"\n', GROUPS, "", "a text; use a choice, a likert, a number or a slider"),
        ('[allocation]\nstratify = "you.age"\n', GROUPS, "", "cuts is missing, but 'you.age' is a number"),
        ('[allocation]\nstratify = "you"\n', GROUPS, "", "cuts is missing"),
        ('[allocation]\nstratify = "you.age"\ncuts = [60, 30]\n', GROUPS, "", "give them in rising order"),
        (HAND + "cuts = [1]\n", GROUPS, "", "'you.hand' is no number"),
        (HAND + 'strata = { right = ["right"] }\n', GROUPS, "", "leaves out left, both"),
        (HAND + 'strata = { all = ["right", "left", "both"] }\n', GROUPS, "", "makes 1 strata; use 2 to 20"),
        (HAND + 'strata = { a = ["right", "left"], b = ["left", "both"] }\n', GROUPS, "", "the code 'left' twice"),
        (HAND + 'strata = { a = ["right", "up"], b = ["left", "both"] }\n', GROUPS, "", "the code 'up'"),
        ('[allocation]\ncuts = [1]\n', GROUPS, "", "stratify names no question"),
        (HAND, GROUPS.split("[[groups]]\nname = \"b\"")[0], "", "there is one group"),
        (HAND, LATE, "", "asks 'you' after 'corridor', which is played"),
        (HAND, OTHERS, HELLO, "after parts that are others for group 'b'"),
        (HAND, GROUPS, "[questions.for_group.a]\ntitle = 'A'\n", "'you' is another for some groups"),
        (HAND, GROUPS.replace('["you", "corridor"]', '["corridor"]'), "", "is no part of the first session of group"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_its_line_and_a_way_out(allocated, groups, more, said):
    asked = ASKED if "for_group" not in more else ASKED.replace('name = "you"\n', 'name = "you"\n' + more, 1)
    with pytest.raises(ProtocolError) as refused:
        protocol(allocated + groups + asked + CORRIDOR + (more if "for_group" not in more else ""))
    assert said in str(refused.value)
    assert "[allocation]" in str(refused.value) or "$.allocation" in str(refused.value)
