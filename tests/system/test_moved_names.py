"""Names that have moved work where they were, with a warning that says where they are now."""

from importlib import import_module

import pytest

from minihuman.moved import MOVED_NAMES

MOVED = [(old, name, new) for old, names in MOVED_NAMES.items() for name, new in names.items()]


@pytest.mark.parametrize(("old", "name", "new"), MOVED, ids=[f"{old}.{name}" for old, name, _ in MOVED])
def test_a_moved_name_is_found_where_it_was_with_a_warning(old: str, name: str, new: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"{name} has moved; import it from {new}") as warned:
        moved = getattr(import_module(old), name)
    assert moved is getattr(import_module(new), name)
    assert warned[0].filename == __file__


def test_a_name_that_never_was_is_no_moved_one() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'write_somehow'"):
        import_module("minihuman.operating_system").write_somehow  # noqa: B018
