"""The version that every exported table states: readers of one version find its columns in every later one."""

import json
from pathlib import Path

from minihuman.dataset.table_catalogue import TABLE_VERSION, TABLES

FROZEN = json.loads((Path(__file__).parent / "table_version.json").read_text())


def test_no_column_goes_or_changes_its_type_or_unit_without_another_version():
    """After a change: raise the first number of TABLE_VERSION, and write the columns into the file anew."""
    if FROZEN["version"].partition(".")[0] != TABLE_VERSION.partition(".")[0]:
        raise AssertionError("write the columns of the new version into table_version.json")
    for table, columns in FROZEN["tables"].items():
        now = {column.name: [column.kind, column.unit] for column in TABLES[table]}
        assert {name: now.get(name) for name in columns} == columns, table
