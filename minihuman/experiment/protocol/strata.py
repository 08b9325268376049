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
    cuts: tuple[float, ...]  # for a number: the lower bounds of its strata, apart from the lowest stratum

    @property
    def question(self) -> str:
        """Return the question's name, "PART.ITEM", or that of the questionnaire whose correct answers are counted."""
        if self.item:
            return f"{self.part}.{self.item}"
        return self.part

    def of(self, answer: Any) -> str:
        """Return the stratum of an answer: a code, a number, or None if the participant skipped the question."""
        if answer is None:
            return NO_ANSWER
        if not self.cuts:
            return self.codes[answer]
        n_reached_cuts = sum(1 for cut in self.cuts if answer >= cut)
        return self.names[n_reached_cuts]

    def find_stratum(self, events: Iterable[Event]) -> str | None:
        """Return the stratum by the answers up to the first completion of the deciding questions; None before that."""
        answer: Any = None
        is_correct: dict[str, bool] = {}  # by question: whether the answer at the first attempt was correct
        part_index: int | None = None
        for event in events:
            match event:
                case Answered() if event.part_name == self.part:
                    part_index = event.part
                    if event.item == self.item:
                        answer = msgspec.json.decode(event.value)
                    if event.attempt == 1:
                        is_correct[event.item] = bool(event.right)
                case PartEnded() if event.part == part_index and event.end != "again":
                    return self.of(answer if self.item else sum(is_correct.values()))
        return None


def build_strata(protocol: Protocol) -> Strata | None:
    """Return the strata of a study; None if groups are drawn without strata."""
    allocation = protocol.allocation
    if not allocation.stratify_by:
        return None
    part, _, name = allocation.stratify_by.partition(".")
    question = _find_question(_list_questions(protocol, part), name)
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
    """Return a (path, message) for each error of the table [allocation]."""
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
    """Yield the errors of the designs that assign groups or end enrolment."""
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
    """Yield an error unless the answer, or the number of correct answers, can divide participants into strata."""
    allocation = protocol.allocation
    part, _, name = allocation.stratify_by.partition(".")
    questions = _list_questions(protocol, part)
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
    question = _find_question(questions, name)
    if question is None:
        names = ", ".join(f"{part}.{question.name}" for question in questions)
        yield "stratify_by", f"is {allocation.stratify_by!r}, which is not a question; there are {names}"
        return
    yield from _check_question(allocation, question)


def _check_question(allocation: AllocationSpec, question: QuestionItemSpec) -> Iterator[FieldError]:
    """Yield an error unless a question has one answer, a number or an option, that is divided into strata."""
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
        advice = "use a question whose answer is a number or an option"
        yield "stratify_by", f"is {allocation.stratify_by!r}, of kind {question.kind!r}; {advice}"


def _check_number_of_strata(protocol: Protocol) -> Iterator[FieldError]:
    strata = build_strata(protocol)
    if strata is not None and not 2 <= len(strata.names) <= MAX_STRATA:
        yield (
            "stratify_by",
            f"makes {len(strata.names)} strata; use 2 to {MAX_STRATA}, with strata = {{ name = [codes] }}",
        )


def _check_cuts(allocation: AllocationSpec) -> Iterator[FieldError]:
    """Yield an error unless only ``cut_points``, in rising order, divides a number into strata."""
    cuts = allocation.cut_points
    number = f"{allocation.stratify_by!r} is a number"
    if not cuts:
        yield "cut_points", f"is missing, but {number}; say where it is cut, as cut_points = [30]"
    if allocation.strata:
        yield "strata", f"is given, but {number}; use cut_points"
    if any(first >= second for first, second in pairwise(cuts)):
        yield "cut_points", f"is {list(cuts)}; give them in rising order, each once"


def _check_codes(allocation: AllocationSpec, question: QuestionItemSpec) -> Iterator[FieldError]:
    """Yield an error unless the code of every option of a question is in exactly one stratum."""
    if allocation.cut_points:
        yield (
            "cut_points",
            f"is given, but {allocation.stratify_by!r} is not a number; use strata = {{ name = [codes] }}",
        )
    if not allocation.strata:
        return
    listed_codes = list(chain.from_iterable(allocation.strata.values()))
    option_codes = list_codes(question)
    for code in dict.fromkeys(listed_codes):
        if code not in option_codes:
            yield (
                "strata",
                f"has the code {code!r}, which is not an option's; codes: {', '.join(map(str, option_codes))}",
            )
        elif listed_codes.count(code) > 1:
            yield "strata", f"has the code {code!r} twice; put each into one stratum"
    missing = [str(code) for code in option_codes if code not in listed_codes]
    if missing:
        yield "strata", f"leaves out {', '.join(missing)}; put every option into a stratum"
    if NO_ANSWER in allocation.strata:
        yield "strata", f"has one called {NO_ANSWER!r}, which is for those who give none; call it otherwise"


def _check_parts_before(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error unless all groups have the same parts up to the questions, and none of these parts is a block.

    The questions are those whose answer decides the stratum; the group is drawn after them.
    """
    part = protocol.allocation.stratify_by.partition(".")[0]
    if len(protocol.groups) < 2:
        yield "stratify_by", "is given, but there is one group; a draw is between two or more"
    first_group_names: list[str] = []
    for group in protocol.groups:
        names = _list_first_session_parts(protocol, group)
        if part not in names:
            yield (
                "stratify_by",
                f"asks {part!r}, which is not a part of the first session of group {group.name!r}; list it",
            )
            return
        names_before_draw = names[: names.index(part) + 1]
        premature_part = _describe_premature_part(protocol, names_before_draw)
        if premature_part:
            yield "stratify_by", f"asks {part!r} after {premature_part}; ask before that"
            return
        first_group_names = first_group_names or names_before_draw
        if names_before_draw != first_group_names:
            yield (
                "stratify_by",
                f"asks {part!r} after parts that are others for group {group.name!r}; give all the same",
            )
            return
    specs: tuple[PageSpec | QuestionnaireSpec, ...] = (*protocol.pages, *protocol.questions)
    for spec in specs:
        if spec.name in first_group_names and spec.group_overrides:
            yield "stratify_by", f"asks {part!r}, but {spec.name!r} is another for some groups, who are drawn later"


def _list_first_session_parts(protocol: Protocol, group: GroupSpec) -> list[str]:
    """Return the names of the parts of a group's first session, with the group's replacements."""
    listed_names = protocol.sessions[0].parts if protocol.sessions else group.parts
    group_names = [group.replace_parts.get(name, name) for name in listed_names]
    return [name for name in group_names if name]  # a part that is replaced by "" is left out


def _describe_premature_part(protocol: Protocol, names: list[str]) -> str:
    """Return a clause about the first named part that cannot come before the group's draw; "" if there is none."""
    orders = {order.name for order in protocol.orders}
    blocks = {block.name for block in protocol.blocks}
    for name in names:
        if name in orders:
            return f"{name!r}, which is an order"
        if name in blocks:
            return f"{name!r}, which is played"
    return ""


def _find_question(questions: Sequence[QuestionItemSpec], name: str) -> QuestionItemSpec | None:
    return next((question for question in questions if question.name == name), None)


def _list_questions(protocol: Protocol, part: str) -> Sequence[QuestionItemSpec]:
    """Return the questions of a questionnaire or of its shipped form; empty if there is no such part or form."""
    questionnaire = next((candidate for candidate in protocol.questions if candidate.name == part), None)
    if questionnaire is None or (questionnaire.form and questionnaire.form not in SHIPPED_FORMS):
        return ()
    if questionnaire.form:
        return load_form(questionnaire.form, protocol.study.language).items
    return questionnaire.items
