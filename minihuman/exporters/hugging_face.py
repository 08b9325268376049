"""Export the tables as a Hugging Face data set: Parquet partitioned by study and participant, and a card.

`OUT/<table>/study=<study>/participant=<code>/rows.parquet`; `datasets.load_dataset(OUT, "steps")` reads a table, and so
do DuckDB, Polars, Spark and Daft. A participant's files are removed by their folders' name. Upload it with
`hf upload NAME OUT --repo-type dataset`.
"""

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet

from minihuman.dataset.episode_stream import IncludedEpisodes
from minihuman.dataset.store import TableDatabase
from minihuman.dataset.table_columns import COLUMNS_NEEDING_WORLD, TABLES, build_data_dictionary
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import get_plan_study_facts
from minihuman.exporters.tables import count_included, find_first_log
from minihuman.log.read.session_reader import read_log


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every table that has rows; those that do not count are there too, with the reason."""
    with chosen.store() as store:
        names = [name for name in TABLES if store.tables.count(name)]
        for name in names:
            for number, part in enumerate(_split_by_participant(store.tables, name)):
                study, participant = (part.column(column)[0].as_py() for column in ("study", "participant"))
                path = out / name / f"study={study}" / f"participant={participant}" / f"rows-{number}.parquet"
                path.parent.mkdir(parents=True, exist_ok=True)
                pa.parquet.write_table(pa.Table.from_batches([part]), path, compression="zstd")
        result, first = count_included(store), find_first_log(store)
    meanings = build_data_dictionary(without=COLUMNS_NEEDING_WORLD)
    described = out / "dictionary.json"
    text = json.dumps({name: meanings[name] for name in names}, indent=1) + "\n"
    described.write_text(text, encoding="utf-8", newline="\n")
    about = get_plan_study_facts(read_log(first).plan) if first else None
    configs = [{"config_name": name, "data_files": f"{name}/*/*/*.parquet"} for name in names]
    front = {
        "license": about.licence.lower() if about and about.licence and "://" not in about.licence else "unknown",
        "pretty_name": about.title if about else "",
        "tags": ["minihuman", *(about.keywords if about else ())],
        "configs": configs,
    }
    card = "".join(f"{name}: {json.dumps(value)}\n" for name, value in front.items() if value)  # JSON is YAML
    return result.with_files((*(out / name for name in names), described), front_matter=f"---\n{card}---\n\n")


def _split_by_participant(tables: TableDatabase, name: str) -> Iterator[pa.RecordBatch]:
    """A table's rows in pieces of one participant each, in order."""
    for batch in tables.batches(name, without=COLUMNS_NEEDING_WORLD):
        codes = [batch.column(column).dictionary_encode().indices for column in ("study", "participant")]
        changes = pc.or_(*(pc.not_equal(each.slice(1), each.slice(0, len(each) - 1)) for each in codes))
        edges = [0, *(place + 1 for place, changed in enumerate(changes.to_pylist()) if changed), len(batch)]
        yield from (batch.slice(begin, end - begin) for begin, end in pairwise(edges))
