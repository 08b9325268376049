"""Random histories of a study: whatever becomes of its participants, the flow's sums hold and its sentences are true.

Each history keeps its own account of every person. Against it stand the table of the flow and the methods' sentences,
which know the enrolment entries and the logs that are left, and nothing else.
"""

import random
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from types import SimpleNamespace

import pytest

from minihuman.admin.enrolment_entries import (
    ChainHeadRecorded,
    EnrolmentEntry,
    GroupDrawn,
    ParticipantReplaced,
    ParticipantWithdrawn,
    SlotFreed,
    SlotTaken,
    TeamRecorded,
)
from minihuman.admin.enrolment_flow import (
    FlowStage,
    ParticipantFlow,
    SessionRecord,
    count_flow,
    list_analysis_stages,
    list_stages,
)
from minihuman.reporting.attrition import Attrition
from minihuman.reporting.participant_flow import flow_table
from tests.counts import count

HISTORIES = count(300, 10_000)
DAYS = 2
GROUPS = ("red", "blue")
AT = "2026-01-01T00:00:00Z"
DEPARTURES = {
    "declined": "did not agree",
    "screened_out": "screened out before a group was drawn",
    "player_failed": "simulated participants that failed before anything was recorded",
    "": "left before anything was recorded",
}
ENDS = ("complete", "complete", "complete", "screened_out", "failed", "unfinished")


@dataclass
class Person:
    """What really became of somebody."""

    code: str
    group: str = ""
    sessions: list[str] = field(default_factory=list)  # the end of each session
    lost: set[int] = field(default_factory=set)  # sessions whose log cannot be read
    is_withdrawn: bool = False
    is_replaced: bool = False
    is_gone: bool = False  # left without data: the code is another person's next
    reason: str | None = None  # excluded for; "": included; None: the report is of others

    def has_end(self, day: int, end: str) -> bool:
        """Whether a readable log says that a session ended so."""
        return self.sessions[day - 1 : day] == [end] and day not in self.lost

    @property
    def is_readable(self) -> bool:
        return len(self.lost) < len(self.sessions)


class History:
    """A study that people enrol in, play, leave, and are taken out of, in any order."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.people: list[Person] = []
        self.entries: list[EnrolmentEntry] = []
        self.left = Counter[str]()  # by reason, before anything was recorded
        self.teams: set[frozenset[str]] = set()
        actions: list[Callable[[], None]] = [
            self.enrol, self.enrol, self.draw, self.play, self.play, self.play, self.leave, self.withdraw,
            self.replace, self.exclude, self.form_team, self.lose_log,
        ]  # fmt: skip
        for _ in range(self.random.randrange(40)):
            self.random.choice(actions)()

    def choose(self, condition: Callable[[Person], bool]) -> Person | None:
        there = [person for person in self.people if not person.is_gone and condition(person)]
        return self.random.choice(there) if there else None

    def enrol(self) -> None:
        there = sum(not person.is_gone for person in self.people)
        group = self.random.choice((*GROUPS, ""))
        person = Person(f"sub-{there + 1:02d}", group, reason=self.random.choice(("", "", "asleep", "bored", None)))
        self.people.append(person)
        self.entries.append(SlotTaken("list", 40, there, person.code, group, False, at=AT))

    def draw(self) -> None:
        if person := self.choose(lambda person: not person.group and not person.is_withdrawn):
            person.group = self.random.choice(GROUPS)
            self.entries.append(GroupDrawn(person.code, "left", 0, person.group, AT))

    def leave(self) -> None:
        last = self.people[-1] if self.people else None
        if last and not (last.is_gone or last.sessions or last.is_withdrawn or last.is_replaced):
            last.is_gone = True
            why = self.random.choice([*DEPARTURES])
            self.left[DEPARTURES[why]] += 1
            self.entries.append(SlotFreed(last.code, AT, why))

    def lose_log(self) -> None:
        if person := self.choose(lambda person: bool(person.sessions)):
            person.lost.add(self.random.randrange(len(person.sessions)) + 1)

    def play(self) -> None:
        if person := self.choose(
            lambda person: (
                bool(person.group)
                and not person.is_withdrawn
                and len(person.sessions) < DAYS
                and all(end == "complete" for end in person.sessions)
            )
        ):
            person.sessions.append(self.random.choice(ENDS))
            name = f"{person.code}_ses-{len(person.sessions):02d}.mcap"
            self.entries.append(ChainHeadRecorded(name, "1", "abc"))

    def withdraw(self) -> None:
        if person := self.choose(lambda person: not person.is_withdrawn):
            person.is_withdrawn = True
            self.entries.append(ParticipantWithdrawn(person.code, AT, self.random.choice(("erased", "sealed"))))

    def replace(self) -> None:
        if person := self.choose(lambda person: not (person.is_withdrawn or person.is_replaced)):
            person.is_replaced = True
            self.entries.append(ParticipantReplaced(person.code, AT))

    def exclude(self) -> None:
        if person := self.choose(lambda person: bool(person.sessions)):
            person.reason = "failed the check"

    def form_team(self) -> None:
        members = [person.code for person in self.people if person.sessions]
        if len(members) > 1:
            pair = self.random.sample(members, 2)
            self.teams.add(frozenset(pair))
            seats = dict(zip(("cook", "waiter"), pair, strict=True))
            self.entries.append(TeamRecorded("team", 0, "kitchen", 1, seats, ("person", "person"), AT))

    def standing(self) -> Iterator[Person]:
        yield from (person for person in self.people if not person.is_gone)

    def records(self) -> Iterator[SessionRecord]:
        for person in self.standing():
            if not person.is_withdrawn:  # else their logs are erased
                for number, end in enumerate(person.sessions, 1):
                    state = "unreadable" if number in person.lost else end
                    yield SessionRecord(person.code, number, person.group, state)

    def reasons(self) -> dict[str, str]:
        return {
            person.code: person.reason
            for person in self.standing()
            if person.is_readable and not person.is_withdrawn and person.reason is not None
        }

    def flow(self) -> ParticipantFlow:
        return count_flow(self.entries, self.records(), self.reasons())

    def by_group(self, condition: Callable[[Person], bool]) -> Counter[str]:
        return Counter(person.group for person in self.standing() if person.group and condition(person))


def assert_sums(stages: list[FlowStage]) -> None:
    for stage, following in pairwise(stages):
        left = Counter(stage.counts)
        if "" in left:  # people who have no group yet
            total = left[""] - sum(sum(counts.values()) for counts in stage.losses.values())
            assert total == sum(following.counts.values()), (stage, following)
            continue
        for counts in stage.losses.values():
            assert counts.keys() <= left.keys()
            left.subtract(counts)
        assert min(left.values(), default=0) >= 0
        assert +left == +Counter(following.counts), (stage, following)


def check_counts(history: History, flow: ParticipantFlow) -> None:
    assert flow.came == len(history.people)
    for label in DEPARTURES.values():
        assert flow.before.get(label, 0) == history.left[label]
    assert flow.allocated == history.by_group(lambda _: True)
    assert flow.withdrew == history.by_group(lambda person: person.is_withdrawn)
    for number, course in flow.courses.items():
        assert course.began == history.by_group(lambda person, day=number: len(person.sessions) >= day)
        for end in ("screened_out", "failed"):
            assert getattr(course, end) == history.by_group(
                lambda person, day=number, end=end: person.has_end(day, end) and not person.is_withdrawn
            )
        assert course.complete == history.by_group(
            lambda person, day=number: (
                len(person.sessions) > day or (person.has_end(day, "complete") and not person.is_withdrawn)
            )
        )
        assert course.went_on == history.by_group(
            lambda person, day=number: len(person.sessions) > day and day in person.lost and not person.is_withdrawn
        )
        assert course.unreadable == history.by_group(
            lambda person, day=number: len(person.sessions) == day and day in person.lost and not person.is_withdrawn
        )
    assert sum(flow.teams.values()) == len(history.teams)
    assert flow.analysis is not None
    assert flow.analysis.included == history.by_group(
        lambda person: person.is_readable and not person.is_withdrawn and person.reason == ""
    )
    assert flow.analysis.unregistered == 0


def check_sentences(history: History, flow: ParticipantFlow) -> None:
    plans = [
        SimpleNamespace(participant=record.participant, group=record.group, session=record.session)
        for record in history.records()
        if record.participant in history.reasons() and record.state != "unreadable"
    ]
    attrition = Attrition.of(plans, flow)
    text = attrition.describe()
    if attrition.is_whole:
        assert attrition.groups == history.by_group(lambda person: bool(person.sessions))
        for number, people in attrition.sessions.items():
            assert people == sum(len(person.sessions) >= number for person in history.standing())
        lost = history.by_group(
            lambda person: bool(person.sessions) and not (person.is_readable or person.is_withdrawn)
        )
        assert bool(lost) == ("can be read" in text)
        assert f"No log of {sum(lost.values())} (" in text or not lost
    withdrew = history.by_group(lambda person: person.is_withdrawn and bool(person.sessions))
    told = re.search(r", (\d+) \(([^)]+)\) withdrew after they had begun", text)
    assert bool(told) == bool(withdrew)
    if told:
        assert int(told[1]) == sum(withdrew.values())
        assert told[2] == ", ".join(f"{withdrew[group]} in group {group}" for group in sorted(withdrew))
    came = re.search(r"Of (\d+) people who came to the study, (\d+) were allocated to a group \(([^)]+)\)", text)
    if came:
        losses = sum(int(number) for number in re.findall(r"(?:^|, )(\d+) ", came[3]))
        assert int(came[1]) - losses == int(came[2]) == sum(flow.allocated.values())
    else:
        assert flow.came == sum(flow.allocated.values())
    replaced = history.by_group(lambda person: person.is_replaced and not person.is_withdrawn)
    assert ("Slots offered again" in text) == bool(replaced)
    assert f"their participants kept: {sum(replaced.values())} (" in text or not replaced


@pytest.mark.nightly(sample=True)
def test_whatever_becomes_of_people_each_line_is_the_one_above_minus_named_losses() -> None:
    kinds = Counter[str]()
    for seed in range(HISTORIES):
        history = History(seed)
        flow = history.flow()
        assert flow.analysis is not None
        stages = list(list_stages(flow))
        assert_sums(stages)
        assert_sums(list(list_analysis_stages(flow.analysis)))
        check_counts(history, flow)
        check_sentences(history, flow)
        table = flow_table(flow)
        assert "sub-" not in str(table)
        kinds.update(label for stage in stages for label in stage.losses)
    assert len(kinds) > 12  # every kind of loss occurred
    print(f"{HISTORIES:,} random histories: no sum and no sentence is wrong; losses of {len(kinds)} kinds in them:")
    print("; ".join(f"{label} in {number:,}" for label, number in kinds.most_common()))


def test_a_completer_who_was_replaced_is_no_loss_and_the_erased_have_begun() -> None:
    """The study of the report that said "began 18" of 20, and of a completer that they did not return."""
    codes = [f"sub-{number:02d}" for number in range(1, 21)]
    entries: list[EnrolmentEntry] = [
        SlotTaken("list", 20, index, code, "all", False, at=AT) for index, code in enumerate(codes)
    ]
    entries += [ChainHeadRecorded(f"{code}_ses-01.mcap", "1", "abc") for code in codes]
    entries += [ParticipantWithdrawn(code, AT, "erased") for code in codes[:2]]
    entries += [ParticipantReplaced(codes[2], AT)]
    sessions = [SessionRecord(code, 1, "all", "complete") for code in codes[2:]]
    rows = [row[:2] for row in flow_table(count_flow(entries, sessions, dict.fromkeys(codes[2:], ""))).rows]
    assert rows == [
        ("came", "20"),
        ("allocated to a group", "20"),
        ("began", "20"),
        ("withdrew during or after it", "2"),
        ("finished and did not withdraw", "18"),
        ("for the analysis: began a session", "20"),
        ("withdrew, data erased or sealed", "2"),
        ("included in this report", "18"),
    ]


def test_a_log_that_is_gone_is_a_named_loss_unless_a_later_session_tells_of_it() -> None:
    taken = [SlotTaken("list", 2, index, f"sub-0{index + 1}", "all", False, at=AT) for index in range(2)]
    heads = [ChainHeadRecorded(f"sub-0{number}_ses-01.mcap", "1", "abc") for number in (1, 2)]
    flow = count_flow([*taken, *heads], [SessionRecord("sub-02", 2, "all", "complete")])
    assert flow.courses[1].unreadable == {"all": 1}
    assert flow.courses[1].went_on == {"all": 1}
    assert_sums(list(list_stages(flow)))


def test_an_excluded_participant_is_subtracted_once_though_screened_out_as_well() -> None:
    entries = [SlotTaken("list", 8, index, f"sub-0{index}", "all", False, at=AT) for index in range(8)]
    ends = ["screened_out", *["complete"] * 7]
    sessions = [SessionRecord(f"sub-0{index}", 1, "all", end) for index, end in enumerate(ends)]
    reasons = {f"sub-0{index}": "" for index in range(8)} | {"sub-00": "no episode counts"}
    rows = dict(row[:2] for row in flow_table(count_flow(entries, sessions, reasons)).rows)
    assert (rows["finished"], rows["for the analysis: began a session"]) == ("7", "8")
    assert (rows["excluded: no episode counts"], rows["included in this report"]) == ("1", "7")
