"""The differences of two protocols, field by field. Tables with names are compared by name, whatever their order."""

from collections.abc import Iterator
from typing import Any

from minihuman.builder.document import is_same_value
from minihuman.builder.messages import FieldDifference, Path


def list_differences(before: dict[str, Any], after: dict[str, Any]) -> Iterator[FieldDifference]:
    """Yield the fields in which the values of two protocols differ; a missing field has the value None."""
    yield from _list_value_differences(before, after, [])


def _list_value_differences(before: Any, after: Any, path: Path) -> Iterator[FieldDifference]:
    """Yield the differences of two values: of tables by key, of arrays of named tables by name, else of the whole.

    If named tables that both arrays have stand in another order, the lists of their names are a difference, too.

    Args:
        before: the value in the first protocol; None if it is missing.
        after: the value in the second protocol; None if it is missing.
        path: the path of both, with which the paths of the differences begin.
    """
    if is_same_value(before, after):
        return
    if isinstance(before, dict) and isinstance(after, dict):
        for key in dict.fromkeys([*before, *after]):
            yield from _list_value_differences(before.get(key), after.get(key), [*path, key])
        return
    names_before = _index_by_name(before)
    names_after = _index_by_name(after)
    if names_before is None or names_after is None:
        yield FieldDifference(path, before, after)
        return
    for name in dict.fromkeys([*names_before, *names_after]):
        number_before, table_before = names_before.get(name, (0, None))
        number, table_after = names_after.get(name, (number_before, None))  # a removed table keeps its old number
        yield from _list_value_differences(table_before, table_after, [*path, number])
    order_before = [name for name in names_before if name in names_after]
    order_after = [name for name in names_after if name in names_before]
    if order_before != order_after:
        yield FieldDifference(path, list(names_before), list(names_after))


def _index_by_name(content: Any) -> dict[str, tuple[int, dict[str, Any]]] | None:
    """Return the number (from 0) and the values of each table of an array, by the table's name.

    Return {} for None, a missing array, and None if the content is not an array of tables that all have names.
    """
    if content is None:
        return {}
    if not isinstance(content, list) or not all(isinstance(row, dict) and "name" in row for row in content):
        return None
    return {str(row["name"]): (number, row) for number, row in enumerate(content)}
