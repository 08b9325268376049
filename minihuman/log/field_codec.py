"""Encodes a dataclass or a struct as a protobuf message, field by field, and decodes it."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Literal, Protocol, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from minihuman.errors import LogError


def require_one_of(allowed: tuple[str, ...], value: str) -> Any:
    """Return a word after checking that it belongs to a fixed vocabulary (the arguments of a ``Literal``).

    Raises:
        LogError: if the word is not in the vocabulary.
    """
    if value not in allowed:
        raise LogError(
            f"value {value!r} in the log is not one of {', '.join(allowed)}; the log is damaged, or a newer minihuman "
            "wrote it"
        )
    return value


class Codec(Protocol):
    """Encodes a value as a message and decodes it."""

    def encode(self, value: Any, /) -> Any:
        """Return the message that represents a value."""

    def decode(self, message: Any, /) -> Any:
        """Return the value that a message represents."""


@dataclass(frozen=True, slots=True)
class FieldCodec:
    """A field that has another name or another representation on the wire.

    Attributes:
        name: the field's name in the message.
        encode: converts the field's value for the message; None if it is written as it is.
        decode: converts the message's value back; None if it is read as it is.
        nested: the codec of a field that is itself a message; None for any other field.
    """

    name: str
    encode: Callable[[Any], Any] | None = None
    decode: Callable[[Any], Any] | None = None
    nested: Codec | None = None  # of a field that is itself a message


def nested(name: str, codec: Codec) -> FieldCodec:
    """Return the codec of a field that is itself a message, with a name on the wire."""
    return FieldCodec(name, codec.encode, codec.decode, codec)


def repeated(name: str, codec: Codec) -> FieldCodec:
    """Return the codec of a tuple that is a list of messages on the wire.

    Args:
        name: the field's name on the wire.
        codec: the codec of each element.
    """
    return FieldCodec(
        name, lambda values: list(map(codec.encode, values)), lambda messages: tuple(map(codec.decode, messages))
    )


def json_field(name: str, kind: Any = Any, *, default: str = "null") -> FieldCodec:
    """Return the codec of a field that is JSON text on the wire.

    Args:
        name: the field's name on the wire.
        kind: the type as which the JSON is decoded.
        default: the JSON text that replaces an empty text, as in logs older than the field.
    """
    return FieldCodec(name, to_json, lambda text: msgspec.json.decode(text or default, type=kind))


def to_json(value: Any) -> str:
    """Return a value as JSON text."""
    return msgspec.json.encode(value).decode()


class MessageCodec:
    """Encodes a dataclass or a msgspec struct field by field.

    A ``Literal`` is checked against its vocabulary, a repeated field is a tuple, and an absent optional field is None.

    Args:
        kind: the class of the values.
        message: the type of the messages.
        fields: the fields that differ on the wire, by their names in ``kind``.
    """

    def __init__(self, kind: type[Any], message: type[Message], fields: Mapping[str, FieldCodec] | None = None) -> None:
        hints = get_type_hints(kind)
        fields = fields or {}
        names = msgspec.structs.fields(kind) if issubclass(kind, msgspec.Struct) else dataclasses.fields(kind)
        self._names = tuple(definition.name for definition in names)
        codecs = {name: fields.get(name, FieldCodec(name)) for name in self._names}
        self._wire_names = tuple(codec.name for codec in codecs.values())
        self._kind = kind
        self._message = message
        self._from_message = _make_values_getter(self._wire_names)
        self._nested = {codec.name: codec.nested for codec in codecs.values() if codec.nested is not None}
        self._converted = {codec.name for codec in codecs.values() if codec.encode or codec.decode} - set(self._nested)
        # each by the field's index
        self._decoders: list[tuple[int, Callable[[Any], Any]]] = []
        self._vocabularies: list[tuple[int, tuple[str, ...]]] = []
        self._optional: list[tuple[int, str]] = []  # with the field's name on the wire
        encoders: dict[str, Callable[[Any], Any]] = {}
        for index, name in enumerate(self._names):
            encode = self._register_field(index, codecs[name], hints[name])
            if encode is not None:
                encoders[name] = encode
        self._build = _compile_message_builder(message, zip(self._names, self._wire_names, strict=True), encoders)

    def _register_field(self, index: int, codec: FieldCodec, hint: Any) -> Callable[[Any], Any] | None:
        """Register how the field at an index is decoded; return the function that encodes it, None if none is needed.

        Args:
            index: the field's index in the class.
            codec: the field's codec.
            hint: the field's type in the class.
        """
        descriptor = self._message.DESCRIPTOR.fields_by_name[codec.name]
        encode = codec.encode
        decode = codec.decode
        if decode is None and descriptor.default_value == []:  # a repeated field, in every release of protobuf
            decode = tuple
        if descriptor.has_presence and (descriptor.message_type is None or type(None) in get_args(hint)):
            self._optional.append((index, codec.name))
            encode = None if encode is None else _pass_none(encode)
            decode = None if decode is None else _pass_none(decode)
        if get_origin(hint) is Literal:
            self._vocabularies.append((index, get_args(hint)))
        if decode is not None:
            self._decoders.append((index, decode))
        return encode

    def encode(self, value: Any, /) -> Any:
        """Return the message that represents a value."""
        return self._build(value)

    def decode(self, message: Any, /) -> Any:
        """Return the value that a message represents.

        Raises:
            LogError: if a word in the message is outside its vocabulary.
        """
        values = list(self._from_message(message))
        for index, wire_name in self._optional:
            if not message.HasField(wire_name):
                values[index] = None
        for index, decode in self._decoders:
            values[index] = decode(values[index])
        for index, allowed in self._vocabularies:
            if values[index] not in allowed:
                require_one_of(allowed, values[index])
        return self._kind(*values)

    def decode_columns(self, columns: Any) -> tuple[list[Any], NDArray[np.bool_]]:
        """Decode n messages whose fields are columns (``MessageColumns`` with ``canonical``).

        Returns:
            The n values, and bool[n], whether ``encode`` surely gives back the same bytes. Where this is False, the
            value may differ from that of ``decode``.

        Raises:
            ValueError: if the bytes are not such messages.
        """
        is_sure = columns.is_canonical.copy()
        values_by_field: list[Any] = []
        vocabularies = {self._wire_names[index]: allowed for index, allowed in self._vocabularies}
        optional = {name for _, name in self._optional}
        for name in self._wire_names:
            field_values, field_is_sure = self._decode_column(name, columns[name], vocabularies.get(name, ()))
            is_present = columns[name].is_present
            is_sure &= field_is_sure | ~is_present
            if name in optional and not is_present.all():
                presence = is_present.tolist()
                field_values = [cell if present else None for cell, present in zip(field_values, presence, strict=True)]
            values_by_field.append(field_values)
        return list(map(self._kind, *values_by_field)), is_sure

    def _decode_column(self, name: str, column: Any, allowed: tuple[str, ...]) -> tuple[list[Any], Any]:
        """Return a field's n values, and bool[n], whether each is surely the one that ``decode`` returns.

        For a field that only ``decode`` can read, the values are placeholders, and none is sure.

        Args:
            name: the field's name on the wire.
            column: the field's column.
            allowed: the words that the field may have; empty if it may have any.
        """
        descriptor = self._message.DESCRIPTOR.fields_by_name[name]
        codec = self._nested.get(name)
        if isinstance(codec, MessageCodec):
            return codec.decode_columns(column.values)
        n_messages = len(column.is_present)
        is_plain = descriptor.message_type is None and descriptor.default_value != []
        if not is_plain or name in self._converted:
            return [()] * n_messages, np.zeros(n_messages, np.bool_)
        if descriptor.type != descriptor.TYPE_STRING:
            return column.values.tolist(), np.ones(n_messages, np.bool_)
        is_allowed = np.array([not allowed or text in allowed for text in column.values.categories])
        texts = [column.values.categories[code] for code in column.values.codes.tolist()]
        return texts, is_allowed[column.values.codes]


def _compile_message_builder(
    message: type[Message], names: Iterable[tuple[str, str]], encoders: Mapping[str, Callable[[Any], Any]]
) -> Callable[[Any], Any]:
    """Compile a function that builds a value's message, as dataclasses do: 1.6 us instead of 2.4.

    Args:
        message: the type of the messages.
        names: the names of each field in the value and in the message.
        encoders: the functions that encode the fields that are not written as they are, by their names in the value.
    """
    variables: dict[str, Any] = {"message": message}
    arguments = []
    for name, wire_name in names:
        if name in encoders:
            variables[f"encode_{name}"] = encoders[name]
            arguments.append(f"{wire_name}=encode_{name}(value.{name})")
        else:
            arguments.append(f"{wire_name}=value.{name}")
    build: Callable[[Any], Any] = eval(f"lambda value: message({', '.join(arguments)})", variables)
    return build


def _make_values_getter(names: Iterable[str]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a function that returns the attributes of these names as a tuple, even if there is only one name."""
    first, *other_names = names
    get = attrgetter(first, *other_names)
    if other_names:
        return get
    return lambda value: (get(value),)


def _pass_none(convert: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that converts any value but None, which it returns unchanged."""
    return lambda value: None if value is None else convert(value)


@dataclass(frozen=True, slots=True)
class CustomCodec:
    """Encodes a value as a message with two functions, for values and messages of different shapes."""

    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any]
