"""Tables in a store that are damaged there: not fetched, named, and stored again by the machine that has the log."""

from pathlib import Path

import pyarrow.parquet
import pytest

from minihuman.dataset.remote_tables import fetch_tables, store_tables
from minihuman.storage.remote_store import TABLES_URL_FILE_NAME
from tests.builders import session, write_log


def cut(content: bytes) -> bytes:
    """Cut a file short."""
    return content[:50]


def flip(content: bytes) -> bytes:
    """Change a byte of a page of rows."""
    place = content.index(b"PAR1", 1) if content.count(b"PAR1") > 2 else 60
    return content[:place] + bytes([content[place] ^ 255]) + content[place + 1 :]


@pytest.mark.parametrize("damage", [cut, flip, lambda content: b"", lambda content: content[:-1]])
def test_a_damaged_table_is_named_and_stored_again_and_the_others_are_fetched(tmp_path: Path, damage) -> None:
    log = write_log(session(blocks=("grid",), episodes=2), tmp_path / "data")
    shelf = tmp_path / "tables"
    shelf.mkdir()
    (tmp_path / "data" / TABLES_URL_FILE_NAME).write_text(f"{shelf}\n")
    study = log.parents[2]
    counts = store_tables(study)
    assert counts is not None
    assert fetch_tables(str(shelf), tmp_path / "whole") == (counts[0], 0)
    steps = next(shelf.glob("steps/*/*/*.parquet"))
    content = steps.read_bytes()
    steps.write_bytes(damage(content))
    lines: list[str] = []
    assert fetch_tables(str(shelf), tmp_path / "fetched", say=lines.append) == (counts[0] - 1, 0)
    assert [steps.name in line and "damaged" in line for line in lines] == [True]
    assert store_tables(study) == (1, 0)
    assert steps.read_bytes() == content
    assert fetch_tables(str(shelf), tmp_path / "fetched") == (1, 0)


def test_rows_that_are_not_those_of_the_digest_in_the_name_are_not_believed(tmp_path: Path) -> None:
    log = write_log(session(blocks=("grid",), episodes=2), tmp_path / "data")
    shelf = tmp_path / "tables"
    shelf.mkdir()
    (tmp_path / "data" / TABLES_URL_FILE_NAME).write_text(f"{shelf}\n")
    store_tables(log.parents[2])
    steps = next(shelf.glob("steps/*/*/*.parquet"))
    table = pyarrow.parquet.read_table(steps, partitioning=None)
    pyarrow.parquet.write_table(table.slice(1), steps)  # whole, with the metadata of the other
    lines: list[str] = []
    fetch_tables(str(shelf), tmp_path / "fetched", say=lines.append)
    assert ["its rows are not those of its digest" in line for line in lines] == [True]
