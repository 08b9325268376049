"""Stratified allocation: groups are assigned within strata of an answer that is given before allocation.

Until that answer a participant has no group, so the earlier parts must be the same for everyone.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

import msgspec

from minihuman.activities.questions.question import QuestionItemSpec, find_question_kind, list_codes
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import Answered, Event, PartEnded
from minihuman.experiment.plan.designs import make_enrolment_design
from minihuman.experiment.protocol.model import GroupSpec, Protocol
from minihuman.experiment.protocol.specs import (
    SHIPPED_FORMS,
    AllocationSpec as AllocationSpec,
    PageSpec,
    QuestionnaireSpec,
    load_form,
)
from minihuman.experiment.protocol.validation_errors import FieldError

NO_ANSWER = "no answer"  # the stratum of participants who skipped an optional question


MAX_STRATA = 20


_CODED = ("code", "rating")  # types of answers whose options have codes


@dataclass(frozen=True, slots=True)
class Strata:
    """The strata of a study, and the stratum of each answer."""

    part: str
    item: str  # "" if the number of correct answers is cut
    names: tuple[str, ...]
    codes: dict[str | int, str]  # option -> stratum; empty for a number
    cuts: tuple[float, ...]  # the lower bounds of all strata of a number but the lowest

    @property
    def question(self) -> str:
        """Return the name of the question in the protocol, or of the questionnaire whose right answers are counted."""
        if self.item:
            return f"{self.part}.{self.item}"
        return self.part

    def of(self, answer: Any) -> str:
        """Return the stratum of a decoded answer; None stands for no answer."""
        if answer is None:
            return NO_ANSWER
        if not self.cuts:
            return self.codes[answer]
        place: int = sum(answer >= cut for cut in self.cuts)
        return self.names[place]

    def find_stratum(self, events: Iterable[Event]) -> str | None:
        """Return a participant's stratum from the answers at the first completion of the part; None before that."""
        answer: Any = None
        right: dict[str, bool] = {}  # whether each question was answered correctly at the first attempt
        part: int | None = None
        for event in events:
            match event:
                case Answered() if event.part_name == self.part:
                    part = event.part
                    if event.item == self.item:
                        answer = msgspec.json.decode(event.value)
                    if event.attempt == 1:
                        right[event.item] = bool(event.right)
                case PartEnded() if event.part == part and event.end != "again":
                    return self.of(answer if self.item else sum(right.values()))
        return None


def build_strata(protocol: Protocol) -> Strata | None:
    """Build the strata of a study; return None if groups are drawn without strata."""
    allocation = protocol.allocation
    if not allocation.stratify_by:
        return None
    part, _, name = allocation.stratify_by.partition(".")
    question = next((question for question in _find_items(protocol, part) if question.name == name), None)
    stratum_of_code: dict[int | str, str] = {}
    for stratum, codes in allocation.strata.items():
        stratum_of_code |= dict.fromkeys(codes, stratum)
    if not stratum_of_code and question is not None and _has_codes(question):
        stratum_of_code = {code: str(code) for code in list_codes(question)}
    names = tuple(dict.fromkeys(stratum_of_code.values()))
    cuts = allocation.cut_points
    if cuts:
        between = (f"{low:g} to below {high:g}" for low, high in pairwise(cuts))
        names = (f"below {cuts[0]:g}", *between, f"{cuts[-1]:g} or more")
    if question is not None and not question.required:
        names = (*names, NO_ANSWER)
    return Strata(part, name, names, stratum_of_code, cuts)


def _has_codes(question: QuestionItemSpec) -> bool:
    return find_question_kind(question.kind).answer_type in _CODED


def check_allocation(protocol: Protocol) -> list[FieldError]:
    """Return a (path, message) for each error of a protocol's strata."""
    design_errors = list(_check_designs(protocol))
    if design_errors:
        return design_errors
    allocation = protocol.allocation
    if not allocation.stratify_by:
        fields = [name for name in ("strata", "cut_points") if getattr(allocation, name)]
        return [(f"$.allocation.{name}", "is given, but stratify_by names no question; name one") for name in fields]
    errors = list(_check_answer(protocol)) or [*_check_number_of_strata(protocol), *_check_parts_before(protocol)]
    return [(f"$.allocation.{field}", message) for field, message in errors]


def _check_designs(protocol: Protocol) -> Iterator[FieldError]:
    allocation = protocol.allocation
    blocks = [block.name for block in protocol.blocks]
    for field in ("design", "stopping"):
        spec = getattr(allocation, field)
        if spec is None:
            continue
        try:
            block = make_enrolment_design(spec).block
        except ProtocolError as error:
            yield f"$.allocation.{field}", f"{spec.name!r}: {error}"
            continue
        if block and block not in blocks:
            yield f"$.allocation.{field}", f"{spec.name!r}: there is no block {block!r}"
    if (allocation.design or allocation.stopping) and len(protocol.groups) < 2:
        yield "$.allocation", "has a design, but there is one group; name two or more"


def _check_answer(protocol: Protocol) -> Iterator[FieldError]:
    """Check that the answer can divide participants into strata."""
    allocation = protocol.allocation
    part, _, name = allocation.stratify_by.partition(".")
    questions = _find_items(protocol, part)
    if not questions:
        parts = ", ".join(questionnaire.name for questionnaire in protocol.questions) or "none"
        yield "stratify_by", f"is {allocation.stratify_by!r}, but there are no questions {part!r}; there are {parts}"
        return
    if not name:
        if all(question.right is None for question in questions):
            example = f"{part}.{questions[0].name}"
            yield "stratify_by", f"is {part!r}, whose questions have no right answers; name one as '{example}'"
        else:
            yield from _check_cuts(allocation)
        return
    question = next((question for question in questions if question.name == name), None)
    if question is None:
        known = ", ".join(f"{part}.{question.name}" for question in questions)
        yield "stratify_by", f"is {allocation.stratify_by!r}, which is not a question; there are {known}"
        return
    if len(question.asked) > 1:
        answers = ", ".join(question.asked)
        yield (
            "stratify_by",
            f"is {allocation.stratify_by!r}, which has several answers ({answers}); use a question with one answer",
        )
        return
    answer_type = find_question_kind(question.kind).answer_type
    if answer_type == "number":
        yield from _check_cuts(allocation)
    elif answer_type in _CODED:
        yield from _check_codes(allocation, question)
    else:
        way_out = "use a question whose answer is a number or an option"
        yield "stratify_by", f"is {allocation.stratify_by!r}, of kind {question.kind!r}; {way_out}"


def _check_number_of_strata(protocol: Protocol) -> Iterator[FieldError]:
    strata = build_strata(protocol)
    if strata is not None and not 2 <= len(strata.names) <= MAX_STRATA:
        yield (
            "stratify_by",
            f"makes {len(strata.names)} strata; use 2 to {MAX_STRATA}, with strata = {{ name = [codes] }}",
        )


def _check_cuts(allocation: AllocationSpec) -> Iterator[FieldError]:
    cuts = allocation.cut_points
    number = f"{allocation.stratify_by!r} is a number"
    if not cuts:
        yield "cut_points", f"is missing, but {number}; say where it is cut, as cut_points = [30]"
    if allocation.strata:
        yield "strata", f"is given, but {number}; use cut_points"
    if any(first >= second for first, second in pairwise(cuts)):
        yield "cut_points", f"is {list(cuts)}; give them in rising order, each once"


def _check_codes(allocation: AllocationSpec, item: QuestionItemSpec) -> Iterator[FieldError]:
    """Yield an error unless every option's code is in exactly one stratum."""
    if allocation.cut_points:
        yield (
            "cut_points",
            f"is given, but {allocation.stratify_by!r} is not a number; use strata = {{ name = [codes] }}",
        )
    if not allocation.strata:
        return
    listed_codes = list(chain.from_iterable(allocation.strata.values()))
    known_codes = list_codes(item)
    known = ", ".join(map(str, known_codes))
    for code in dict.fromkeys(listed_codes):
        if code not in known_codes:
            yield "strata", f"has the code {code!r}, which is not an option's; codes: {known}"
        elif listed_codes.count(code) > 1:
            yield "strata", f"has the code {code!r} twice; put each into one stratum"
    missing = [str(code) for code in known_codes if code not in listed_codes]
    if missing:
        yield "strata", f"leaves out {', '.join(missing)}; put every option into a stratum"
    if NO_ANSWER in allocation.strata:
        yield "strata", f"has one called {NO_ANSWER!r}, which is for those who give none; call it otherwise"


def _check_parts_before(protocol: Protocol) -> Iterator[FieldError]:
    """Check that all participants have the same parts before the draw, and that none of them is a block."""
    part = protocol.allocation.stratify_by.partition(".")[0]
    if len(protocol.groups) < 2:
        yield "stratify_by", "is given, but there is one group; a draw is between two or more"
    first_names: list[str] = []
    for group in protocol.groups:
        names = _list_first_session(protocol, group)
        if part not in names:
            yield (
                "stratify_by",
                f"asks {part!r}, which is not a part of the first session of group {group.name!r}; list it",
            )
            return
        end = names.index(part) + 1
        names_to_draw = names[:end]
        too_early = _find_part_after_draw(protocol, names_to_draw)
        if too_early:
            yield "stratify_by", f"asks {part!r} after {too_early}; ask before that"
            return
        first_names = first_names or names_to_draw
        if names_to_draw != first_names:
            yield (
                "stratify_by",
                f"asks {part!r} after parts that are others for group {group.name!r}; give all the same",
            )
            return
    early_parts: tuple[PageSpec | QuestionnaireSpec, ...] = (*protocol.pages, *protocol.questions)
    for early_part in early_parts:
        if early_part.name in first_names and early_part.group_overrides:
            yield (
                "stratify_by",
                f"asks {part!r}, but {early_part.name!r} is another for some groups, who are drawn later",
            )


def _list_first_session(protocol: Protocol, group: GroupSpec) -> list[str]:
    """Return the parts of a group's first session."""
    listed = protocol.sessions[0].parts if protocol.sessions else group.parts
    replaced = [group.replace_parts.get(name, name) for name in listed]
    return [name for name in replaced if name]


def _find_part_after_draw(protocol: Protocol, names: list[str]) -> str:
    """Describe the first of the parts that must come after the draw; "" if there is none."""
    orders = {order.name for order in protocol.orders}
    blocks = {block.name for block in protocol.blocks}
    for name in names:
        if name in orders:
            return f"{name!r}, which is an order"
        if name in blocks:
            return f"{name!r}, which is played"
    return ""


def _find_items(protocol: Protocol, part: str) -> Sequence[QuestionItemSpec]:
    questionnaire = next((candidate for candidate in protocol.questions if candidate.name == part), None)
    if questionnaire is None or (questionnaire.form and questionnaire.form not in SHIPPED_FORMS):
        return ()
    if questionnaire.form:
        return load_form(questionnaire.form, protocol.study.language).items
    return questionnaire.items
