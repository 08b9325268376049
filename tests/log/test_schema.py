"""The .proto is the one source: the committed Python, its stubs and the documentation say the same."""

import ast
import re
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet

from minihuman.experiment.machine.activity import list_built_in_kinds
from minihuman.log import proto
from minihuman.log.codec import list_activity_topics
from minihuman.log.topics import RARE_TOPICS, TOPICS, schema_bytes

FOLDER = Path(proto.__file__).parent
ALL = (*TOPICS, *RARE_TOPICS, *list_activity_topics(list_built_in_kinds()))
FILES = ("minihuman_v1", "minihuman_agent_v1")
DOCS = Path(__file__).parents[2] / "docs" / "log-format.md"


@pytest.fixture(scope="module", params=FILES)
def generated(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FileDescriptorProto:
    protoc = pytest.importorskip("grpc_tools.protoc", reason="grpcio-tools (extra `test`) regenerates the messages")
    out = tmp_path_factory.mktemp("proto") / "messages.bin"
    assert protoc.main(["protoc", f"-I{FOLDER}", f"--descriptor_set_out={out}", f"{request.param}.proto"]) == 0
    (file,) = FileDescriptorSet.FromString(out.read_bytes()).file
    return file


def test_the_committed_python_is_what_the_proto_generates(generated: FileDescriptorProto) -> None:
    code = ast.parse((FOLDER / f"{Path(generated.name).stem}_pb2.py").read_text())
    committed = [
        node.value for node in ast.walk(code) if isinstance(node, ast.Constant) and isinstance(node.value, bytes)
    ]
    assert FileDescriptorProto.FromString(committed[0]) == _without_json_names(generated)


@pytest.mark.parametrize("name", FILES)
def test_the_committed_python_asks_for_no_newer_protobuf_than_is_admitted(name: str) -> None:
    made_by = re.search(r"Protobuf Python Version: ([\d.]+)", (FOLDER / f"{name}_pb2.py").read_text())
    admitted = re.search(r'"protobuf>=([\d.]+)"', (DOCS.parents[1] / "pyproject.toml").read_text())
    assert made_by
    assert admitted
    assert _version(made_by[1]) <= _version(admitted[1]), "generate with grpcio-tools 1.66.2"


def _version(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(".")))


def _without_json_names(file: FileDescriptorProto) -> FileDescriptorProto:
    """protoc adds these to what it hands to others, not to what it embeds in Python."""
    for message in file.message_type:
        for field in message.field:
            field.ClearField("json_name")
    return file


def test_the_committed_stubs_name_every_message_and_field(generated: FileDescriptorProto) -> None:
    stubs = ast.parse((FOLDER / f"{Path(generated.name).stem}_pb2.pyi").read_text())
    named = {node.name: _annotated(node) for node in stubs.body if isinstance(node, ast.ClassDef)}
    assert named == {message.name: _fields(message) for message in generated.message_type}


def _annotated(node: ast.ClassDef) -> set[str]:
    names = {
        item.target.id for item in node.body if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
    }
    return {name for name in names if not name.endswith("_FIELD_NUMBER")}


def _fields(message: DescriptorProto) -> set[str]:
    return {field.name for field in message.field}


@pytest.mark.parametrize("topic", ALL, ids=lambda topic: topic.name)
def test_a_topics_schema_holds_all_it_needs(topic: object) -> None:
    message = topic.message  # type: ignore[attr-defined]
    files = FileDescriptorSet.FromString(schema_bytes(message)).file
    known = {f".{file.package}.{kind.name}" for file in files for kind in file.message_type}
    needed = {
        field.type_name
        for file in files
        for kind in file.message_type
        for field in kind.field
        if field.type == field.TYPE_MESSAGE
    }
    assert needed <= known
    assert f".{message.DESCRIPTOR.full_name}" in known


def test_the_documentation_has_a_row_for_every_topic() -> None:
    rows = dict(re.findall(r"^\| `(/\S+)` \| `(\S+)` \|", DOCS.read_text(), re.MULTILINE))
    assert rows == {topic.name: topic.message.DESCRIPTOR.full_name for topic in ALL}
