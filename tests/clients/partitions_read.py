"""Daft and Spark read every partitioned table, with study and participant. Without minihuman, with a Java runtime."""

import json
import statistics
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import daft
from pyspark.sql import SparkSession

Rows = list[dict[str, Any]]


def read_with_daft(table: Path) -> Rows:
    """Read a table's study, participant and, of steps, time."""
    frame = daft.read_parquet(f"{table}/**/*.parquet", hive_partitioning=True)
    return frame.select(*_columns(table)).to_pylist()


def read_with_spark(table: Path) -> Rows:
    """Read the same with Spark."""
    spark = SparkSession.builder.master("local[1]").config("spark.ui.enabled", "false").getOrCreate()
    return [row.asDict() for row in spark.read.parquet(str(table)).select(*_columns(table)).collect()]


def _columns(table: Path) -> list[str]:
    return ["study", "participant", "session", *(["t_s"] if table.name == "steps" else [])]


def check(name: str, read: Callable[[Path], Rows], folder: Path) -> None:
    """Raise where rows, studies, participants or medians are not what `minihuman query` says."""
    expected = json.loads(folder.with_suffix(".json").read_text())
    tables = sorted({table for study in expected.values() for table in study["rows"]})
    assert {path.name for path in folder.iterdir() if path.is_dir()} == set(tables)
    count = 0
    for table in tables:
        rows = read(folder / table)
        count += len(rows)
        for study, its in expected.items():
            theirs = [row for row in rows if row["study"] == study]
            assert len(theirs) == its["rows"].get(table, 0), (name, table, study, len(theirs))
            if table == "steps":
                times = {code: [row["t_s"] for row in theirs if row["participant"] == code] for code in _codes(theirs)}
                found = {code: statistics.median(each) for code, each in times.items()}
                assert found == {row["participant"]: row["t_s"] for row in its["medians"]}, (name, study)
        assert {row["study"] for row in rows} <= set(expected)
    print(f"{name} {version(name)}: {len(tables)} tables of {len(expected)} studies, {count} rows")


def _codes(rows: Rows) -> list[str]:
    return sorted({row["participant"] for row in rows})


if __name__ == "__main__":
    check("daft", read_with_daft, Path(sys.argv[1]) / "partitions")
    check("pyspark", read_with_spark, Path(sys.argv[1]) / "partitions")
