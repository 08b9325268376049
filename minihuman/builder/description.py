"""A protocol's file as the builder's page shows it: its parts, the order of each group, and its mistakes with lines."""

import re
import tomllib
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from minihuman.admin.protocol_file import list_named_worlds, read_protocol
from minihuman.builder.document import NotEditableError, TomlDocument, format_path
from minihuman.builder.messages import Lane, Mistake, Part, Pay
from minihuman.builder.toml_spans import Steps
from minihuman.dataset.selection import check_exclusion_measures
from minihuman.errors import MinihumanError
from minihuman.experiment.protocol.aliases import use_current_names
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.protocol.validation_errors import InvalidFieldsError
from minihuman.trust import admit_worlds

_PART_KINDS = {"blocks": "play", "pages": "page", "questions": "questions", "activities": "activity", "orders": "order"}
_TABLES_WITH_KIND = ("blocks", "activities")  # tables with a field that says the kind
_STEP = re.compile(r"\.?([^.\[\]]+)|\[(\d+)\]")
# between the file's name and the message of an error: ":12: $.blocks[1].episodes: "
_FIELD_PREFIX = re.compile(r"(?::(?P<line>\d+))?:\s*(?P<path>\$[\w.\[\]-]*)?:?\s*")
_BLOCK_NAME = re.compile(r"block '(?P<name>[^']*)'")


def read_values(content: bytes) -> tuple[str, dict[str, Any]]:
    """Decode a file's bytes; return its text and its values, which are {} if it is not valid TOML."""
    text = content.decode("utf-8-sig", "replace")
    try:
        return text, tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError):
        return text, {}


def is_trusted(tree: dict[str, Any], folder: Path) -> bool:
    """Return whether the user trusts all Python modules and files that the worlds of a protocol would load.

    Args:
        tree: the protocol's values.
        folder: the folder of the protocol.
    """
    return not admit_worlds(list_named_worlds(tree), folder.resolve(), False)  # asks only, and trusts nothing


def check_file(path: Path, content: bytes) -> tuple[Protocol | None, list[Mistake]]:
    """Check a protocol and the files that it names; return it with [], or None with the mistakes that were found.

    Args:
        path: the protocol's file.
        content: the bytes of this file.
    """
    source = str(path)
    try:
        decode_protocol(content, source)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # of old names, which `check` reports
            protocol = read_protocol(path)
        check_exclusion_measures(protocol.exclusions, source)
    except MinihumanError as error:
        return None, list_mistakes(error, source, content)
    return protocol, []


def list_mistakes(error: MinihumanError, source: str, content: bytes) -> list[Mistake]:
    """Return the mistakes that an error names, each with its field and line.

    Args:
        error: the error of reading or checking a protocol.
        source: the protocol's path, with which the lines of the error's text may begin.
        content: the bytes of the protocol's file.
    """
    text, tree = read_values(content)
    try:
        document = TomlDocument.parse(text)
    except NotEditableError as syntax_error:
        return [Mistake([], syntax_error.line, str(syntax_error))]
    if isinstance(error, InvalidFieldsError):
        places = [(parse_path(path), message) for path, message in error.field_errors]
    else:
        lines = getattr(error, "mistakes", ()) or (str(error),)
        places = [_split_message(line, source, tree) for line in lines]
    return [Mistake(list(path), document.find_line(path), message) for path, message in places]


def _split_message(line: str, source: str, tree: Mapping[str, Any]) -> tuple[Steps, str]:
    """Split a line of an error into the path of the field or block that it names, () if none, and the message.

    Args:
        line: the line, such as "study.toml:12: $.blocks[1].episodes: is 0".
        source: the protocol's path, with which the line may begin.
        tree: the protocol's values, in which a block that the message names is looked up.
    """
    line_without_source = line.removeprefix(source)
    prefix = _FIELD_PREFIX.match(line_without_source)
    if prefix is None:
        return (), line
    message = line_without_source[prefix.end() :]
    if prefix["path"]:
        return parse_path(prefix["path"].rstrip(".")), message
    block = _BLOCK_NAME.match(message)
    for number, row in enumerate(_list_rows(tree, "blocks")):
        if block is not None and row.get("name") == block["name"]:
            return ("blocks", number), message
    return (), message or line


def parse_path(path: str) -> Steps:
    """Parse a path as errors write it, "$.blocks[1].episodes", into its steps, ("blocks", 1, "episodes")."""
    return tuple(name or int(number) for name, number in _STEP.findall(path.removeprefix("$")))


def list_parts(tree: dict[str, Any], document: TomlDocument | None) -> list[Part]:
    """Return the parts of a protocol, table by table.

    Args:
        tree: the protocol's values.
        document: the file with the positions of its tables; None if it cannot be parsed, so that each line is 1.
    """
    lanes = list_lanes(tree)
    parts = []
    for table, usual_kind in _PART_KINDS.items():
        for number, row in enumerate(_list_rows(tree, table)):
            path: Steps = (table, number)
            name = str(row.get("name", ""))
            kind = str(row.get("kind", usual_kind)) if table in _TABLES_WITH_KIND else usual_kind
            line = document.find_line(path) if document else 1
            title = str(row.get("title", ""))
            parts.append(Part(name, kind, list(path), title, _list_uses(tree, lanes, name), line))
    return parts


def _list_uses(tree: dict[str, Any], lanes: list[Lane], part_name: str) -> list[str]:
    """Return the names of the groups and orders that list a part or put it in another part's place, each once.

    Args:
        tree: the protocol's values, from which the orders come.
        lanes: the protocol's lanes, from which the groups come.
        part_name: the name of the part.
    """
    groups = [lane.group for lane in lanes if part_name in lane.parts or part_name in lane.replaced.values()]
    orders = [str(order.get("name")) for order in _list_rows(tree, "orders") if part_name in _list_ordered(order)]
    return list(dict.fromkeys([*groups, *orders]))


def _list_ordered(order: Mapping[str, Any]) -> list[str]:
    """Return the names of the parts of an [[orders]] table, those in its nested lists included."""
    units = order.get("parts")
    if not isinstance(units, list):
        return []
    return [str(part) for unit in units for part in (unit if isinstance(unit, list) else [unit])]


def list_lanes(tree: dict[str, Any]) -> list[Lane]:
    """Return a lane for each group and session: the parts that the file lists there, in order."""
    lanes = []
    for number, group in enumerate(_list_rows(tree, "groups")):
        replaced = {str(part): str(substitute) for part, substitute in _get_table(group, "replace_parts").items()}
        name = str(group.get("name", ""))
        for session_number, session in enumerate(_list_rows(tree, "sessions")):
            parts = _list_names(session.get("parts"))
            lanes.append(
                Lane(name, str(session.get("name", "")), parts, ["sessions", session_number, "parts"], replaced)
            )
        if not tree.get("sessions"):
            field = "parts" if "parts" in group else "blocks"
            lanes.append(Lane(name, "", _list_names(group.get(field)), ["groups", number, field], replaced))
    return lanes


def describe_pay(tree: dict[str, Any]) -> Pay | None:
    """Return the payment that the table [bonus] states; None if it is missing, or an amount is not a number."""
    bonus = _get_table(tree, "bonus")
    numbers = {name: bonus.get(name) for name in ("base", "per_point", "most")}
    if not bonus or not all(isinstance(number, int | float | None) for number in numbers.values()):
        return None
    most = numbers["most"]
    return Pay(
        str(bonus.get("currency", "")),
        float(numbers["base"] or 0),
        float(numbers["per_point"] or 0),
        None if most is None else float(most),
    )


def list_old_names(tree: dict[str, Any], document: TomlDocument) -> list[Mistake]:
    """Return a mistake for each field and value that has its name of an earlier version; the forms do not show these.

    Args:
        tree: the protocol's values.
        document: the protocol's file, which has the lines of the mistakes.
    """
    renamed = use_current_names(tree).renamed
    places = [(parse_path(path), message) for path, message in renamed]
    return [Mistake(list(path), document.find_line(path), message) for path, message in places]


def list_lines(document: TomlDocument) -> dict[str, int]:
    """Return the line of every field and table of a file, from 1, by its path as text: "blocks[1].episodes"."""
    lines = {}
    position = 0
    line = 1
    for path, begin in sorted(document.spans.positions().items(), key=lambda place: place[1]):
        line += document.text.count("\n", position, begin)
        position = begin
        lines[format_path(path)] = line
    return lines


def _list_rows(tree: Mapping[str, Any], table: str) -> list[dict[str, Any]]:
    """Return the tables of the array ``table`` of a protocol's values; [] if there is something else, or nothing."""
    rows = tree.get(table)
    if not isinstance(rows, list):
        return []
    return [row for row in rows if isinstance(row, dict)]


def _get_table(tree: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the table ``name`` of a protocol's values; {} if there is something else, or nothing."""
    table = tree.get(name)
    return table if isinstance(table, dict) else {}


def _list_names(content: object) -> list[str]:
    """Return the texts in a list, without elements of other types; [] if the content is not a list."""
    if not isinstance(content, list):
        return []
    return [name for name in content if isinstance(name, str)]
