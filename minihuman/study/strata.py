"""Strata: groups drawn among people alike in an answer that they gave before the draw.

Until the answer nobody has a group, so what comes before it is the same for everybody.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import msgspec

from minihuman.study.activities.drafts import Question
from minihuman.study.events import Answered, Event, PartEnded
from minihuman.study.forms import FORMS, form

if TYPE_CHECKING:
    from minihuman.study.design import Questionnaire
    from minihuman.study.protocol import Protocol

NO_ANSWER = "no answer"  # the stratum of those who left an optional question out
MOST = 20
_CODED = ("choice", "likert")
_NUMBERS = ("number", "slider")


class Allocation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How places are drawn, beyond the groups' ratios."""

    stratify: str = ""  # "part.item", or "part" for how many of its questions are right at the first try
    strata: dict[str, tuple[str | int, ...]] = {}  # name -> codes taken together; absent: a stratum an option
    cuts: tuple[float, ...] = ()  # of a number: below the first, from it to below the second, ..., the last or more


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
        """The stratum of whoever said this: by what was answered when the part was over for the first time.

        None as long as it is not.
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


def strata_of(protocol: "Protocol") -> Strata | None:
    """The strata of a study; None where groups are drawn among all."""
    asked = protocol.allocation
    if not asked.stratify:
        return None
    part, _, name = asked.stratify.partition(".")
    item = next((item for item in _items(protocol, part) if item.name == name), None)
    codes = {code: stratum for stratum, its in asked.strata.items() for code in its}
    if not codes and item is not None and item.kind in _CODED:
        codes = {code: str(code) for code in item.all_codes}
    names = _between(asked.cuts) if asked.cuts else tuple(dict.fromkeys(codes.values()))
    if item is not None and not item.required:
        names = (*names, NO_ANSWER)
    return Strata(part, name, names, codes, asked.cuts)


def complaints(protocol: "Protocol") -> list[tuple[str, str]]:
    """Every (path, complaint) about strata that cannot be."""
    asked = protocol.allocation
    if not asked.stratify:
        fields = [name for name in ("strata", "cuts") if getattr(asked, name)]
        return [(f"$.allocation.{name}", "is given, but stratify names no question; name one") for name in fields]
    found = list(_answer(protocol)) or [*_number_of_strata(protocol), *_before(protocol)]
    return [(f"$.allocation.{field}", what) for field, what in found]


def _answer(protocol: "Protocol") -> Iterator[tuple[str, str]]:
    """The answer has to be one that people can be told apart by."""
    asked = protocol.allocation
    part, _, name = asked.stratify.partition(".")
    items = _items(protocol, part)
    if not items:
        parts = ", ".join(one.name for one in protocol.questions) or "none"
        yield "stratify", f"is {asked.stratify!r}, but there are no questions {part!r}; there are {parts}"
        return
    item = next((item for item in items if item.name == name), None)
    if name and item is None:
        known = ", ".join(f"{part}.{item.name}" for item in items)
        yield "stratify", f"is {asked.stratify!r}, which is no question; there are {known}"
        return
    if item is None and all(one.right is None for one in items):
        yield "stratify", f"is {part!r}, whose questions have no right answers; name one as '{part}.{items[0].name}'"
    elif item is not None and item.kind not in (*_CODED, *_NUMBERS):
        yield "stratify", f"is {asked.stratify!r}, a {item.kind}; use a choice, a likert, a number or a slider"
    elif item is None or item.kind in _NUMBERS:
        yield from _number(asked)
    else:
        yield from _options(asked, item)


def _number_of_strata(protocol: "Protocol") -> Iterator[tuple[str, str]]:
    found = strata_of(protocol)
    if found is not None and not 2 <= len(found.names) <= MOST:
        yield "stratify", f"makes {len(found.names)} strata; use 2 to {MOST}, with strata = {{ name = [codes] }}"


def _number(asked: Allocation) -> Iterator[tuple[str, str]]:
    if not asked.cuts:
        yield "cuts", f"is missing, but {asked.stratify!r} is a number; say where it is cut, as cuts = [30]"
    if asked.strata:
        yield "strata", f"is given, but {asked.stratify!r} is a number; use cuts"
    if any(first >= second for first, second in pairwise(asked.cuts)):
        yield "cuts", f"is {list(asked.cuts)}; give them in rising order, each once"


def _options(asked: Allocation, item: Question) -> Iterator[tuple[str, str]]:
    if asked.cuts:
        yield "cuts", f"is given, but {asked.stratify!r} is no number; use strata = {{ name = [codes] }}"
    if not asked.strata:
        return
    taken = [code for codes in asked.strata.values() for code in codes]
    known = ", ".join(map(str, item.all_codes))
    for code in dict.fromkeys(taken):
        if code not in item.all_codes:
            yield "strata", f"has the code {code!r}, which is no option's; codes: {known}"
        elif taken.count(code) > 1:
            yield "strata", f"has the code {code!r} twice; put each into one stratum"
    if missing := [str(code) for code in item.all_codes if code not in taken]:
        yield "strata", f"leaves out {', '.join(missing)}; put every option into a stratum"
    if NO_ANSWER in asked.strata:
        yield "strata", f"has one called {NO_ANSWER!r}, which is for those who give none; call it otherwise"


def _before(protocol: "Protocol") -> Iterator[tuple[str, str]]:
    """What comes before the draw is the same for everybody, and the draw comes before anything is played."""
    part = protocol.allocation.stratify.partition(".")[0]
    if len(protocol.groups) < 2:
        yield "stratify", "is given, but there is one group; a draw is between two or more"
    orders, blocks = {order.name for order in protocol.orders}, {block.name for block in protocol.blocks}
    first: list[str] | None = None
    for group in protocol.groups:
        listed = protocol.sessions[0].parts if protocol.sessions else group.parts
        names = [name for listed_name in listed if (name := group.instead.get(listed_name, listed_name))]
        if part not in names:
            yield "stratify", f"asks {part!r}, which is no part of the first session of group {group.name!r}; list it"
            return
        names = names[: names.index(part) + 1]
        for name in names:
            if name in orders or name in blocks:
                what = "is an order" if name in orders else "is played"
                yield "stratify", f"asks {part!r} after {name!r}, which {what}; ask before that"
                return
        first = first or names
        if names != first:
            yield "stratify", f"asks {part!r} after parts that are others for group {group.name!r}; give all the same"
            return
    for field in ("pages", "questions"):
        for one in getattr(protocol, field):
            if one.name in (first or []) and one.for_group:
                yield "stratify", f"asks {part!r}, but {one.name!r} is another for some groups, who are drawn later"


def _items(protocol: "Protocol", part: str) -> Sequence[Question]:
    asked: Questionnaire | None = next((one for one in protocol.questions if one.name == part), None)
    if asked is None or (asked.form and asked.form not in FORMS):
        return ()
    return form(asked.form, protocol.study.language).items if asked.form else asked.items


def _between(cuts: tuple[float, ...]) -> tuple[str, ...]:
    """Names for what lies between cuts."""
    inner = [f"{low:g} to below {high:g}" for low, high in pairwise(cuts)]
    return (f"below {cuts[0]:g}", *inner, f"{cuts[-1]:g} or more")
