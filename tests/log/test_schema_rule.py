"""The schema version goes up when a change is not an addition: the messages of every frozen log are held to that."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet
from mcap.reader import make_reader

from minihuman.log.codec import DECODERS
from minihuman.log.names import SCHEMA_VERSION
from minihuman.log.topics import TOPICS, schema_bytes

Messages = dict[str, DescriptorProto]
SAME = [version for version, decode in DECODERS.items() if decode is DECODERS[SCHEMA_VERSION]]  # as are read today
FROZEN = Path(__file__).parents[1] / "golden"
GOLDEN = [log for version in SAME for log in sorted((FROZEN / f"v{version}").rglob("*.mcap"))]


def find_misread_fields(old: Messages, new: Messages) -> Iterator[str]:
    """Name what a reader of the one schema would misread in a log of the other: each field that is not the same."""
    for name in old.keys() & new.keys():
        now = {field.number: field for field in new[name].field}
        for field in old[name].field:
            if field.number not in now:
                yield f"{name}.{field.name} is gone"
            elif _identity(field) != _identity(now[field.number]):
                yield f"{name}.{field.name} is another field"


def _identity(field: FieldDescriptorProto) -> tuple[object, ...]:
    return field.name, field.type, field.label, field.type_name


def read_messages(schema: bytes) -> Messages:
    files = FileDescriptorSet.FromString(schema).file
    return {f"{file.package}.{one.name}": one for file in files for one in file.message_type}


def message(**numbers: int) -> Messages:
    fields = [FieldDescriptorProto(name=name, number=number) for name, number in numbers.items()]
    return {"Step": DescriptorProto(name="Step", field=fields)}


@pytest.mark.parametrize(
    ("old", "new", "misread"),
    [
        (message(action=1), message(action=1, reward=2), []),
        (message(action=1, reward=2), message(action=1), ["Step.reward is gone"]),
        (message(action=1), message(action=2), ["Step.action is gone"]),
        (message(action=1), message(reward=1), ["Step.action is another field"]),
    ],
)
def test_an_addition_is_no_new_version_and_any_other_change_is(old: Messages, new: Messages, misread: list[str]):
    assert list(find_misread_fields(old, new)) == misread


def test_every_version_has_a_frozen_log() -> None:
    assert {path.name for path in FROZEN.glob("v?")} == {f"v{version}" for version in DECODERS}


@pytest.mark.parametrize("log", GOLDEN, ids=lambda log: log.stem)
def test_nothing_that_a_frozen_log_holds_has_changed(log: Path) -> None:
    now = {name: one for topic in TOPICS for name, one in read_messages(schema_bytes(topic.message)).items()}
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    then = [read_messages(schema.data) for schema in summary.schemas.values() if schema.encoding == "protobuf"]
    assert any(names.keys() & now.keys() for names in then)
    assert [found for one in then for found in find_misread_fields(one, now)] == []
