"""What a design says that makes no study: names that mean nothing, orders and questions that cannot be."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import msgspec

from minihuman.errors import ProtocolError
from minihuman.study.activities.agent_plan import AgentPlan, AgentPlayPlan
from minihuman.study.activities.agent_plan import complaints as agent_complaints
from minihuman.study.activities.drafts import Question
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.activities.registry import kind_of
from minihuman.study.design import Complaint, Questionnaire, as_for, of_each, of_each_group
from minihuman.study.forms import FORMS
from minihuman.study.words import LANGUAGES, flat, of

if TYPE_CHECKING:
    from minihuman.study.protocol import Block, Protocol

_PARTS = ("blocks", "pages", "questions", "activities")
_NAMED = (*_PARTS, "orders")


def design_complaints(protocol: "Protocol") -> list[Complaint]:
    """Every (path, complaint) about pages, questions, orders, sessions and words."""
    return [
        *_words(protocol),
        *_names(protocol),
        *_lists(protocol),
        *_others(protocol),
        *of_each("questions", protocol.questions, lambda asked: _questions(asked, protocol)),
        *_groups(protocol),
        *_overrides(protocol),
        *of_each("blocks", protocol.blocks, lambda block: _block(block, protocol)),
        *_of_no_use(protocol),
    ]


def later_design_complaints(protocol: "Protocol") -> list[Complaint]:
    """The same, by rules without which studies were run before there were any."""
    return [
        *_taken_names(protocol),
        *of_each("questions", protocol.questions, _right_answers),
        *of_each_group(
            "questions", protocol.questions, lambda asked: (*_questions(asked, protocol), *_right_answers(asked))
        ),
        *of_each_group("blocks", protocol.blocks, lambda block: _block(block, protocol)),
    ]


def _words(protocol: "Protocol") -> Iterator[Complaint]:
    language, own = protocol.study.language, flat(protocol.words)
    known = of("en")
    for key, value in own.items():
        if key not in known and not key.startswith(("action.", "mission.")):
            yield f"$.words.{key}", "is no word of the interface; minihuman/study/words/en.toml has them all"
        elif not isinstance(value, str):
            yield f"$.words.{key}", f"is {value!r}; a word is a text in quotes"
    if language not in LANGUAGES:
        missing = [key for key in known if key not in own and not key.startswith(("action.", "mission.", "key."))]
        if missing:
            what = f"is {language!r}, which is none of {', '.join(LANGUAGES)}; give its words under [words], "
            yield "$.study.language", f"{what}{len(missing)} are missing, the first is {missing[0]}"


def _names(protocol: "Protocol") -> Iterator[Complaint]:
    seen: dict[str, str] = {}
    for field in _NAMED:
        for number, part in enumerate(getattr(protocol, field)):
            if part.name in seen and field != "blocks":
                yield f"$.{field}[{number}].name", f"is {part.name!r} again ({seen[part.name]}); give each its own name"
            seen.setdefault(part.name, f"$.{field}[{number}]")


def _taken_names(protocol: "Protocol") -> Iterator[Complaint]:
    """A part of such a name would be shown where one that comes by itself is."""
    by_itself = {
        "consent": ("agree", "$.study.consent", bool(protocol.study.consent)),
        "closing": ("closing", "$.study.closing", protocol.study.closing != ""),
        "keyboard_check": ("", "$.keys.check", protocol.keys.check),
    }
    for field in _NAMED:
        for number, part in enumerate(getattr(protocol, field)):
            instead, whose, comes = by_itself.get(part.name, ("", "", False))
            if comes and not getattr(part, instead, False):
                way = f", or set {instead} = true" if instead and field == "pages" else ""
                yield f"$.{field}[{number}].name", f"is {part.name!r}, as {whose} is called; call it otherwise{way}"


def _others(protocol: "Protocol") -> Iterator[Complaint]:
    blocks = list(dict.fromkeys(block.name for block in protocol.blocks))
    for number, other in enumerate(protocol.activities):
        try:
            kind = kind_of(other.kind)
            plan = kind.read(other.plan)
        except (ProtocolError, msgspec.ValidationError) as error:
            yield f"$.activities[{number}]", f"of kind {other.kind!r}: {error}"
            continue
        if kind.block_field and (named := getattr(plan, kind.block_field)) not in blocks:
            what = f"is {named!r}, which is no block; blocks: {', '.join(blocks) or 'none'}"
            yield f"$.activities[{number}].plan.{kind.block_field}", what


def _lists(protocol: "Protocol") -> Iterator[Complaint]:
    known = {part.name for field in _PARTS for part in getattr(protocol, field)}
    with_orders = known | {order.name for order in protocol.orders}
    lists = [
        *((f"$.sessions[{n}].parts", day.parts, with_orders) for n, day in enumerate(protocol.sessions)),
        *((f"$.groups[{n}].parts", group.parts, with_orders) for n, group in enumerate(protocol.groups)),
        *((f"$.orders[{n}].parts", order.parts, known) for n, order in enumerate(protocol.orders)),
    ]
    for path, names, allowed in lists:
        for place, name in enumerate(names):
            if name not in allowed:
                yield (
                    f"{path}[{place}]",
                    f"is {name!r}, which is no part; parts: {', '.join(sorted(allowed)) or 'none'}",
                )
    for number, group in enumerate(protocol.groups):
        for part, other in group.instead.items():
            for name in (part, other):
                if name and name not in with_orders:
                    yield f"$.groups[{number}].instead", f"names {name!r}, which is no part"
    for number, day in enumerate(protocol.sessions):
        if not day.parts:
            yield f"$.sessions[{number}].parts", "is empty; a session has one part or more"
        if day.days_after and not 0 <= day.days_after[0] <= day.days_after[1]:
            yield (
                f"$.sessions[{number}].days_after",
                f"is {list(day.days_after)}; give the earliest day, then the latest",
            )
        if day.days_after and not number:
            yield f"$.sessions[{number}].days_after", "is given for the first session; days count from the one before"
    for number, order in enumerate(protocol.orders):
        if len(order.parts) < 2:
            yield f"$.orders[{number}].parts", "has no two parts; an order is of two or more"
        if len(set(order.parts)) < len(order.parts):
            yield f"$.orders[{number}].parts", "names a part twice; name each once"


def _questions(asked: Questionnaire, protocol: "Protocol") -> Iterator[Complaint]:
    parts = {part.name for field in _PARTS for part in getattr(protocol, field)}
    if not asked.items and not asked.form:
        yield "items", "is empty; the part needs items, or the name of a form"
    if asked.form and asked.form not in FORMS:
        yield "form", f"is {asked.form!r}; forms: {', '.join(FORMS)}"
    if asked.back_to and asked.back_to not in parts:
        yield "back_to", f"is {asked.back_to!r}, which is no part"
    if not 1 <= asked.tries <= 100:
        yield "tries", f"is {asked.tries}; use 1 to 100"
    names = [item.name for item in asked.items]
    for place, item in enumerate(asked.items):
        if item.name in names[:place]:
            yield f"items[{place}].name", f"is {item.name!r} again; give each its own name"
        yield from ((f"items[{place}].{field}", what) for field, what in _item(item))


def _item(item: Question) -> Iterator[Complaint]:
    if item.kind in ("choice", "choices") and len(item.options) < 2:
        yield "options", f"has {len(item.options)}; a choice is of two or more"
    if item.options and item.kind not in ("choice", "choices", "likert"):
        yield "options", f"is given, but a {item.kind} has none"
    if item.codes and len(item.codes) != (len(item.options) or item.points):
        yield "codes", f"has {len(item.codes)} for {len(item.options) or item.points} options; give one an option"
    if item.kind == "likert" and not 2 <= (len(item.options) or item.points) <= 11:
        yield "points", f"is {len(item.options) or item.points}; use 2 to 11"
    if item.kind in ("slider", "number") and (item.minimum >= item.maximum or item.step <= 0):
        yield "minimum", f"to maximum is {item.minimum:g} to {item.maximum:g} in steps of {item.step:g}, which is none"
    for right in _rights(item):
        if item.kind in ("choice", "choices", "likert") and right not in item.all_codes:
            yield "right", f"is {right!r}, which is no option's code; codes: {', '.join(map(str, item.all_codes))}"


def _rights(item: Question) -> tuple[str | float, ...]:
    rights = item.right if isinstance(item.right, tuple) else (item.right,)
    return tuple(right for right in rights if right is not None)


def _right_answers(asked: Questionnaire) -> Iterator[Complaint]:
    """A right answer is one that can be given."""
    for place, item in enumerate(asked.items):
        kind = item.kind
        for right in _rights(item):
            if kind in ("number", "slider") and isinstance(right, str):
                what = f"is {right!r}, a text, but a {kind} is answered with a number; write it without quotes"
                yield f"items[{place}].right", what
            elif kind not in ("choice", "choices", "likert", "number", "slider") and not isinstance(right, str):
                what = f"is {right!r}, a number, but a {kind} is answered with text; write it in quotes"
                yield f"items[{place}].right", what


def _groups(protocol: "Protocol") -> Iterator[Complaint]:
    for number, group in enumerate(protocol.groups):
        if not 1 <= group.ratio <= 100:
            yield f"$.groups[{number}].ratio", f"is {group.ratio}; use 1 to 100"
        if protocol.sessions and (group.parts or group.blocks):
            field = "parts" if group.parts else "blocks"
            yield f"$.groups[{number}].{field}", "is given beside [[sessions]], which say it; use instead = { ... }"
        elif protocol.designed and not protocol.sessions and not group.parts:
            yield f"$.groups[{number}].parts", "is missing, as another group has parts; give this one its own"


def _overrides(protocol: "Protocol") -> Iterator[Complaint]:
    groups = {group.name for group in protocol.groups}
    for field in ("blocks", "pages", "questions"):
        for number, part in enumerate(getattr(protocol, field)):
            for group, own in part.for_group.items():
                path = f"$.{field}[{number}].for_group.{group}"
                if group not in groups:
                    yield path, f"is for no group; groups: {', '.join(sorted(groups))}"
                    continue
                if {"name", "for_group"} & own.keys():
                    yield path, "changes the name; give the group another part with instead = { ... }"
                    continue
                try:
                    as_for(part, group)
                except msgspec.ValidationError as error:
                    yield path, str(error)


def _block(block: "Block", protocol: "Protocol") -> Iterator[Complaint]:
    pool = protocol.keys.pool
    yield from _kind(block, pool)
    if block.key_map == "fixed" and set(block.fixed.values()) != set(block.actions):
        yield "fixed", "gives keys to other actions than those of the block; give each a key: fixed = { 1 = 'left' }"
    for key in block.fixed:
        if key not in pool:
            yield "fixed", f"has the key {key!r}, which is not in $.keys.pool"
    if block.until and not 1 <= block.until.successes <= block.until.of <= block.episodes:
        what = f"asks for {block.until.successes} of {block.until.of} in {block.episodes} episodes"
        yield "until", f"{what}; use successes <= of <= episodes"
    for field in ("max_s", "block_max_s", "interval_ms", "fixation_ms", "hold_ms"):
        if not 0 <= getattr(block, field) <= 86_400_000:
            yield field, f"is {getattr(block, field):g}; use 0 or more"


def _kind(block: "Block", pool: tuple[str, ...]) -> Iterator[Complaint]:
    """A block's kind is one of blocks, and has an agent where it needs one."""
    try:
        plan = kind_of(block.kind).plan
    except ProtocolError as error:
        yield "kind", f"is {block.kind!r}: {error}"
        return
    if not issubclass(plan, PlayPlan):
        yield "kind", f"is {block.kind!r}, which is no kind of block; list it in [[activities]]"
    elif issubclass(plan, AgentPlayPlan):
        if block.pace != "on_key":
            yield "pace", f"is {block.pace!r}, but the agent of a {block.kind} block has its own pace; leave it out"
        agent = block.agent or AgentPlan()
        yield from ((f"agent.{field}", what) for field, what in agent_complaints(agent, pool))


def _of_no_use(protocol: "Protocol") -> Iterator[Complaint]:
    """What is given and does nothing, for no group."""
    for number, asked in enumerate(protocol.questions):
        if asked.items and asked.form:
            yield f"$.questions[{number}]", "needs items, or the name of a form, and not both"
    for number, block in enumerate(protocol.blocks):
        path, own = f"$.blocks[{number}]", ({}, *block.for_group.values())
        if block.fixed and not any(its.get("key_map", block.key_map) == "fixed" for its in own):
            yield f"{path}.fixed", f"is given, but key_map is {block.key_map!r}; set it to 'fixed'"
        if block.agent is not None and not any(_has_agent(its.get("kind", block.kind)) for its in own):
            yield f"{path}.agent", f"is given, but a {block.kind} block has none; use kind = 'takeover' or 'rating'"


def _has_agent(kind: str) -> bool:
    """Whether a kind of block has one; what is no kind of block is a complaint of its own."""
    try:
        plan = kind_of(kind).plan
    except ProtocolError:
        return True
    return not issubclass(plan, PlayPlan) or issubclass(plan, AgentPlayPlan)
