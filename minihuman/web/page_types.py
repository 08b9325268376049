"""The page's message types, generated from `messages.py` and `screen_types.py`.

    python -m minihuman.web.page_types     # writes page/messages.d.ts, which is committed

A field that has a default is optional where the page sends it; the server sends every field.
"""

import dataclasses
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

import msgspec

from minihuman.experiment.machine.activity import find_kind, list_kinds
from minihuman.experiment.machine.screens import AnswerWidget
from minihuman.web import messages
from minihuman.web.screen_types import PageType, PlayValues, ScreenValues

PATH = Path(__file__).with_name("page") / "messages.d.ts"
FROM_PAGE = messages.Hello | messages.NumberedMessage | messages.PageAck | messages.Ping | messages.Farewell
UNNUMBERED = messages.Welcome | messages.Refusal | messages.ServerAck | messages.Pong
ALIASES: dict[str, Any] = {  # types that have a name in the page, too
    "BrowserFacts": messages.BrowserFacts,
    "Texts": messages.Texts,
    "PageMessage": messages.PageMessage,
    "FromPage": FROM_PAGE,
    "UnnumberedMessage": UNNUMBERED,
    "ServerMessage": messages.ServerMessage,
    "WorldState": messages.WorldState,
    "WorldPosition": messages.WorldPosition,
    "ScreenValues": ScreenValues,
    "AnswerWidget": AnswerWidget,
}
_HEAD = """\
// What the page and the server send each other. Generated: edit minihuman/web/messages.py or screen_types.py, then run
// `python -m minihuman.web.page_types`.
"""
_PRIMITIVES: dict[Any, str] = {
    int: "number",
    float: "number",
    str: "string",
    bool: "boolean",
    bytes: "string",  # Base64
    NoneType: "null",
    Any: "unknown",
}


@dataclasses.dataclass(frozen=True, slots=True)
class _Field:
    """A field of an interface."""

    name: str
    annotation: Any
    is_optional: bool


class _Formatter:
    """Formats types as TypeScript, together with the types that they refer to."""

    def __init__(self, aliases: dict[str, Any], sent_by_page: Any) -> None:
        self._aliases = aliases
        self._interfaces: dict[type, str] = {}  # by type, in the order in which they were found
        self._sent_by_page = _list_structs(sent_by_page)

    def format(self) -> str:
        """Return the TypeScript declarations of all types."""
        aliases = [f"export type {name} = {self._format_alias(form)};\n" for name, form in self._aliases.items()]
        return "".join(aliases) + "".join("\n" + text for text in self._interfaces.values())

    def _format_alias(self, form: Any) -> str:
        if form is AnswerWidget:
            return " | ".join(
                f'({{ form: "{widget.__name__}" }} & {self._format_type(widget)})' for widget in get_args(form)
            )
        return self._format_structure(form)

    def _format_type(self, annotation: Any) -> str:
        """Return the TypeScript of a type within a declaration: its name, if it has one, or its structure."""
        for name, form in self._aliases.items():
            if annotation == form:
                return name
        return self._format_structure(annotation)

    def _format_structure(self, annotation: Any) -> str:
        """Return the TypeScript of a type that is no alias: its structure, or the name of its interface."""
        origin = get_origin(annotation)
        arguments = get_args(annotation)
        if annotation in _PRIMITIVES:
            return _PRIMITIVES[annotation]
        if origin is Annotated:
            plain_form, *extras = arguments
            for extra in extras:
                if isinstance(extra, PageType):
                    return self._format_type(extra.form)
            return self._format_type(plain_form)
        if origin is NotRequired:
            return self._format_type(arguments[0])
        if origin is Literal:
            return " | ".join(f'"{word}"' for word in arguments)
        if origin in (UnionType, Union):
            return self._format_union(arguments)
        if origin is dict:
            key_type, value_type = map(self._format_type, arguments)
            return f"Record<{key_type}, {value_type}>"
        if origin is list:
            element_type = _enclose(self._format_type(arguments[0]))
            return f"{element_type}[]"
        if origin is tuple:
            return self._format_tuple(arguments)
        return self._name_interface(annotation)

    def _format_union(self, arguments: tuple[Any, ...]) -> str:
        alternatives: list[str] = []
        for argument in arguments:
            alternatives += self._format_type(argument).split(" | ")
        return " | ".join(dict.fromkeys(alternatives))

    def _format_tuple(self, arguments: tuple[Any, ...]) -> str:
        if arguments[1:] == (Ellipsis,):
            return f"{_enclose(self._format_type(arguments[0]))}[]"
        types = [self._format_type(argument) for argument in arguments]
        return f"[{', '.join(types)}]"

    def _name_interface(self, form: type) -> str:
        """Return the name of a class's interface, after adding the interface if it is new."""
        if form not in self._interfaces:
            self._interfaces[form] = ""  # before its fields, which may refer to it
            self._interfaces[form] = self._format_interface(form)
        return form.__name__

    def _format_interface(self, form: type) -> str:
        """Return the declaration of a class as an interface, with the first paragraph of its docstring."""
        summary = (inspect.getdoc(form) or "").partition("\n\n")[0].replace("\n", " ")
        lines = [f"/** {summary} */", f"export interface {form.__name__} {{"]
        if issubclass(form, msgspec.Struct):
            config = form.__struct_config__
            if config.tag is not None:
                lines.append(f'  {config.tag_field}: "{config.tag}";')
        may_lack_fields = form in self._sent_by_page or is_typeddict(form)
        for field in _list_fields(form):
            mark = "?" if field.is_optional and may_lack_fields else ""
            lines.append(f"  {field.name}{mark}: {self._format_type(field.annotation)};")
        return "\n".join([*lines, "}", ""])


def _enclose(text: str) -> str:
    """Return the TypeScript of a type, in parentheses if it is a union."""
    if " | " in text:
        return f"({text})"
    return text


def _list_fields(form: type) -> Iterator[_Field]:
    """Yield the fields of a struct, a typed dictionary or a dataclass.

    Raises:
        TypeError: if the class is none of these.
    """
    if issubclass(form, msgspec.Struct):
        for field in msgspec.structs.fields(form):
            yield _Field(field.encode_name, field.type, not field.required)
    elif is_typeddict(form):
        parts = [form]
        if form is PlayValues:
            parts += _load_page_fields()
        for part in parts:
            for name, annotation in get_type_hints(part, include_extras=True).items():
                yield _Field(name, annotation, get_origin(annotation) is NotRequired)
    elif dataclasses.is_dataclass(form):
        hints = get_type_hints(form, include_extras=True)
        for own_field in dataclasses.fields(form):
            yield _Field(own_field.name, hints[own_field.name], False)  # the page always gets it
    else:
        raise TypeError(f"{form!r} is not a type that a page can have")


def _load_page_fields() -> list[type]:
    """Load the typed dictionaries that block kinds add to the play screen."""
    kinds = list_kinds(lambda kind: bool(kind.page_fields))
    references = [find_kind(name).page_fields.partition(":") for name in kinds]  # of the form "module:class"
    return [getattr(import_module(module), name) for module, _, name in references]


def _list_structs(annotation: Any) -> set[type]:
    """Return the structs that a type refers to directly or indirectly, including itself."""
    structs: set[type] = set()
    to_do = [annotation]
    while to_do:
        form = to_do.pop()
        if isinstance(form, type) and issubclass(form, msgspec.Struct) and form not in structs:
            structs.add(form)
            to_do += [field.annotation for field in _list_fields(form)]
        to_do += get_args(form)
    return structs


def write_types(aliases: dict[str, Any], sent_by_page: Any) -> str:
    """Return the TypeScript declarations of types and of the types that they refer to.

    Args:
        aliases: the types by name; each is declared under its name.
        sent_by_page: the union of the messages that a page sends; fields of these with a default are optional.
    """
    return _Formatter(aliases, sent_by_page).format()


def format_page_types() -> str:
    """Return the text of `page/messages.d.ts`."""
    return _HEAD + "\n" + write_types(ALIASES, FROM_PAGE)


if __name__ == "__main__":
    PATH.write_text(format_page_types(), encoding="utf-8", newline="\n")
