"""What `minihuman check` says of a protocol that can be run, but has something without effect or easily misread."""

from collections.abc import Iterator

from minihuman.experiment.plan.ambiguous_texts import list_text_warnings
from minihuman.experiment.protocol.model import Protocol
from minihuman.experiment.protocol.specs import list_useless_item_fields


def list_protocol_notices(protocol: Protocol) -> Iterator[str]:
    """Yield a line for each text that a reader of the tables misreads, and for each field without effect."""
    yield from list_text_warnings(protocol)
    yield from list_useless_item_fields(protocol.questions)
