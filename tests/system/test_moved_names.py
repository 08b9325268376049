"""Names that have moved work where they were, with a warning that says where they are now."""

import csv
from importlib import import_module
from pathlib import Path

import pytest

from minihuman.moved import MOVED_NAMES, find_moved

TABLE = Path(__file__).parents[1] / "moved_names.tsv"  # what each module had, before it moved, under public names
MOVED = [(old, name, new) for old, names in MOVED_NAMES.items() for name, new in names.items()]


@pytest.mark.parametrize(("old", "name", "new"), MOVED, ids=[f"{old}.{name}" for old, name, _ in MOVED])
def test_a_moved_name_is_found_where_it_was_with_a_warning(old: str, name: str, new: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"{old}.{name} is now {new}.{name};") as warned:
        moved = getattr(import_module(old), name)
    assert moved is getattr(import_module(new), name)
    assert warned[0].filename == __file__


def test_every_name_of_storage_is_found_in_the_module_where_it_was() -> None:
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = [(row["module"], row["name"]) for row in csv.DictReader(file, delimiter="\t")]
    assert rows
    for old_module, name in rows:
        new_module, contents = find_moved(old_module, name)
        with pytest.warns(DeprecationWarning, match=f"{old_module}.{name} is now {new_module}.{name};"):
            assert getattr(import_module(old_module), name) is contents


def test_a_name_that_never_was_is_no_moved_one() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'write_somehow'"):
        import_module("minihuman.operating_system").write_somehow  # noqa: B018
