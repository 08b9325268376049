"""The odd study in JavaScript: what the readers that its users take make of tables and logs is what was logged.

`read_tables.mjs` reads a file with one of the packages, in a folder that npm fills.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pyarrow.parquet
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.reader import make_reader

from minihuman.dataset.selection import Selection
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_columns import is_time
from minihuman.dataset.table_types import unguard_text
from minihuman.dataset.wide_integers import MAX_EXACT_INTEGER, WIDE_INTEGERS
from minihuman.exporters.exporter import export_study
from tests.export.odd import record_odd_study
from tests.machine import REQUIREMENTS, do_without, needs

pytestmark = [pytest.mark.program, pytest.mark.nightly, needs("node", "npm")]
PACKAGES = (
    *("papaparse@5.7.1", "d3-dsv@3.0.2", "hyparquet@1.33.0", "hyparquet-compressors@1.1.2"),
    *("parquet-wasm@0.8.0", "apache-arrow@21.2.0"),
    *("@mcap/core@2.2.2", "@mcap/support@1.1.0", "@mcap/nodejs@1.0.2", "protobufjs@8.8.1"),
)
INSTALL = ("npm", "install", "--ignore-scripts", "--no-audit", "--no-fund", "--fetch-retries=1")
PATIENCE_S = 600
SCRIPT = Path(__file__).with_name("read_tables.mjs")
PRINT = """
const plain = (_, cell) => (typeof cell === "bigint" ? { integer: cell.toString() } : cell);
console.log(JSON.stringify(rows, plain));
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return record_odd_study(tmp_path_factory.mktemp("odd"))


@pytest.fixture(scope="module")
def exported(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("exported")
    for name in ("csv", "parquet"):
        export_study(name, study, out / name, Selection())
    return out


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("javascript")
    done = subprocess.run([*INSTALL, *PACKAGES], cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S)
    if "ENOTFOUND" in done.stderr or "ECONNREFUSED" in done.stderr or "ETIMEDOUT" in done.stderr:
        do_without(REQUIREMENTS["npm"])
    assert done.returncode == 0, done.stderr
    shutil.copy(SCRIPT, folder)
    return folder


def read_rows(packages, reader, path):
    command = ["node", str(packages / SCRIPT.name), reader, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    return json.loads(done.stdout)


def read_table(exported, name):
    """Return the reference: a table's cells as pyarrow reads them, by column."""
    return pyarrow.parquet.read_table(exported / "parquet" / f"{name}.parquet").to_pydict()


def list_tables(exported):
    return sorted(path.stem for path in (exported / "parquet").glob("*.parquet"))


def find_times(name):
    return {column.name for column in TABLES.get(name, ()) if is_time(column)}


def read_integer(cell):
    return int(cell["integer"]) if isinstance(cell, dict) and "integer" in cell else cell


@pytest.mark.parametrize("reader", ["hyparquet", "hyparquet-microseconds", "parquet-wasm"])
def test_parquet_keeps_every_cell(packages, exported, reader):
    compared = 0
    for name in list_tables(exported):
        rows = read_rows(packages, reader, exported / "parquet" / f"{name}.parquet")
        for column, expected in read_table(exported, name).items():
            actual = [read_integer(row[column]) for row in rows]
            if column in find_times(name):
                expected = [read_time(reader, cell) for cell in expected]
            assert actual == expected, f"{name}.{column}"
            compared += len(expected)
    print(f"{reader}: {compared:,} cells")
    assert compared > 1_000


def read_time(reader, cell):
    """Return a time as a reader is known to give it: hyparquet's Date has no microseconds, Arrow has milliseconds."""
    microseconds = pd.Timestamp(cell).value // 1000
    if reader == "hyparquet":
        return {"milliseconds": microseconds // 1000}
    return microseconds if reader == "hyparquet-microseconds" else microseconds / 1000


def test_the_readmes_lines_for_csv_keep_every_cell(packages, exported):
    folder = exported / "csv"
    (code,) = re.findall(r"```js\n(.*?)```", (folder / "README.md").read_text(), re.DOTALL)
    compared = 0
    for name in list_tables(exported):
        (packages / "lines.mjs").write_text(code.replace("episodes", name) + PRINT)
        command = ["node", str(packages / "lines.mjs")]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True, timeout=PATIENCE_S)
        rows = json.loads(done.stdout)
        for column, expected in read_table(exported, name).items():
            actual = [read_csv_cell(row[column]) for row in rows]
            if column in find_times(name):
                actual = [pd.Timestamp(cell).floor("us") for cell in actual]
            assert actual == expected, f"{name}.{column}"
            assert all(isinstance(row[column], dict | None) for row in rows) == (
                column in WIDE_INTEGERS or set(expected) == {None}
            ), f"{name}.{column}"
            compared += len(expected)
    print(f"papaparse: {compared:,} cells")
    assert compared > 1_000


def read_csv_cell(cell):
    if isinstance(cell, str):
        return unguard_text(cell)
    return read_integer(cell)


def test_types_that_are_guessed_lose_what_the_docs_say(packages, exported):
    seed = read_table(exported, "segments")["study_seed"][0]
    assert seed > MAX_EXACT_INTEGER
    guessed = {
        reader: read_rows(packages, reader, exported / "csv" / "segments.csv")[0] for reader in ("d3-auto", "papa-auto")
    }
    for reader, row in guessed.items():
        assert (row["study"], row["study_version"]) == (7, 1.1), reader
    assert float(guessed["d3-auto"]["study_seed"]) == float(seed)
    assert guessed["d3-auto"]["study_seed"] != seed
    assert guessed["papa-auto"]["study_seed"] == str(seed)


def test_a_logs_messages_have_every_field(packages, study):
    compared = 0
    for path in sorted(study.rglob("*.mcap")):
        actual = read_rows(packages, "mcap", path)
        with path.open("rb") as file:
            expected = [describe_message(*entry) for entry in make_reader(file).iter_messages()]
        assert len(actual) == len(expected)
        for message, reference in zip(actual, expected, strict=True):
            times = [read_integer(message[name]) for name in ("logTime", "publishTime")]
            assert (message["topic"], *times, join_times(message["fields"])) == reference
            compared += count_fields(message["fields"])
    print(f"@mcap/core: {compared:,} fields")
    assert compared > 1_000


def describe_message(schema, channel, message):
    """Return topic, times and fields, as Python's Protocol Buffers write them in JSON."""
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    decoded = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString(message.data)
    fields = json_format.MessageToDict(
        decoded, preserving_proto_field_name=True, use_integers_for_enums=True, descriptor_pool=pool
    )
    return channel.topic, message.log_time, message.publish_time, fields


def join_times(fields):
    """Write the wall-clock times that protobufjs has in two numbers as Python's Protocol Buffers do, in nanoseconds."""
    if isinstance(fields, list):
        return [join_times(field) for field in fields]
    if not isinstance(fields, dict):
        return fields
    if fields and fields.keys() <= {"seconds", "nanos"}:
        time = pd.Timestamp(int(fields.get("seconds", 0)) * 10**9 + fields.get("nanos", 0), tz="UTC")
        return f"{time:%Y-%m-%dT%H:%M:%S}.{time.value % 10**9:09d}Z"
    return {name: join_times(field) for name, field in fields.items()}


def count_fields(fields):
    if isinstance(fields, dict):
        return sum(map(count_fields, fields.values()))
    if isinstance(fields, list):
        return sum(map(count_fields, fields))
    return 1
