"""A kind's activity is pure: what its folder has for logs, tables, windows and pages is loaded by those alone."""

import subprocess
import sys

import pytest

from minihuman.experiment.machine.activity import find_kind, list_built_in_kinds

LOADS_EVERY_KIND = """
import sys
from minihuman.experiment.machine.activity import find_kind, list_built_in_kinds
from minihuman.experiment.machine.session import SessionMachine
for name in list_built_in_kinds():
    find_kind(name)
heavy = {"google.protobuf", "mcap", "pandas", "pyarrow", "duckdb", "matplotlib", "pygame", "starlette"}
print(sorted(heavy & {*sys.modules}))
"""


@pytest.mark.program
def test_a_session_with_every_kind_loads_no_log_table_window_or_server():
    run = subprocess.run([sys.executable, "-c", LOADS_EVERY_KIND], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.program
def test_worlds_load_no_activity():
    code = "import sys, minihuman.worlds.catalogue; print([name for name in sys.modules if 'activities' in name])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize("name", list_built_in_kinds())
def test_what_a_kind_names_is_in_its_folder_or_one_that_it_shares(name):
    kind = find_kind(name)
    named = (kind.messages, kind.tables, kind.page_fields, kind.measures, kind.report, kind.simulator)
    assert all(path.startswith("minihuman.activities.") for path in named if path)
    assert kind.activity.__module__.startswith("minihuman.activities.")
