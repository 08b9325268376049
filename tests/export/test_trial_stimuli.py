"""Pictures and sounds of trials in exports: BIDS events with their files, and the tables of the other formats."""

import csv
import json
import shutil
from itertools import pairwise
from pathlib import Path

import pytest

from minihuman.dataset.presented_stimuli import list_presentations
from minihuman.dataset.selection import Selection
from minihuman.exporters.bids.stimulus_files import StimulusFiles
from minihuman.exporters.exporter import export_study
from minihuman.log.read.session_reader import read_log
from minihuman.storage.outside_names import OutsideNameError
from tests.export.test_standards import validated as validate
from tests.golden.make import make_images
from tests.golden.sounds import build_sounds
from tests.machine import needs

GOLDEN = Path(__file__).parents[1] / "golden"
REQUIRED = ["onset", "duration"]  # the first columns of an events file, in this order


def read_events(folder: Path) -> list[dict[str, str]]:
    """Read the events of a BIDS dataset with one run."""
    [path] = folder.glob("sub-*/ses-*/beh/*_events.tsv")
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def find_rule_violations(folder: Path) -> list[str]:
    """Return which of the rules of BIDS 1.11 for events and their stimuli a dataset violates."""
    rows = read_events(folder)
    [sidecar] = folder.glob("task-*_events.json")
    described = json.loads(sidecar.read_text())
    violations = [] if list(rows[0])[:2] == REQUIRED else ["the first columns are not onset and duration"]
    violations += [f"{name} is not described" for name in rows[0] if name not in described]
    levels = described["trial_type"]["Levels"]
    violations += [f"{row['trial_type']} is no level" for row in rows if row["trial_type"] not in levels]
    onsets = [float(row["onset"]) for row in rows]
    violations += ["the rows are not in order of time"] if any(one > two for one, two in pairwise(onsets)) else []
    files = {row.get("stim_file", "n/a") for row in rows} - {"n/a"}
    violations += [f"{name} is not below stimuli" for name in files if not (folder / "stimuli" / name).is_file()]
    present = {str(path.relative_to(folder / "stimuli")) for path in folder.glob("stimuli/**/*") if path.is_file()}
    return violations + [f"no event has {name}" for name in present - files]


def copy_study(name: str, folder: Path) -> Path:
    """Copy a frozen study, as what reads it leaves a cache beside it."""
    return Path(shutil.copytree(GOLDEN / name, folder / "data"))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    parent = tmp_path_factory.mktemp("stimuli")
    folder = parent / "bids"
    export_study("bids", copy_study("v3/sounds", parent), folder, Selection())
    return folder


def test_bids_events_of_pictures_and_sounds_keep_the_written_rules(dataset):
    assert find_rule_violations(dataset) == []


@needs("validators")
def test_the_validator_of_bids_finds_no_error_and_misses_a_file_of_a_stimulus(dataset, tmp_path):
    done = validate("bids", dataset)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    copy = Path(shutil.copytree(dataset, tmp_path / "copy"))
    (copy / "stimuli/low.wav").unlink()
    assert validate("bids", copy).returncode != 0


def test_each_sound_and_each_image_is_an_event_with_its_file(dataset):
    rows = read_events(dataset)
    [path] = (GOLDEN / "v3/sounds").rglob("*.mcap")
    log = read_log(path)
    presented = list(list_presentations(log))
    for kind in ("flip", "sound"):
        events = [row for row in rows if row["trial_type"] == kind]
        onsets = [(presentation.onset_ns) / 1e9 for presentation in presented if presentation.kind == kind]
        assert [float(row["onset"]) for row in events] == pytest.approx(onsets, abs=1e-8)
    words = [row for row in rows if row["detail"] == "word"]
    assert [row["stim_file"] for row in words] == [row["label_word"] for row in words]
    pictures = [row for row in rows if "picture" in row["detail"].split(", ") and row["stim_file"] != "n/a"]
    assert {row["stim_file"] for row in pictures} == {"dark.png", "light.png"}
    assert all(row["stim_file"] == row["label_picture"] for row in pictures)
    durations = {row["detail"]: row["duration"] for row in rows if row["trial_type"] == "sound"}
    assert durations == {"warning": "0.1", "word": "n/a", "feedback": "0.15", "tone": "0.07"}
    files = build_sounds().files
    assert {path.name: path.read_bytes() for path in (dataset / "stimuli").iterdir()} == {
        name: files[name] for name in ("dark.png", "light.png", "low.wav", "high.wav")
    }


def test_the_image_of_a_trial_without_a_timeline_is_of_its_first_flip(tmp_path):
    make_images(tmp_path / "data")
    folder = tmp_path / "bids"
    export_study("bids", tmp_path / "data/images", folder, Selection())
    assert find_rule_violations(folder) == []
    flips = [row for row in read_events(folder) if row["trial_type"] == "flip" and row["step"] == "0"]
    assert {row["stim_file"] for row in flips} == {"red.png", "blue.png"}


def test_a_dataset_without_files_of_stimuli_has_no_folder_for_them(tmp_path):
    folder = tmp_path / "bids"
    export_study("bids", copy_study("v2/adaptive", tmp_path), folder, Selection())
    assert not (folder / "stimuli").exists()
    assert "stim_file" not in read_events(folder)[0]


def test_a_file_that_changed_between_versions_of_a_study_keeps_both_contents(tmp_path):
    stimulus_files = StimulusFiles(tmp_path)
    names = [stimulus_files.add("faces/a.png", {"faces/a.png": content}) for content in (b"1", b"2", b"1")]
    assert [(tmp_path / "stimuli" / name).read_bytes() for name in names] == [b"1", b"2", b"1"]
    assert names[0] == names[2] == "faces/a.png"
    with pytest.raises(OutsideNameError):
        stimulus_files.add("../a.png", {"../a.png": b"1"})


@pytest.mark.program
@pytest.mark.parametrize(
    "kind", ["csv", "parquet", "spss", "stata", "psych-ds", "frictionless", "croissant", "hugging-face"]
)
def test_every_format_of_tables_has_the_pictures_and_sounds_of_trials(tmp_path, kind):
    folder = tmp_path / "out"
    export_study(kind, copy_study("v3/sounds", tmp_path), folder, Selection())
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    for table in ("trialstimuli", "trialsounds", "trialresponses"):
        assert any(table in name.replace("_", "").replace("-", "") for name in names), names
