"""Consistency rules of a protocol: names, parts, orders, questions, overrides per group, carried key maps."""

from collections.abc import Iterator, Sequence
from itertools import pairwise, permutations, product

import msgspec

from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.question import check_item, find_question_kind
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import find_installed_kind, find_kind, list_kinds
from minihuman.experiment.plan.designs import make_design
from minihuman.experiment.protocol.model import BlockSpec, GroupSpec, Protocol
from minihuman.experiment.protocol.specs import (
    CODE_RULE,
    SHIPPED_FORMS,
    OrderSpec,
    QuestionnaireSpec,
    apply_overrides,
    check_each,
    check_each_override,
    is_completion_code,
)
from minihuman.experiment.protocol.validation_errors import FieldError, select_errors
from minihuman.experiment.words import LANGUAGES, LATER_WORDS, flatten_words, load_words
from minihuman.worlds.catalogue import is_first_person
from minihuman.worlds.outcomes import normalize_outcome_rule


def check_carried_key_maps(protocol: Protocol) -> Iterator[FieldError]:
    """Every (path, complaint) about a carried key map that is for another number of actions than the one before it.

    A session's first block draws its own, so one block can serve the group that carries into it and the group that
    starts with it.
    """
    carried = {name for group in protocol.groups for name in group.blocks[1:]}
    for number, group in enumerate(protocol.groups):
        if group.blocks and group.blocks[0] not in carried:
            first = _find_group_block(protocol, group.blocks[0], group)
            if first is not None and first.key_map == "carry_over":
                what = f"is {first.name!r}, which carries a key map, but no group plays a block before it"
                yield f"$.groups[{number}].blocks[0]", what
        for place, pair in enumerate(pairwise(group.blocks), 1):
            yield from _check_pair(protocol, f"$.groups[{number}].blocks[{place}]", group, *pair)
        for place, listed in enumerate(day.parts for day in protocol.sessions):
            for pair in _list_block_pairs(protocol, group, listed):
                yield from _check_pair(protocol, f"$.sessions[{place}].parts", group, *pair)
        for pair in _list_block_pairs(protocol, group, group.parts):
            yield from _check_pair(protocol, f"$.groups[{number}].parts", group, *pair)


def _check_pair(protocol: Protocol, path: str, group: GroupSpec, first: str, second: str) -> Iterator[FieldError]:
    before = _find_group_block(protocol, first, group)
    block = _find_group_block(protocol, second, group)
    if before is None or block is None or block.key_map != "carry_over" or len(before.actions) == len(block.actions):
        return
    counts = f"{len(block.actions)} actions carried from {len(before.actions)}"
    if path.endswith("]"):
        what = f"is {second!r}"
    else:
        what = f"has {second!r} after {first!r} in group {group.name!r}"
    yield path, f"{what} with {counts}; give both blocks as many, or use key_map = 'new'"


def _list_block_pairs(protocol: Protocol, group: GroupSpec, listed: Sequence[str]) -> list[tuple[str, str]]:
    """The blocks that may be played one right after the other, whatever a participant's order is."""
    known = {block.name for block in protocol.blocks}
    orders = {order.name: order for order in protocol.orders}
    pairs: list[tuple[str, str]] = []
    before: Sequence[str] = ()  # any of these may have been the last
    for name in listed:
        chosen = group.replace_parts.get(name, name)
        order = orders.get(chosen)
        listed_units = ((chosen,),) if order is None else order.units
        units = [
            [part for one in unit if (part := group.replace_parts.get(one, one)) in known] for unit in listed_units
        ]
        units = [unit for unit in units if unit]
        if not units:
            continue
        for unit in units:
            pairs += pairwise(unit)
        varies = order is not None and order.order != "fixed"
        pairs += product(before, [unit[0] for unit in (units if varies else units[:1])])
        pairs += [(one[-1], other[0]) for one, other in (permutations(units, 2) if varies else pairwise(units))]
        before = [unit[-1] for unit in (units if varies else units[-1:])]
    return list(dict.fromkeys(pairs))


def _find_group_block(protocol: Protocol, name: str, group: GroupSpec) -> "BlockSpec | None":
    """The block of a name as a group has it; None where there is none, which is a complaint of its own."""
    try:
        return next((protocol.block_for(name, group.name) for block in protocol.blocks if block.name == name), None)
    except msgspec.ValidationError:
        return None


_PARTS = ("blocks", "pages", "questions", "activities")
_NAMED = (*_PARTS, "orders")


def check_design(protocol: Protocol) -> list[FieldError]:
    """Every (path, complaint) about pages, questions, orders, sessions and words."""
    return [
        *_check_words(protocol),
        *_check_names(protocol),
        *_check_part_lists(protocol),
        *_check_activities(protocol),
        *check_each("questions", protocol.questions, lambda asked: _check_questionnaire(asked, protocol)),
        *_check_groups(protocol),
        *_check_overrides(protocol),
        *check_each("blocks", protocol.blocks, lambda block: _check_block(block, protocol)),
        *_check_unused_fields(protocol),
    ]


def check_newer_design_rules(protocol: Protocol) -> list[FieldError]:
    """The same, by rules without which studies were run before there were any."""
    return [
        *_check_reserved_names(protocol),
        *_check_missing_words(protocol),
        *check_each("questions", protocol.questions, _check_correct_answers),
        *check_each_override(
            "questions",
            protocol.questions,
            lambda asked: (*_check_questionnaire(asked, protocol), *_check_correct_answers(asked)),
        ),
        *check_each_override("blocks", protocol.blocks, lambda block: _check_block(block, protocol)),
    ]


def _check_words(protocol: Protocol) -> Iterator[FieldError]:
    own = flatten_words(protocol.words)
    known = load_words("en")
    for key, value in own.items():
        if key not in known and not key.startswith(("action.", "mission.", "prompt.")):
            yield f"$.words.{key}", "is not a word of the interface; minihuman/experiment/words/en.toml has them all"
        elif not isinstance(value, str):
            yield f"$.words.{key}", f"is {value!r}; a word is a text in quotes"


def _check_missing_words(protocol: Protocol) -> Iterator[FieldError]:
    """Name the words that a language of the study's own lacks. A log may lack newer ones: English serves."""
    language = protocol.study.language
    own = flatten_words(protocol.words)
    if language in LANGUAGES:
        return
    unused: tuple[str, ...] = ("action.", "mission.", "key.", *LATER_WORDS)
    if all(block.team is None for block in protocol.blocks):
        unused += ("team.",)
    missing = [key for key in load_words("en") if key not in own and not key.startswith(unused)]
    if missing:
        what = f"is {language!r}, which is none of {', '.join(LANGUAGES)}; give its words under [words], "
        yield "$.study.language", f"{what}{len(missing)} are missing, the first is {missing[0]}"


def _check_names(protocol: Protocol) -> Iterator[FieldError]:
    seen: dict[str, str] = {}
    for field in _NAMED:
        for number, part in enumerate(getattr(protocol, field)):
            if part.name in seen and field != "blocks":
                yield f"$.{field}[{number}].name", f"is {part.name!r} again ({seen[part.name]}); give each its own name"
            seen.setdefault(part.name, f"$.{field}[{number}]")


def _check_reserved_names(protocol: Protocol) -> Iterator[FieldError]:
    """A part of such a name would be shown where one that comes by itself is."""
    by_itself = {
        "consent": ("asks_consent", "$.study.consent", bool(protocol.study.consent)),
        "closing": ("closing", "$.study.closing", protocol.study.closing != ""),
        "keyboard_check": ("", "$.keys.keyboard_check", protocol.keys.keyboard_check),
    }
    for field in _NAMED:
        for number, part in enumerate(getattr(protocol, field)):
            instead, whose, comes = by_itself.get(part.name, ("", "", False))
            if comes and not getattr(part, instead, False):
                if instead and field == "pages":
                    way = f", or set {instead} = true"
                else:
                    way = ""
                yield f"$.{field}[{number}].name", f"is {part.name!r}, as {whose} is called; call it otherwise{way}"


def _check_activities(protocol: Protocol) -> Iterator[FieldError]:
    blocks = list(dict.fromkeys(block.name for block in protocol.blocks))
    for number, other in enumerate(protocol.activities):
        try:
            kind = find_kind(other.kind)
            plan = kind.read(other.settings)
        except (ProtocolError, msgspec.ValidationError) as error:
            yield f"$.activities[{number}]", f"of kind {other.kind!r}: {error}"
            continue
        if kind.block_field and (named := getattr(plan, kind.block_field)) not in blocks:
            what = f"is {named!r}, which is not a block; blocks: {', '.join(blocks) or 'none'}"
            yield f"$.activities[{number}].settings.{kind.block_field}", what


def _check_part_lists(protocol: Protocol) -> Iterator[FieldError]:
    known = {part.name for field in _PARTS for part in getattr(protocol, field)}
    blocks = {block.name for block in protocol.blocks}
    with_orders = known | {order.name for order in protocol.orders}
    lists = [
        *((f"$.sessions[{n}].parts", day.parts, with_orders) for n, day in enumerate(protocol.sessions)),
        *((f"$.groups[{n}].parts", group.parts, with_orders) for n, group in enumerate(protocol.groups)),
        *(
            (f"$.orders[{n}].parts{place}", names, known)
            for n, order in enumerate(protocol.orders)
            for place, names in _list_units(order)
        ),
    ]
    yield from (
        (f"{path}[{place}]", f"is {name!r}, which is not a part; parts: {', '.join(sorted(allowed)) or 'none'}")
        for path, names, allowed in lists
        for place, name in enumerate(names)
        if name not in allowed
    )
    yield from (
        (f"$.groups[{number}].replace_parts", f"names {name!r}, which is not a part")
        for number, group in enumerate(protocol.groups)
        for replaced in group.replace_parts.items()
        for name in replaced
        if name and name not in with_orders
    )
    for number, day in enumerate(protocol.sessions):
        path = f"$.sessions[{number}]"
        days = day.days_after_previous or ()
        code = day.completion_code
        days_path = f"{path}.days_after_previous"
        yield from select_errors(
            [
                (not day.parts, f"{path}.parts", "is empty; a session has one part or more"),
                (not is_completion_code(code), f"{path}.completion_code", f"is {code!r}; {CODE_RULE}"),
                (
                    days and not 0 <= days[0] <= days[1],
                    days_path,
                    f"is {list(days)}; give the earliest day, then the latest",
                ),
                (
                    days and not number,
                    days_path,
                    "is given for the first session; days count from the one before",
                ),
            ]
        )
    for number, order in enumerate(protocol.orders):
        played = [part for unit in order.units for part in unit if part in blocks]
        twice = len(set(order.units)) < len(order.units) or len(set(played)) < len(played)
        yield from select_errors(
            [
                (
                    len(order.parts) < 2 or not all(order.units),
                    f"$.orders[{number}].parts",
                    "has no two parts; an order is of two or more",
                ),
                (twice, f"$.orders[{number}].parts", "names a part twice; name each once"),
            ]
        )


def _list_units(order: OrderSpec) -> Iterator[tuple[str, Sequence[str]]]:
    """The names of an order and where they are."""
    names = [unit for unit in order.parts if isinstance(unit, str)]
    if len(names) == len(order.parts):
        yield "", names
    else:
        yield from ((f"[{place}]", unit) for place, unit in enumerate(order.units))


def _check_questionnaire(asked: QuestionnaireSpec, protocol: Protocol) -> Iterator[FieldError]:
    parts = {part.name for field in _PARTS for part in getattr(protocol, field)}
    form = asked.form
    back = asked.return_to
    attempts = asked.max_attempts
    yield from select_errors(
        [
            (not asked.items and not form, "items", "is empty; the part needs items, or the name of a form"),
            (form and form not in SHIPPED_FORMS, "form", f"is {form!r}; forms: {', '.join(SHIPPED_FORMS)}"),
            (back and back not in parts, "return_to", f"is {back!r}, which is not a part"),
            (not 1 <= attempts <= 100, "max_attempts", f"is {attempts}; use 1 to 100"),
        ]
    )
    names: list[str] = []
    for place, item in enumerate(asked.items):
        if twice := [name for name in item.asked if name in names]:
            yield f"items[{place}].name", f"is {twice[0]!r} again; give each its own name"
        for name in item.only_if or {}:
            if name not in names or asked.shuffle:
                if asked.shuffle:
                    known = "none, as they are shuffled"
                else:
                    known = ", ".join(names) or "none"
                yield f"items[{place}].only_if", f"names {name!r}, which is no earlier question; earlier ones: {known}"
        names += item.asked
        yield from ((f"items[{place}].{field}", what) for field, what in check_item(item))


def _check_correct_answers(asked: QuestionnaireSpec) -> Iterator[FieldError]:
    """A right answer is one that can be given."""
    for place, item in enumerate(asked.items):
        try:
            answer_type = find_question_kind(item.kind).answer_type
        except ProtocolError:
            continue  # an error of its own
        for right in item.right_answers:
            if answer_type == "number" and isinstance(right, str):
                what = f"is {right!r}, a text, but a {item.kind} is answered with a number; write it without quotes"
                yield f"items[{place}].right", what
            elif answer_type == "text" and not isinstance(right, str):
                what = f"is {right!r}, a number, but a {item.kind} is answered with text; write it in quotes"
                yield f"items[{place}].right", what


def _check_groups(protocol: Protocol) -> Iterator[FieldError]:
    for number, group in enumerate(protocol.groups):
        path = f"$.groups[{number}]"
        ratio = group.allocation_ratio
        yield from select_errors(
            [
                (not 1 <= ratio <= 100, f"{path}.allocation_ratio", f"is {ratio}; use 1 to 100"),
                (
                    protocol.sessions and (group.parts or group.blocks),
                    f"{path}.parts" if group.parts else f"{path}.blocks",
                    "is given beside [[sessions]], which say it; use replace_parts = { ... }",
                ),
                (
                    protocol.lists_parts and not protocol.sessions and not group.parts,
                    f"{path}.parts",
                    "is missing, as another group has parts; give this one its own",
                ),
            ]
        )


def _check_overrides(protocol: Protocol) -> Iterator[FieldError]:
    groups = {group.name for group in protocol.groups}
    for field in ("blocks", "pages", "questions"):
        for number, part in enumerate(getattr(protocol, field)):
            for group, own in part.group_overrides.items():
                path = f"$.{field}[{number}].group_overrides.{group}"
                if group not in groups:
                    yield path, f"is for no group; groups: {', '.join(sorted(groups))}"
                    continue
                if {"name", "group_overrides"} & own.keys():
                    yield path, "changes the name; give the group another part with replace_parts = { ... }"
                    continue
                try:
                    apply_overrides(part, group)
                except msgspec.ValidationError as error:
                    yield path, str(error)


def _check_block(block: BlockSpec, protocol: Protocol) -> Iterator[FieldError]:
    pool = protocol.keys.pool
    yield from _check_block_kind(block, pool)
    on_page = block.computed == "page"
    has_motion = is_first_person(block.world) and block.view == "partial"
    longest = min(1000.0, block.step_period_ms or 1000.0)
    other_keys = block.key_map == "fixed" and set(block.fixed_keys.values()) != set(block.actions)
    times = ("max_episode_s", "max_block_s", "inter_trial_interval_ms", "fixation_ms", "final_frame_ms", "feedback_ms")
    yield from select_errors(
        [
            (
                on_page and not _can_page_compute(block.kind),
                "computed",
                f"is 'page' for a {block.kind} block; a page computes play alone: use 'server'",
            ),
            (
                on_page and block.view == "text",
                "computed",
                "is 'page', but view is 'text', which a page does not draw: use 'server'",
            ),
            (
                on_page and block.hold == "repeat",
                "computed",
                "is 'page', but held keys repeat: a page does not compute them; use 'server'",
            ),
            (
                block.motion_ms and not has_motion,
                "motion_ms",
                "is for built-in first-person worlds with view = 'partial'; remove it",
            ),
            (
                not 0 <= block.motion_ms <= longest,
                "motion_ms",
                f"is {block.motion_ms:g}; use 0 to {longest:g} ms",
            ),
            (
                other_keys,
                "fixed_keys",
                "gives keys to other actions than those of the block; give each a key: fixed_keys = { 1 = 'left' }",
            ),
            *(
                (key not in pool, "fixed_keys", f"has the key {key!r}, which is not in $.keys.pool")
                for key in block.fixed_keys
            ),
            (
                block.feedback_ms and not block.feedback,
                "feedback_ms",
                f"is {block.feedback_ms:g}, but the block has no feedback; give it some",
            ),
            *(
                (not 0 <= given <= 86_400_000, field, f"is {given:g}; use 0 or more")
                for field in times
                if not isinstance(given := getattr(block, field), tuple)
            ),
        ]
    )
    yield from _check_outcome(block)
    if block.design is not None:
        if on_page:
            yield "computed", "is 'page', but a design resolves each episode on the server; use 'server'"
        try:
            make_design(block.design)
        except ProtocolError as error:
            yield "design", f"{block.design.name!r}: {error}"
    if block.stop_criterion and not 1 <= block.stop_criterion.successes <= block.stop_criterion.of <= block.episodes:
        what = f"asks for {block.stop_criterion.successes} of {block.stop_criterion.of} in {block.episodes} episodes"
        yield "stop_criterion", f"{what}; use successes <= of <= episodes"
    interval = block.inter_trial_interval_ms
    if isinstance(interval, tuple) and not 0 <= interval[0] <= interval[1] <= 86_400_000:
        yield "inter_trial_interval_ms", f"is {list(interval)}; give the shortest, then the longest"


def _check_outcome(block: BlockSpec) -> Iterator[FieldError]:
    """Check how success is stated, and which keys of ``info`` are kept."""
    if block.success is not None:
        try:
            normalize_outcome_rule(block.success, at_any_step=False)
        except ProtocolError as error:
            yield "success", str(error)
    for key in block.record_info:
        if not key.strip() or '"' in key or block.record_info.count(key) > 1:
            yield "record_info", f"has {key!r}; name each key of the world's info once, without quotation marks"


def _check_block_kind(block: BlockSpec, pool: tuple[str, ...]) -> Iterator[FieldError]:
    """A block's kind is one of blocks, and the block is as its kind needs it."""
    try:
        kind = find_kind(block.kind)
    except ProtocolError as error:
        yield "kind", f"is {block.kind!r}: {error}"
        return
    if not issubclass(kind.plan, PlayPlan):
        yield "kind", f"is {block.kind!r}, which is not a kind of block; list it in [[activities]]"
    elif kind.check_block is not None:
        yield from kind.check_block(block, pool)


def _check_unused_fields(protocol: Protocol) -> Iterator[FieldError]:
    """What is given and does nothing, for no group."""
    yield from (
        (f"$.questions[{number}]", "needs items, or the name of a form, and not both")
        for number, asked in enumerate(protocol.questions)
        if asked.items and asked.form
    )
    for number, block in enumerate(protocol.blocks):
        path = f"$.blocks[{number}]"
        own = ({}, *block.group_overrides.values())
        kinds = [its.get("kind", block.kind) for its in own]
        none = f"is given, but a {block.kind} block has none; use kind ="
        yield from select_errors(
            [
                (
                    block.fixed_keys and not any(its.get("key_map", block.key_map) == "fixed" for its in own),
                    f"{path}.fixed_keys",
                    f"is given, but key_map is {block.key_map!r}; set it to 'fixed'",
                ),
                (
                    block.agent is not None and not any(_has_table(kind, "agent") for kind in kinds),
                    f"{path}.agent",
                    f"{none} {_name_kinds_with('agent')}",
                ),
                (
                    block.team is not None and not any(_has_table(kind, "team") for kind in kinds),
                    f"{path}.team",
                    f"{none} {_name_kinds_with('team')}",
                ),
            ]
        )


def is_played_alone(kind: str) -> bool:
    """Tell whether only the participant acts in blocks of a kind; one that is not installed is an error of its own."""
    installed = find_installed_kind(kind)
    return installed is None or installed.is_played_alone


def _can_page_compute(kind: str) -> bool:
    installed = find_installed_kind(kind)
    return installed is None or installed.is_plain_play


def _has_table(kind: str, table: str) -> bool:
    """Tell whether blocks of a kind have a table of that name; what is no kind of block is an error of its own."""
    installed = find_installed_kind(kind)
    return installed is None or not issubclass(installed.plan, PlayPlan) or table in installed.plan_fields


def _name_kinds_with(table: str) -> str:
    kinds = list_kinds(lambda kind: issubclass(kind.plan, PlayPlan) and table in kind.plan_fields)
    return " or ".join(map(repr, kinds))
