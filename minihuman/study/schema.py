"""The protocol file's JSON schema, which editors complete and check by."""

from typing import Any

import msgspec

from minihuman.study.mistakes import NO_FIELDS
from minihuman.study.protocol import Protocol


def json_schema() -> dict[str, Any]:
    """The schema (draft 2020-12) of what ``decode`` takes."""
    schema = msgspec.json.schema(Protocol)
    definition = schema["$defs"]["Protocol"]
    for name in NO_FIELDS:
        definition["properties"].pop(name, None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "minihuman protocol", **schema}
