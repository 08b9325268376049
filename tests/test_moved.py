"""What plug-ins, docs and saved files named before a module moved still works for one version, with a warning."""

import csv
import pickle
import warnings
from importlib import import_module
from pathlib import Path

import pytest

from minihuman.moved import MOVED_MODULES, find_moved

TABLE = Path(__file__).with_name("moved_names.tsv")  # what each module had, before it moved, under public names
NAMELESS = {"minihuman.experiment.activities", "minihuman.experiment.activities.questions"}  # packages of modules


def _moved_names() -> list[tuple[str, str]]:
    with TABLE.open(encoding="utf-8", newline="") as file:
        return [(row["module"], row["name"]) for row in csv.DictReader(file, delimiter="\t")]


@pytest.mark.parametrize("old_module", MOVED_MODULES)
def test_every_name_of_a_moved_module_works_and_says_where_it_is_now(old_module):
    module = import_module(old_module)
    for name in [name for owner, name in _moved_names() if owner == old_module]:
        new_module, contents = find_moved(old_module, name)
        with pytest.warns(DeprecationWarning, match=f"{old_module}.{name} is now {new_module}.{name};"):
            assert getattr(module, name) is contents


def test_the_table_has_names_of_every_module_that_had_any():
    assert {module for module, _ in _moved_names()} == MOVED_MODULES.keys() - NAMELESS


@pytest.mark.parametrize(
    ("old_module", "name"),
    [("minihuman.experiment.activities.activity", "PartEnding"), ("minihuman.operating_system", "hash_file")],
    ids=["a module that is gone", "a module that is still there"],
)
def test_the_warning_points_at_who_uses_the_old_name(old_module, name):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        getattr(import_module(old_module), name)
    assert [warning.filename for warning in caught] == [__file__]


def test_what_was_pickled_under_an_old_name_is_read():
    old = b"cminihuman.experiment.activities.correction\nCorrectionPlan\n."
    with pytest.warns(DeprecationWarning, match="CorrectionPlan is now"):
        assert pickle.loads(old).__name__ == "CorrectionPlan"


def test_a_name_that_a_moved_module_never_had_is_no_attribute():
    with pytest.raises(ImportError, match="cannot import name 'Nothing'"):
        from minihuman.experiment.activities.play import Nothing  # noqa: F401
    with pytest.raises(ModuleNotFoundError):
        import_module("minihuman.experiment.activities.nothing")


def test_a_name_that_a_module_which_is_still_there_never_had_is_no_attribute():
    with pytest.raises(AttributeError, match="has no attribute 'write_somehow'"):
        import_module("minihuman.operating_system").write_somehow  # noqa: B018
