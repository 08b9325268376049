"""The log's rows. A laboratory generates its messages with protoc; this one describes its only message itself."""

from dummy_lab.events import Tapped
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from minihuman.ext import EventRow
from minihuman.log.topics import Topic

_FILE = FileDescriptorProto(name="dummy_lab.proto", package="dummy_lab", syntax="proto3")
_MESSAGE = _FILE.message_type.add(name="Tapped")
for _number, _name in enumerate(("t_ns", "part", "tap"), start=1):
    _MESSAGE.field.add(name=_name, number=_number, type="TYPE_INT64", label="LABEL_OPTIONAL")
_POOL = DescriptorPool()
_POOL.Add(_FILE)

TAP_TOPIC = "/dummy_lab/tap"
TAPPING_ROWS = (EventRow(Tapped, Topic(TAP_TOPIC, GetMessageClass(_POOL.FindMessageTypeByName("dummy_lab.Tapped")))),)
