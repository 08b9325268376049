"""What `minihuman check` says of a protocol that can be run, but has something without effect or easily misread."""

from collections.abc import Iterator, Sequence
from contextlib import suppress

import msgspec

from minihuman.activities.questions.question import QuestionItemSpec, find_question_kind
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.ambiguous_texts import list_text_warnings
from minihuman.experiment.protocol.model import Protocol
from minihuman.plugins import QUESTION_GROUP, list_plugin_names


def list_protocol_notices(protocol: Protocol) -> Iterator[str]:
    """Yield a line for each text that a reader of the tables misreads, and for each field without effect."""
    yield from list_text_warnings(protocol)
    yield from list_useless_item_fields(protocol)


def list_useless_item_fields(protocol: Protocol) -> Iterator[str]:
    """Yield a line for each field of a question that its kind does not use, and that therefore has no effect."""
    specific = _list_specific_fields()
    for questionnaire in protocol.questions:
        for question in questionnaire.items:
            used = find_question_kind(question.kind).item_fields
            if used is not None:  # a plug-in need not say what it uses
                for name in _list_given(question, [field for field in specific if field not in used]):
                    place = f"questions {questionnaire.name!r}: {question.name!r}: {name}"
                    uses = ", ".join(used) or "none of the fields of other kinds"
                    yield f"{place} has no effect on a {question.kind}, which uses {uses}"


def _list_specific_fields() -> list[str]:
    """List the fields that some kinds of question use and others do not, in the order of `QuestionItemSpec`."""
    used: set[str] = set()
    for name in list_plugin_names(QUESTION_GROUP):
        with suppress(ProtocolError):  # a plug-in that cannot be loaded matters only to who asks its questions
            used.update(find_question_kind(name).item_fields or ())
    return [field.name for field in msgspec.structs.fields(QuestionItemSpec) if field.name in used]


def _list_given(question: QuestionItemSpec, names: Sequence[str]) -> Iterator[str]:
    """Yield those of some fields that have another value than without them."""
    defaults = {field.name: field.default for field in msgspec.structs.fields(QuestionItemSpec)}
    yield from (name for name in names if getattr(question, name) != defaults[name])
