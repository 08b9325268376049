"""Stratified allocation: assign groups within strata of an answer given before allocation.

Until that answer a participant has no group, so the earlier parts must be the same for everyone.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import msgspec

from minihuman.activities.questions.question import QuestionItemSpec, find_question_kind
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import Answered, Event, PartEnded
from minihuman.experiment.plan.designs import make_enrolment_design
from minihuman.experiment.protocol.model import Protocol
from minihuman.experiment.protocol.specs import (
    SHIPPED_FORMS,
    AllocationSpec as AllocationSpec,
    QuestionnaireSpec,
    load_form,
)
from minihuman.experiment.protocol.validation_errors import FieldError, select_errors

NO_ANSWER = "no answer"  # the stratum of those who left an optional question out


MAX_STRATA = 20


_CODED = ("code", "rating")  # types of answers


@dataclass(frozen=True, slots=True)
class Strata:
    """The strata of a study, and whose answer belongs to which."""

    part: str
    item: str  # "": the number of right answers
    names: tuple[str, ...]
    codes: dict[str | int, str]  # option -> stratum; {} where there are cuts
    cuts: tuple[float, ...]

    @property
    def question(self) -> str:
        """What is asked, as the protocol names it."""
        return f"{self.part}.{self.item}" if self.item else self.part

    def of(self, value: Any) -> str:
        """The stratum of an answer, as it is in the log."""
        if value is None:
            return NO_ANSWER
        return self.names[sum(value >= cut for cut in self.cuts)] if self.cuts else self.codes[value]

    def drawn(self, events: Iterable[Event]) -> str | None:
        """The stratum of a participant with these answers, from the first time that the part was completed.

        None until then.
        """
        value: Any = None
        right: dict[str, bool] = {}  # at the first try
        part: int | None = None
        for event in events:
            match event:
                case Answered() if event.part_name == self.part:
                    part = event.part
                    if event.item == self.item:
                        value = msgspec.json.decode(event.value)
                    if event.attempt == 1:
                        right[event.item] = bool(event.right)
                case PartEnded() if event.part == part and event.end != "again":
                    return self.of(value if self.item else sum(right.values()))
        return None


def build_strata(protocol: Protocol) -> Strata | None:
    """The strata of a study; None where groups are drawn among all."""
    asked = protocol.allocation
    if not asked.stratify_by:
        return None
    part, _, name = asked.stratify_by.partition(".")
    item = next((item for item in _find_items(protocol, part) if item.name == name), None)
    codes = {code: stratum for stratum, its in asked.strata.items() for code in its}
    if not codes and item is not None and find_question_kind(item.kind).answer_type in _CODED:
        codes = {code: str(code) for code in item.all_codes}
    names = tuple(dict.fromkeys(codes.values()))
    if cuts := asked.cut_points:
        between = (f"{low:g} to below {high:g}" for low, high in pairwise(cuts))
        names = (f"below {cuts[0]:g}", *between, f"{cuts[-1]:g} or more")
    if item is not None and not item.required:
        names = (*names, NO_ANSWER)
    return Strata(part, name, names, codes, asked.cut_points)


def check_allocation(protocol: Protocol) -> list[FieldError]:
    """Every (path, complaint) about strata that cannot be."""
    asked = protocol.allocation
    wrong = []
    for field, spec in ((name, its) for name in ("design", "stopping") if (its := getattr(asked, name)) is not None):
        try:
            block = make_enrolment_design(spec).block
            if block and block not in [one.name for one in protocol.blocks]:
                wrong.append((f"$.allocation.{field}", f"{spec.name!r}: there is no block {block!r}"))
        except ProtocolError as error:
            wrong.append((f"$.allocation.{field}", f"{spec.name!r}: {error}"))
    if (asked.design or asked.stopping) and len(protocol.groups) < 2:
        wrong.append(("$.allocation", "has a design, but there is one group; name two or more"))
    if wrong:
        return wrong
    if not asked.stratify_by:
        fields = [name for name in ("strata", "cut_points") if getattr(asked, name)]
        return [(f"$.allocation.{name}", "is given, but stratify_by names no question; name one") for name in fields]
    found = list(_check_answer(protocol)) or [*_check_number_of_strata(protocol), *_check_parts_before(protocol)]
    return [(f"$.allocation.{field}", what) for field, what in found]


def _check_answer(protocol: Protocol) -> Iterator[FieldError]:
    """The answer has to be one that people can be told apart by."""
    asked = protocol.allocation
    part, _, name = asked.stratify_by.partition(".")
    items = _find_items(protocol, part)
    if not items:
        parts = ", ".join(one.name for one in protocol.questions) or "none"
        yield "stratify_by", f"is {asked.stratify_by!r}, but there are no questions {part!r}; there are {parts}"
        return
    item = next((item for item in items if item.name == name), None)
    if name and item is None:
        known = ", ".join(f"{part}.{item.name}" for item in items)
        yield "stratify_by", f"is {asked.stratify_by!r}, which is not a question; there are {known}"
        return
    if item is None and all(one.right is None for one in items):
        yield "stratify_by", f"is {part!r}, whose questions have no right answers; name one as '{part}.{items[0].name}'"
    elif item is not None and find_question_kind(item.kind).answer_type not in (*_CODED, "number"):
        yield "stratify_by", f"is {asked.stratify_by!r}, a {item.kind}; use a choice, a likert, a number or a slider"
    elif item is None or find_question_kind(item.kind).answer_type == "number":
        yield from _check_cuts(asked)
    else:
        yield from _check_codes(asked, item)


def _check_number_of_strata(protocol: Protocol) -> Iterator[FieldError]:
    found = build_strata(protocol)
    if found is not None and not 2 <= len(found.names) <= MAX_STRATA:
        yield (
            "stratify_by",
            f"makes {len(found.names)} strata; use 2 to {MAX_STRATA}, with strata = {{ name = [codes] }}",
        )


def _check_cuts(asked: AllocationSpec) -> list[FieldError]:
    cuts = asked.cut_points
    number = f"{asked.stratify_by!r} is a number"
    return select_errors(
        [
            (not cuts, "cut_points", f"is missing, but {number}; say where it is cut, as cut_points = [30]"),
            (asked.strata, "strata", f"is given, but {number}; use cut_points"),
            (
                any(first >= second for first, second in pairwise(cuts)),
                "cut_points",
                f"is {list(cuts)}; give them in rising order, each once",
            ),
        ]
    )


def _check_codes(asked: AllocationSpec, item: QuestionItemSpec) -> Iterator[FieldError]:
    if asked.cut_points:
        yield "cut_points", f"is given, but {asked.stratify_by!r} is not a number; use strata = {{ name = [codes] }}"
    if not asked.strata:
        return
    taken = [code for codes in asked.strata.values() for code in codes]
    known = ", ".join(map(str, item.all_codes))
    for code in dict.fromkeys(taken):
        if code not in item.all_codes:
            yield "strata", f"has the code {code!r}, which is not an option's; codes: {known}"
        elif taken.count(code) > 1:
            yield "strata", f"has the code {code!r} twice; put each into one stratum"
    if missing := [str(code) for code in item.all_codes if code not in taken]:
        yield "strata", f"leaves out {', '.join(missing)}; put every option into a stratum"
    if NO_ANSWER in asked.strata:
        yield "strata", f"has one called {NO_ANSWER!r}, which is for those who give none; call it otherwise"


def _check_parts_before(protocol: Protocol) -> Iterator[FieldError]:
    """What comes before the draw is the same for everybody, and the draw comes before anything is played."""
    part = protocol.allocation.stratify_by.partition(".")[0]
    if len(protocol.groups) < 2:
        yield "stratify_by", "is given, but there is one group; a draw is between two or more"
    orders = {order.name for order in protocol.orders}
    blocks = {block.name for block in protocol.blocks}
    first: list[str] | None = None
    for group in protocol.groups:
        listed = protocol.sessions[0].parts if protocol.sessions else group.parts
        names = [name for listed_name in listed if (name := group.replace_parts.get(listed_name, listed_name))]
        if part not in names:
            yield (
                "stratify_by",
                f"asks {part!r}, which is not a part of the first session of group {group.name!r}; list it",
            )
            return
        names = names[: names.index(part) + 1]
        for name in names:
            if name in orders or name in blocks:
                what = "is an order" if name in orders else "is played"
                yield "stratify_by", f"asks {part!r} after {name!r}, which {what}; ask before that"
                return
        first = first or names
        if names != first:
            yield (
                "stratify_by",
                f"asks {part!r} after parts that are others for group {group.name!r}; give all the same",
            )
            return
    for field in ("pages", "questions"):
        for one in getattr(protocol, field):
            if one.name in (first or []) and one.group_overrides:
                yield "stratify_by", f"asks {part!r}, but {one.name!r} is another for some groups, who are drawn later"


def _find_items(protocol: Protocol, part: str) -> Sequence[QuestionItemSpec]:
    asked: QuestionnaireSpec | None = next((one for one in protocol.questions if one.name == part), None)
    if asked is None or (asked.form and asked.form not in SHIPPED_FORMS):
        return ()
    return load_form(asked.form, protocol.study.language).items if asked.form else asked.items
