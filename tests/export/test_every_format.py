"""One study with odd codes, columns and texts through every format: what the target's program reads is what was logged.

The reference are the study's own tables. A cell may differ only where the export's README or its labels say how.
"""

import json
import re
import subprocess
from pathlib import Path

import duckdb
import pandas as pd
import pyarrow.parquet
import pytest

from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.selection import Selection
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_columns import is_time
from minihuman.dataset.table_types import unguard_text
from minihuman.dataset.tables import select
from minihuman.dataset.wide_integers import WIDE_INTEGERS
from minihuman.exporters.exporter import export_study
from tests.export.odd import FORMULA, LONG, record_odd_study
from tests.machine import need, needs

pytestmark = pytest.mark.program
NAMES = ("participants", "people", "episodes", "answers", "segments", "plan", "steps")
DEMONSTRATIONS = ("minari", "lerobot", "robomimic", "rlds", "imitation")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return record_odd_study(tmp_path_factory.mktemp("odd"))


@pytest.fixture(scope="module")
def reference(study):
    """Every cell of the study's tables as Python has it, by table, column and row; None where there is none."""
    with select(study) as tables:
        cells = {}
        for name in NAMES:
            rows = tables.arrow(name)
            kept = [column for column in rows.column_names if column not in COLUMNS_NEEDING_WORLD]
            cells[name] = rows.select(kept).to_pydict()
        return cells


@pytest.fixture(scope="module")
def exported(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("exported")
    made: dict[str, Path] = {}

    def export(name):
        if name not in made:
            made[name] = out / name
            export_study(name, study, made[name], Selection())
        return made[name]

    return export


def as_python(frame: pd.DataFrame) -> dict[str, list[object]]:
    return {str(name): [None if pd.isna(cell) else cell for cell in frame[name].tolist()] for name in frame.columns}


def find_times(name: str) -> set[str]:
    return {column.name for column in TABLES.get(name, ()) if is_time(column)}


def compare(name, cells, reference, *, changed=(), read=lambda column, cell: cell):
    """Compare a table column by column; ``read`` undoes what the format declares to have changed."""
    times = find_times(name)
    for column, expected in reference[name].items():
        if column in changed:
            continue
        actual = [None if cell is None else read(column, cell) for cell in cells[column]]
        if column in times:
            actual = [pd.Timestamp(cell).floor("us") for cell in actual]
            expected = [pd.Timestamp(cell).floor("us") for cell in expected]
        assert actual == expected, f"{name}.{column}"


def read_example(exported, language: str, name: str, place: int = 0) -> str:
    """The README's lines for a language, for another table than the one in its example."""
    text = (exported("csv") / "README.md").read_text()
    code = re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)[place]
    return code.replace("episodes", name)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("program", "place"), [("pandas", 0), ("polars", 1)])
def test_the_readmes_lines_for_csv_keep_every_cell(exported, reference, monkeypatch, program, place, name):
    monkeypatch.chdir(exported("csv"))
    scope: dict[str, object] = {}
    exec(read_example(exported, "python", name, place), scope)
    frame = scope["frame"]
    cells = as_python(frame) if isinstance(frame, pd.DataFrame) else frame.to_dict(as_series=False)
    text = {column for column, rows in reference[name].items() if any(isinstance(cell, str) for cell in rows)}
    compare(name, cells, reference, read=lambda column, cell: unguard_text(cell) if column in text else cell)


@needs("r")
@pytest.mark.parametrize("name", ["answers", "people", "segments"])
def test_the_readmes_lines_for_r_keep_every_cell(exported, reference, name):
    code = read_example(exported, "r", name) + 'cat(jsonlite::toJSON(frame, na = "null", digits = NA))'
    done = subprocess.run(["Rscript", "-e", code], cwd=exported("csv"), capture_output=True, text=True, check=True)
    rows = json.loads(done.stdout)
    for column, expected in reference[name].items():
        wide = column in WIDE_INTEGERS
        actual = [row.get(column) for row in rows]
        assert [unguard_text(cell) if isinstance(cell, str) else cell for cell in actual] == [
            str(cell) if wide else cell for cell in expected
        ], column


def test_a_csv_opened_by_guess_loses_what_the_readme_warns_of(exported):
    guessed = pd.read_csv(exported("csv") / "segments.csv")
    assert guessed["study_version"].tolist() == [1.1, 1.1]
    assert guessed["study"].tolist() == [7, 7]


def test_the_readme_says_where_the_protocols_measure_is(exported):
    line = "the protocol's measures log_excess_steps_mean are not in these files"
    assert line in (exported("csv") / "README.md").read_text()


def test_no_cell_of_a_csv_runs_in_a_spreadsheet(exported):
    for path in exported("csv").glob("*.csv"):
        frame = pd.read_csv(path, dtype=str, keep_default_na=False)
        for column in frame.columns:
            for cell in frame[column]:
                for part in re.split(r"[;\t\r\n]", cell):
                    is_number = re.fullmatch(r"[+-]?[0-9.,]+(e[+-]?[0-9]+)?", part)
                    assert is_number or not re.match(r"[=+\-@]", part), f"{path.name} {column} {cell!r}"


@needs("r")
@pytest.mark.nightly
@pytest.mark.parametrize("name", ["answers", "people", "segments"])
@pytest.mark.parametrize("kind", ["sav", "dta"])
def test_haven_reads_every_cell_of_spss_and_stata(exported, reference, kind, name):
    code = f'frame <- haven::zap_labels(haven::read_{kind}("{name}.{kind}"))\n'
    code += 'cat(jsonlite::toJSON(frame, na = "null", digits = NA))'
    folder = exported({"sav": "spss", "dta": "stata"}[kind])
    done = subprocess.run([need("r"), "-e", code], cwd=folder, capture_output=True, text=True, check=True)
    rows = json.loads(done.stdout)
    readme = (folder / "README.md").read_text()
    compared = 0
    for column, expected in reference[name].items():
        is_declared = f"{name}: {column} has texts of more than 2045 bytes" in readme
        is_declared |= f"{name}: the column {column} is named" in readme
        if is_declared or column in find_times(name) or (kind == "dta" and column == "hand"):
            continue  # a time is checked with pyreadstat; ``hand`` is a number with labels
        actual = [row.get(column) for row in rows]
        wanted = [str(cell) for cell in expected] if column in WIDE_INTEGERS else expected
        assert [None if cell == "" else cell for cell in actual] == wanted, f"{name}.{column}"
        compared += len(wanted)
    assert compared > 5
    assert (f"{name}: answer has texts" in readme) == (kind == "dta" and name == "answers")


@pytest.mark.parametrize("name", NAMES)
def test_parquet_keeps_every_cell_in_four_programs(exported, reference, name):
    path = exported("parquet") / f"{name}.parquet"
    compare(name, pyarrow.parquet.read_table(path).to_pydict(), reference)
    import polars

    compare(name, polars.read_parquet(path).to_dict(as_series=False), reference)
    compare(name, duckdb.sql(f"SELECT * FROM '{path}'").to_arrow_table().to_pydict(), reference)
    compare(name, as_python(pd.read_parquet(path, dtype_backend="pyarrow")), reference)
    schema = pyarrow.parquet.read_schema(path)
    assert schema.metadata[b"table_version"] == b"1.0"
    assert all(schema.field(column).type == pyarrow.timestamp("us", tz="UTC") for column in find_times(name))


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"steps"}))
@pytest.mark.parametrize("kind", ["sav", "dta"])
def test_spss_and_stata_keep_every_cell_and_label_it(exported, reference, kind, name):
    import pyreadstat

    folder = exported({"sav": "spss", "dta": "stata"}[kind])
    read = pyreadstat.read_sav if kind == "sav" else pyreadstat.read_dta
    frame, facts = read(str(folder / f"{name}.{kind}"), user_missing=False)
    assert facts.column_names_to_labels["participant"] == "The participant's code."
    renamed = {}
    if name == "people":
        renamed = {"with": "with_"}
    if name == "people" and kind == "dta":
        renamed["a_column_with_a_name_that_is_too_long_for_stata"] = "a_column_with_a_name_that_is_2"
    for column, expected in reference[name].items():
        cells = frame[renamed.get(column, column)].tolist()
        labels = facts.variable_value_labels.get(renamed.get(column, column), {})
        if column in WIDE_INTEGERS:
            expected = [str(cell) for cell in expected]
        if column in find_times(name):
            times = [pd.Timestamp(cell).floor("ms") for cell in expected]
            assert [pd.Timestamp(cell, tz="UTC").round("ms") for cell in cells] == times
            continue
        if column == "hand":
            assert labels == (
                {1.0: "left", 2.0: "right"} if kind == "dta" else {"left": "left-handed", "right": "right-handed"}
            )
        if kind == "dta" and column == "hand":
            cells = [labels[cell] for cell in cells]
        assert [None if cell == "" or pd.isna(cell) else cell for cell in cells] == expected, f"{name}.{column}"


@pytest.mark.parametrize("name", ["people", "answers", "segments"])
def test_datasets_loads_every_cell_with_its_type(exported, reference, name, tmp_path):
    import datasets

    loaded = datasets.load_dataset(str(exported("hugging-face")), name, split="train", cache_dir=str(tmp_path))
    compare(name, loaded.to_dict(), reference)


@pytest.mark.parametrize("kind", DEMONSTRATIONS)
def test_demonstrations_say_what_the_laboratory_says_of_a_person(exported, kind, monkeypatch):
    folder = exported(kind)
    expected = {
        "age": 31,
        "hand": "left",
        "code": "=1+1",
        "with": True,
        "a_column_with_a_name_that_is_too_long_for_stata": 0.1,
    }
    assert find_person(kind, folder, monkeypatch) == expected


def find_person(kind, folder, monkeypatch):
    if kind == "minari":
        import minari

        monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
        dataset = minari.load_dataset(next(iter(minari.list_local_datasets())))
        metadata = dataset.storage.metadata
        assert metadata["author"] == {"Ada Lovelace", "Plato"}
        assert metadata["author_email"] == {"ada@example.org"}
        assert (metadata["license"], metadata["doi"]) == ("CC-BY-4.0", "10.1234/abcd")
        assert "code_permalink" not in metadata
        return json.loads(next(iter(dataset.storage.get_episode_metadata([0])))["person"])
    if kind == "lerobot":
        [path] = folder.rglob("meta/episodes/*/*.parquet")
        return json.loads(pd.read_parquet(path)["minihuman/person"][0])
    if kind == "robomimic":
        import h5py

        [path] = folder.rglob("*.hdf5")
        with h5py.File(path) as file:
            return json.loads(file["data/demo_0"].attrs["person"])
    if kind == "imitation":
        import datasets

        stored = datasets.load_from_disk(str(next(path.parent for path in folder.rglob("dataset_info.json"))))
        return json.loads(stored[0]["infos"][0])["person"]
    record = b"".join(path.read_bytes() for path in folder.rglob("*.tfrecord*"))
    match = re.search(rb'\{"age": 31[^}]*\}', record)
    return json.loads(match[0])


def test_bids_keeps_laboratory_columns_apart_from_its_own(exported):
    lines = (exported("bids") / "participants.tsv").read_text().splitlines()
    heads, *rows = [line.split("\t") for line in lines]
    assert heads[:3] == ["participant_id", "group", "player"]
    people = [dict(zip(heads, row, strict=True)) for row in rows]
    assert [row["code"] for row in people] == ["'=1+1", "0012"]
    assert [row["with"] for row in people] == ["true", "n/a"]
    phenotype = (exported("bids") / "phenotype/odd.tsv").read_text().splitlines()
    assert phenotype[1].split("\t")[3] == "'" + FORMULA.replace("\n", " ").replace(";@", ";'@")
    assert phenotype[2].split("\t")[3] == LONG


@needs("validators")
@pytest.mark.parametrize("kind", ["bids", "frictionless", "croissant"])
def test_the_formats_validator_finds_no_error(exported, kind):
    folder = exported(kind)
    command = {
        "bids": ["bids-validator-deno", str(folder), "--max-rows", "-1", "--ignoreWarnings"],
        "frictionless": ["frictionless", "validate", "datapackage.json"],
        "croissant": ["mlcroissant", "validate", "--jsonld", "croissant.json"],
    }[kind]
    program = [str(Path(need("validators")) / command[0]), *command[1:]]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
