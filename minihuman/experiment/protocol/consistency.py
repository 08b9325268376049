"""Validation rules across a protocol's tables: names, parts, orders, questions and overrides per group."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import msgspec

from minihuman.activities.questions.question import QuestionItemSpec, check_item, find_question_kind
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.protocol.block_rules import check_unused_tables
from minihuman.experiment.protocol.model import Protocol
from minihuman.experiment.protocol.specs import (
    CODE_RULE,
    SHIPPED_FORMS,
    OrderSpec,
    QuestionnaireSpec,
    SessionSpec,
    apply_overrides,
    check_each,
    check_each_override,
    is_completion_code,
    list_question_kinds,
)
from minihuman.experiment.protocol.validation_errors import FieldError
from minihuman.experiment.words import LANGUAGES, LATER_WORDS, flatten_words, load_kind_words, load_words
from minihuman.plugins import QUESTION_GROUP, list_plugin_names

_PARTS = ("blocks", "pages", "questions", "activities")
_NAMED = (*_PARTS, "orders")


def check_design(protocol: Protocol) -> list[FieldError]:
    """Return a (path, message) for each error of pages, questions, orders, sessions and interface texts."""
    return [
        *_check_words(protocol),
        *_check_names(protocol),
        *_check_part_lists(protocol),
        *_check_activities(protocol),
        *check_each(
            "questions", protocol.questions, lambda questionnaire: _check_questionnaire(questionnaire, protocol)
        ),
        *_check_groups(protocol),
        *_check_overrides(protocol),
        *_check_unused_fields(protocol),
    ]


def check_newer_design_rules(protocol: Protocol) -> list[FieldError]:
    """Return the errors found by newer rules, which are not applied to the protocols of recorded sessions."""
    return [
        *_check_reserved_names(protocol),
        *_check_missing_words(protocol),
        *check_each("questions", protocol.questions, _check_correct_answers),
        *check_each_override(
            "questions",
            protocol.questions,
            lambda questionnaire: (
                *_check_questionnaire(questionnaire, protocol),
                *_check_correct_answers(questionnaire),
            ),
        ),
    ]


def _check_words(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error for each interface text in the table [words] that does not exist or is no text."""
    interface_words = {**load_words("en")}
    for kind in list_question_kinds(protocol.questions, [group.name for group in protocol.groups]):
        interface_words |= load_kind_words(kind, "en")
    for key, text in flatten_words(protocol.words).items():
        if key not in interface_words and not key.startswith(("action.", "mission.", "prompt.")):
            yield f"$.words.{key}", "is not a word of the interface; minihuman/experiment/words/en.toml has them all"
        elif not isinstance(text, str):
            yield f"$.words.{key}", f"is {text!r}; a word is a text in quotes"


def _check_missing_words(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error if a study in a language that is not included lacks some of the interface texts in [words].

    The rule is not applied to a recorded session's protocol, which may lack newer texts; English replaces them.
    """
    language = protocol.study.language
    if language in LANGUAGES:
        return
    stated_words = flatten_words(protocol.words)
    optional: tuple[str, ...] = ("action.", "mission.", "key.", *LATER_WORDS, *_list_built_in_kind_words())
    if all(block.team is None for block in protocol.blocks):
        optional += ("team.",)
    missing = [key for key in load_words("en") if key not in stated_words and not key.startswith(optional)]
    if missing:
        message = f"is {language!r}, which is none of {', '.join(LANGUAGES)}; give its words under [words], "
        yield "$.study.language", f"{message}{len(missing)} are missing, the first is {missing[0]}"


def _list_built_in_kind_words() -> Iterator[str]:
    """Yield the keys of the interface texts of the built-in kinds of question.

    A study in a language that is not included may lack them, as kinds may be newer than the study: English replaces
    them, and `check` warns of them.
    """
    for kind in list_plugin_names(QUESTION_GROUP, built_in=True):
        yield from load_kind_words(kind, "en")


def _check_names(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error for each part or order that has the name of an earlier one; blocks are checked elsewhere."""
    path_of_name: dict[str, str] = {}
    for field in _NAMED:
        for number, part in enumerate(getattr(protocol, field)):
            if part.name in path_of_name and field != "blocks":
                yield (
                    f"$.{field}[{number}].name",
                    f"is {part.name!r} again ({path_of_name[part.name]}); give each its own name",
                )
            path_of_name.setdefault(part.name, f"$.{field}[{number}]")


def _check_reserved_names(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error for each part or order that has the name of a part that minihuman adds.

    The study's part would be shown in place of the added part. A page may replace the added one if it has the field
    that marks it as a consent or closing page.
    """
    added_parts = {  # name -> field of a page that may replace it, setting that adds the part, whether it is added
        "consent": ("asks_consent", "$.study.consent", bool(protocol.study.consent)),
        "closing": ("closing", "$.study.closing", protocol.study.closing != ""),
        "keyboard_check": ("", "$.keys.keyboard_check", protocol.keys.keyboard_check),
    }
    for field in _NAMED:
        for number, part in enumerate(getattr(protocol, field)):
            replacing_field, setting, is_added = added_parts.get(part.name, ("", "", False))
            if is_added and not getattr(part, replacing_field, False):
                remedy = f", or set {replacing_field} = true" if replacing_field and field == "pages" else ""
                yield (
                    f"$.{field}[{number}].name",
                    f"is {part.name!r}, the name of the part that {setting} adds; use another name{remedy}",
                )


def _check_activities(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error for each activity whose settings are not valid, or whose block does not exist."""
    blocks = list(dict.fromkeys(block.name for block in protocol.blocks))
    known_blocks = ", ".join(blocks) or "none"
    for number, activity in enumerate(protocol.activities):
        path = f"$.activities[{number}]"
        try:
            kind = find_kind(activity.kind)
            plan = kind.read(activity.settings)
        except (ProtocolError, msgspec.ValidationError) as error:
            yield path, f"of kind {activity.kind!r}: {error}"
            continue
        if kind.block_field:
            block = getattr(plan, kind.block_field)
            if block not in blocks:
                message = f"is {block!r}, which is not a block; blocks: {known_blocks}"
                yield f"{path}.settings.{kind.block_field}", message


def _check_part_lists(protocol: Protocol) -> Iterator[FieldError]:
    """Yield the errors of the lists of parts in a protocol's sessions, groups and orders."""
    parts = {part.name for field in _PARTS for part in getattr(protocol, field)}
    parts_and_orders = parts | {order.name for order in protocol.orders}
    for number, session in enumerate(protocol.sessions):
        yield from _check_part_names(f"$.sessions[{number}].parts", session.parts, parts_and_orders)
        yield from _check_session(session, number)
    for number, group in enumerate(protocol.groups):
        yield from _check_part_names(f"$.groups[{number}].parts", group.parts, parts_and_orders)
        yield from _check_replaced_parts(f"$.groups[{number}].replace_parts", group.replace_parts, parts_and_orders)
    blocks = {block.name for block in protocol.blocks}
    for number, order in enumerate(protocol.orders):
        path = f"$.orders[{number}].parts"
        for path_suffix, names in _list_units(order):
            yield from _check_part_names(f"{path}{path_suffix}", names, parts)
        yield from _check_order(order, path, blocks)


def _check_part_names(path: str, names: Sequence[str], parts: set[str]) -> Iterator[FieldError]:
    """Yield an error for each name in a list that is not among the names of parts."""
    for index, name in enumerate(names):
        if name not in parts:
            yield f"{path}[{index}]", f"is {name!r}, which is not a part; parts: {_join_sorted(parts)}"


def _check_replaced_parts(path: str, replace_parts: Mapping[str, str], parts: set[str]) -> Iterator[FieldError]:
    """Yield an error for each replaced or replacing part of a group that is not among the names of parts."""
    for name in chain.from_iterable(replace_parts.items()):
        if name and name not in parts:
            yield path, f"names {name!r}, which is not a part; parts: {_join_sorted(parts)}"


def _join_sorted(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "none"


def _check_session(session: SessionSpec, number: int) -> Iterator[FieldError]:
    path = f"$.sessions[{number}]"
    if not session.parts:
        yield f"{path}.parts", "is empty; a session has one part or more"
    if not is_completion_code(session.completion_code):
        yield f"{path}.completion_code", f"is {session.completion_code!r}; {CODE_RULE}"
    days = session.days_after_previous
    if days and not 0 <= days[0] <= days[1]:
        yield f"{path}.days_after_previous", f"is {list(days)}; give the earliest day, then the latest"
    if days and number == 0:
        yield f"{path}.days_after_previous", "is given for the first session; days count from the one before"


def _check_order(order: OrderSpec, path: str, blocks: set[str]) -> Iterator[FieldError]:
    if len(order.parts) < 2 or not all(order.units):
        yield path, "has fewer than two parts, or an empty list of parts; an order has two or more"
    played = [part for unit in order.units for part in unit if part in blocks]
    if len(set(order.units)) < len(order.units) or len(set(played)) < len(played):
        yield path, "names a part twice; name each once"


def _list_units(order: OrderSpec) -> Iterator[tuple[str, Sequence[str]]]:
    """Yield the lists of part names in an order, each with the suffix that it adds to the path of the order's parts.

    Parts that are all given as names form one list without a suffix.
    """
    names = [unit for unit in order.parts if isinstance(unit, str)]
    if len(names) == len(order.parts):
        yield "", names
    else:
        yield from ((f"[{index}]", unit) for index, unit in enumerate(order.units))


def _check_questionnaire(questionnaire: QuestionnaireSpec, protocol: Protocol) -> Iterator[FieldError]:
    parts = {part.name for field in _PARTS for part in getattr(protocol, field)}
    form = questionnaire.form
    attempts = questionnaire.max_attempts
    return_to = questionnaire.return_to
    if not questionnaire.items and not form:
        yield "items", "is empty; the part needs items, or the name of a form"
    if form and form not in SHIPPED_FORMS:
        yield "form", f"is {form!r}; forms: {', '.join(SHIPPED_FORMS)}"
    if return_to and return_to not in parts:
        yield "return_to", f"is {return_to!r}, which is not a part; parts: {', '.join(sorted(parts))}"
    if not 1 <= attempts <= 100:
        yield "max_attempts", f"is {attempts}; use 1 to 100"
    yield from _check_items(questionnaire)


def _check_items(questionnaire: QuestionnaireSpec) -> Iterator[FieldError]:
    """Yield the errors of a questionnaire's questions: taken names, conditions on later answers, and wrong fields."""
    earlier: list[str] = []  # the names of the answers to earlier questions
    for index, question in enumerate(questionnaire.items):
        duplicates = [name for name in question.asked if name in earlier]
        if duplicates:
            yield f"items[{index}].name", f"is {duplicates[0]!r} again; give each its own name"
        for message in _check_condition(question, earlier, is_shuffled=questionnaire.shuffle):
            yield f"items[{index}].only_if", message
        earlier += question.asked
        for field, message in check_item(question):
            yield f"items[{index}].{field}", message


def _check_condition(question: QuestionItemSpec, earlier: Sequence[str], *, is_shuffled: bool) -> Iterator[str]:
    """Yield a message for each answer on which a question depends that no earlier question gives."""
    answerable = () if is_shuffled else earlier
    for name in question.only_if or {}:
        if name not in answerable:
            names = "none, as they are shuffled" if is_shuffled else ", ".join(earlier) or "none"
            yield f"names {name!r}, which is no earlier question; earlier ones: {names}"


def _check_correct_answers(questionnaire: QuestionnaireSpec) -> Iterator[FieldError]:
    """Yield an error for each correct answer that is a text where participants enter a number, or the reverse."""
    for index, question in enumerate(questionnaire.items):
        kind = question.kind
        try:
            answer_type = find_question_kind(kind).answer_type
        except ProtocolError:
            continue  # ``check_item`` reports an unknown kind
        for right in question.right_answers:
            if answer_type == "number" and isinstance(right, str):
                message = f"is {right!r}, a text, but kind {kind!r} is answered with a number; write it without quotes"
                yield f"items[{index}].right", message
            elif answer_type == "text" and not isinstance(right, str):
                message = f"is {right!r}, a number, but kind {kind!r} is answered with text; write it in quotes"
                yield f"items[{index}].right", message


def _check_groups(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error for each group whose ratio is not valid, or whose parts contradict the protocol's sessions."""
    for number, group in enumerate(protocol.groups):
        path = f"$.groups[{number}]"
        ratio = group.allocation_ratio
        if not 1 <= ratio <= 100:
            yield f"{path}.allocation_ratio", f"is {ratio}; use 1 to 100"
        if protocol.sessions:
            message = "is given beside [[sessions]], which list the parts; use replace_parts = { ... }"
            if group.parts:
                yield f"{path}.parts", message
            elif group.blocks:
                yield f"{path}.blocks", message
        elif protocol.lists_parts and not group.parts:
            yield f"{path}.parts", "is missing, as another group has parts; give this one its own"


def _check_overrides(protocol: Protocol) -> Iterator[FieldError]:
    groups = {group.name for group in protocol.groups}
    for field in ("blocks", "pages", "questions"):
        for number, part in enumerate(getattr(protocol, field)):
            for group, overrides in part.group_overrides.items():
                path = f"$.{field}[{number}].group_overrides.{group}"
                if group not in groups:
                    yield path, f"is for no group; groups: {', '.join(sorted(groups))}"
                    continue
                if {"name", "group_overrides"} & overrides.keys():
                    yield path, "changes the name; give the group another part with replace_parts = { ... }"
                    continue
                try:
                    apply_overrides(part, group)
                except msgspec.ValidationError as error:
                    yield path, str(error)


def _check_unused_fields(protocol: Protocol) -> Iterator[FieldError]:
    """Yield an error for each field that is given but has no effect for any group."""
    for number, questionnaire in enumerate(protocol.questions):
        if questionnaire.items and questionnaire.form:
            yield f"$.questions[{number}]", "needs items, or the name of a form, and not both"
    yield from check_each("blocks", protocol.blocks, check_unused_tables)
