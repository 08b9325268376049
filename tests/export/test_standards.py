"""Archives' formats, held against their own validators where these are installed, and against their written rules.

The validators are no dependency: ``.ci/run standards`` installs them and says where in ``MINIHUMAN_STANDARDS``.
"""

import csv
import gzip
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.next_session import plan_next_session
from minihuman.dataset.participants_file import ParticipantsFileError
from minihuman.dataset.selection import Selection
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.events import Answered, Sampled, Stepped
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.exporters.exporter import export_study
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from tests.golden.make import STARTED_NS, segment, study
from tests.machine import need, needs
from tests.study.test_about import ABOUT

pytestmark = pytest.mark.program

GOLDEN = Path(__file__).parents[1] / "golden/v1"
FROZEN = ("resumed", "mixed", "no-episode", "recovered")
FORMATS = ("bids", "psych-ds", "frictionless", "croissant")


ASKED = """
[[questions]]
name = "about-you"
form = "demographics"
[[questions]]
name = "load"
form = "nasa-tlx"
[[devices]]
name = "gaze"
source = "eye-tracker"
channels = ["x", "y"]
units = ["px", "px"]
required = false
[[devices]]
name = "trigger-box"
source = "trigger-box"
required = false
"""


class Sampling(McapRecorder):
    """Beside every input a look somewhere, and now and then a word."""

    def begin(self, events):
        looks = [
            Sampled(event.t_ns, "gaze", (float(event.step), 0.5)) for event in events if isinstance(event, Stepped)
        ]
        words = [Sampled(look.t_ns, "trigger-box", (), "S1") for look in looks[:1]]
        super().begin([*looks, *words, *events])


def asked_study(folder: Path) -> None:
    """Two people who answer questions, one set of them twice, and whom two devices look at."""
    toml = study("mixed").toml.decode().replace('name = "mixed"', 'name = "asked"', 1)
    toml = toml.replace(
        'blocks = ["small", "first-person"]', 'parts = ["about-you", "small", "load", "first-person", "load"]'
    )
    told = decode_protocol((toml + ASKED).encode())
    for who in ("sub-01", "sub-02"):
        plan, clock = plan_next_session(told, folder, participant=who, session=1), VirtualClock()
        session = SessionMachine(plan, World, {"player": "random"}, picture_px=None)
        recorder = Sampling(folder, plan, started_ns=STARTED_NS)
        player = make_participant("random", np.random.default_rng(5))
        run_session(session, SimulatedWindow(player, session, clock), recorder, clock)


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studies")
    for name in FROZEN:
        shutil.copytree(GOLDEN / name, folder / name)
    facts = ABOUT.partition("[[devices]]")[0]
    told = decode_protocol(study("mixed").toml.replace(b'name = "mixed"', b'name = "two-sessions"', 1) + facts.encode())
    for who in ("sub-01", "sub-02"):
        for session in (1, 2):
            segment(folder, told, "random", participant=who, session=session)
    asked_study(folder)
    (folder / "two-sessions/participants.csv").write_text("participant,age,hand\nsub-02,31,left\n")
    return folder


@pytest.fixture(scope="module")
def exported(studies, tmp_path_factory):
    out = tmp_path_factory.mktemp("exported")
    for name in (*FROZEN, "two-sessions", "asked"):
        for kind in FORMATS:
            export_study(kind, studies / name, out / kind / name, Selection())
    return out


def validated(kind: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = {
        "bids": ["bids-validator-deno", str(folder), "--max-rows", "-1", "--ignoreWarnings"],
        "frictionless": ["frictionless", "validate", "datapackage.json"],
        "croissant": ["mlcroissant", "validate", "--jsonld", "croissant.json"],
    }[kind]
    program = [str(Path(need("validators")) / command[0]), *command[1:]]
    return subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=300, check=False)


@needs("validators")
@pytest.mark.parametrize("name", [*FROZEN, "two-sessions", "asked"])
@pytest.mark.parametrize("kind", ["bids", "frictionless", "croissant"])
def test_the_formats_own_validator_finds_no_error(exported, kind, name):
    done = validated(kind, exported / kind / name)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def break_bids_column(folder):
    path = next(folder.glob("sub-*/ses-*/beh/*_events.tsv"))
    path.write_text(path.read_text().replace("onset", "onsett", 1))


def break_bids_hed(folder):
    path = next(folder.glob("task-*_events.json"))
    path.write_text(path.read_text().replace("Agent-action, Press", "Agent-action, Pres", 1))


def break_frictionless_key(folder):
    path = folder / "episodes.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[-1]]) + "\n")


def break_frictionless_type(folder):
    path = folder / "episodes.csv"
    path.write_text(path.read_text().replace(",TRUE", ",perhaps").replace('"TRUE"', '"perhaps"'))


def break_croissant(folder):
    path = folder / "croissant.json"
    path.write_text(path.read_text().replace('"steps.parquet"\n      }', '"stepps.parquet"\n      }'))
    described = json.loads(path.read_text())
    described["recordSet"][0]["field"][0]["source"]["fileObject"]["@id"] = "nowhere.parquet"
    path.write_text(json.dumps(described))


@needs("validators")
@pytest.mark.parametrize(
    ("kind", "spoil"),
    [
        ("bids", break_bids_column),
        ("bids", break_bids_hed),
        ("frictionless", break_frictionless_key),
        ("frictionless", break_frictionless_type),
        ("croissant", break_croissant),
    ],
)
def test_the_validator_finds_what_is_broken(exported, tmp_path, kind, spoil):
    copy = tmp_path / "copy"
    shutil.copytree(exported / kind / "two-sessions", copy)
    spoil(copy)
    assert validated(kind, copy).returncode != 0


@pytest.mark.parametrize("kind", ["psych-ds", "croissant"])
def test_columns_of_labels_are_described(tmp_path, kind):
    folder = tmp_path / "out"
    export_study(kind, GOLDEN.parent / "v3/timelines", folder, Selection())
    if kind == "psych-ds":
        assert psych_ds_errors(folder) == []
        described = {
            one["name"] for one in json.loads((folder / "dataset_description.json").read_text())["variableMeasured"]
        }
    else:
        records = json.loads((folder / "croissant.json").read_text())["recordSet"]
        described = {field["source"]["extract"]["column"] for record in records for field in record["field"]}
    assert any(name.startswith("label_") for name in described)


KEYWORD = r"[a-z]+-[A-Za-z0-9]+"
OFFICIAL = {"study", "site", "subject", "session", "task", "condition", "trial", "stimulus", "description"}


def psych_ds_errors(folder: Path) -> list[str]:
    """The rules of Psych-DS 1.0 (its schema reference), as far as they concern such a dataset."""
    errors = []
    described = json.loads((folder / "dataset_description.json").read_text())
    errors += [f"no {name}" for name in ("name", "description", "variableMeasured") if not described.get(name)]
    if described.get("@type") != "Dataset" or described.get("@context") not in (
        "http://schema.org",
        "http://schema.org/",
    ):
        errors.append("no Dataset of schema.org")
    measured = [one["name"] for one in described["variableMeasured"]]
    errors += [f"{name} twice" for name in set(measured) if measured.count(name) > 1]
    files = sorted((folder / "data").rglob("*_data.csv"))
    if not files:
        errors.append("no data file")
    for path in files:
        if not re.fullmatch(rf"{KEYWORD}(_{KEYWORD})*_data\.csv", path.name):
            errors.append(f"{path.name} is not named by keywords")
        errors += [f"{word} is no keyword" for word in re.findall(r"([a-z]+)-", path.name) if word not in OFFICIAL]
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        errors += [f"{path.name}: {name} is not described" for name in header if name not in measured]
        if "" in header or len(set(header)) < len(header):
            errors.append(f"{path.name}: a column without a name, or twice")
        errors += [f"{path.name}: a row of {len(row)} cells" for row in rows if len(row) != len(header)]
    return errors


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("name", [*FROZEN, "two-sessions"])
def test_psych_ds_keeps_its_written_rules(exported, name):
    assert psych_ds_errors(exported / "psych-ds" / name) == []


@pytest.mark.parametrize(
    ("spoil", "error"),
    [
        (lambda folder: _replace(folder / "dataset_description.json", '"t_ns"', '"time"'), "t_ns is not described"),
        (lambda folder: _rename(folder, "steps_data", "steps-data"), "is not named by keywords"),
        (
            lambda folder: _replace(folder / "dataset_description.json", '"description": "People', '"d": "People'),
            "no desc",
        ),
    ],
)
def test_psych_ds_rules_find_what_is_broken(exported, tmp_path, spoil, error):
    copy = tmp_path / "copy"
    shutil.copytree(exported / "psych-ds/two-sessions", copy)
    spoil(copy)
    assert any(error in found for found in psych_ds_errors(copy))


def _replace(path, old, new):
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def _rename(folder, old, new):
    path = next(folder.glob(f"data/*{old}.csv"))
    path.rename(path.with_name(path.name.replace(f"description-{old}", f"description_{new}_data")))


def tsv(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def test_bids_has_a_run_for_each_segment_and_its_events_in_seconds_of_it(exported, studies):
    folder = exported / "bids/resumed"
    [log] = [read_log(path) for path in (studies / "resumed").rglob("*.mcap")]
    runs = sorted((folder / "sub-01/ses-01/beh").glob("*_events.tsv"))
    scans = tsv(folder / "sub-01/ses-01/sub-01_ses-01_scans.tsv")
    assert [row["acq_time"] for row in scans if row["filename"].startswith("beh/")] == [
        segment.started_at[:26] for segment in log.segments
    ]
    for run, part in zip(runs, log.segments, strict=True):
        rows = tsv(run)
        onsets = [float(row["onset"]) for row in rows]
        assert onsets == sorted(onsets)
        episodes = [episode for episode in log.episodes if episode.segment == part.number]
        began = [float(row["onset"]) for row in rows if row["trial_type"] == "episode"]
        assert began == pytest.approx([(episode.t_ns[0] - part.start_ns) / 1e9 for episode in episodes], abs=1e-8)
        steps = [row for row in rows if row["trial_type"] == "step"]
        assert len(steps) == sum(len(episode.actions) for episode in episodes)
        keys = [row for row in rows if row["trial_type"] == "key"]
        assert len(keys) == sum(part.keys.column("down"))
        flips = [row for row in rows if row["trial_type"] == "flip"]
        assert len(flips) == sum(len(episode.frames) for episode in episodes)
    first = tsv(runs[0])
    assert [row["outcome"] for row in first if row["trial_type"] == "episode"] == ["goal", "abandoned"]
    assert [row["counts"] for row in first if row["trial_type"] == "episode"] == ["true", "false"]
    assert [row["detail"] for row in first if row["trial_type"] == "pause"] == ["quit_question"]


def test_bids_keeps_grid_and_room_apart_with_their_units(exported):
    folder = exported / "bids/two-sessions/sub-02/ses-02/motion"
    units = {}
    for path in sorted(folder.glob("*_channels.tsv")):
        rows = tsv(path)
        units[re.search("tracksys-([a-z]+)", path.name)[1]] = {row["name"]: row["units"] for row in rows}
        motion = path.with_name(path.name.replace("_channels", "_motion"))
        assert all(len(line.split("\t")) == len(rows) for line in motion.read_text().splitlines())
    assert units["grid"] == {"x": "cell", "z": "cell", "yaw": "rad", "latency": "s"}
    assert units["room"]["x"] == "m"


def test_bids_has_a_phenotype_for_each_set_of_questions_with_every_answer(exported, studies):
    folder = exported / "bids/asked/phenotype"
    log = read_log(next((studies / "asked").rglob("sub-02_ses-01.mcap")))
    answers = [event for event in log.segments[0].part_events if isinstance(event, Answered)]
    for name, stem in (("about-you", "aboutyou"), ("load", "load")):
        [row] = [row for row in tsv(folder / f"{stem}.tsv") if row["participant_id"] == "sub-02"]
        theirs = [answer for answer in answers if answer.part_name == name]
        first = min(answer.part for answer in theirs)
        given = {
            answer.item if answer.part == first else f"{answer.item}_2": json.loads(answer.value) for answer in theirs
        }
        said = {item: "n/a" if value in (None, "") else str(value) for item, value in given.items()}
        assert row == {"participant_id": "sub-02", "session_id": "ses-01"} | said
    assert len(theirs) == 2 * len(log.plan.parts[theirs[0].part].plan.items)
    meaning = json.loads((folder / "load.json").read_text())
    asked = next(item for item in log.plan.parts[theirs[0].part].plan.items if item.name == theirs[0].item)
    assert meaning[theirs[0].item]["Description"] == asked.ask
    assert meaning[f"{theirs[0].item}_2"]["Description"] == f"{asked.ask} (time 2 in the session)"


def test_bids_has_a_recording_for_each_device_with_the_moment_of_every_sample(exported, studies):
    folder = exported / "bids/asked/sub-01/ses-01/beh"
    log = read_log(next((studies / "asked").rglob("sub-01_ses-01.mcap")))
    stem = "sub-01_ses-01_task-asked_run-1_recording-"
    with gzip.open(folder / f"{stem}gaze_physio.tsv.gz", "rt") as file:
        rows = [[float(cell) for cell in line.split("\t")] for line in file]
    looks = [sample for sample in log.segments[0].samples if sample.device == "gaze"]
    assert len(rows) == len(looks) > 10
    assert rows == [[pytest.approx(look.t_ns / 1e9), *look.values] for look in looks]
    told = json.loads((folder / f"{stem}gaze_physio.json").read_text())
    assert told["Columns"] == ["timestamp", "x", "y"]
    assert told["x"]["Units"] == "px"
    assert told["StartTime"] == pytest.approx(rows[0][0])
    with gzip.open(folder / f"{stem}triggerbox_physio.tsv.gz", "rt") as file:
        assert next(file).rstrip().split("\t")[1:] == ["S1"]


def test_the_studys_facts_are_in_every_format(exported):
    bids = json.loads((exported / "bids/two-sessions/dataset_description.json").read_text())
    assert (bids["License"], bids["Authors"]) == ("CC-BY-4.0", ["Ada Lovelace", "N. N."])
    assert bids["EthicsApprovals"] == ["Board of the faculty, 2026-17"]
    people = tsv(exported / "bids/two-sessions/participants.tsv")
    assert [(row["participant_id"], row["age"], row["hand"]) for row in people] == [
        ("sub-01", "n/a", "n/a"),
        ("sub-02", "31", "left"),
    ]
    package = json.loads((exported / "frictionless/two-sessions/datapackage.json").read_text())
    assert package["licenses"] == [{"name": "CC-BY-4.0"}]
    assert package["contributors"][0]["path"] == "https://orcid.org/0000-0002-1825-0097"
    croissant = json.loads((exported / "croissant/two-sessions/croissant.json").read_text())
    assert croissant["citeAs"] == "https://doi.org/10.1234/abcd"
    psych = json.loads((exported / "psych-ds/two-sessions/dataset_description.json").read_text())
    assert psych["funder"] == ["Grant 7"]


def test_the_logs_and_what_was_made_of_them_are_beside(exported, studies):
    folder = exported / "bids/resumed"
    [log] = (studies / "resumed").rglob("*.mcap")
    assert (folder / "sourcedata/sub-01/ses-01" / log.name).read_bytes() == log.read_bytes()
    assert (folder / "derivatives/minihuman/figures/sub-01_ses-01_paths.png").stat().st_size > 1000
    assert (folder / "derivatives/minihuman/tables/episodes.csv").exists()


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("participant,age,hand\nsub-01,old,left\n", "participants.csv:2: age is 'old'; use a value of type integer"),
        ("participant,age,hand\nsub-01,31,both\n", "participants.csv:2: hand is 'both'; use one of left, right"),
        ("participant,age\nsub-01,31\n", "participants.csv has no column 'hand'"),
        ("participant,age,hand\nsub-01,,\nsub-01,,\n", "participants.csv:3: 'sub-01' appears twice"),
    ],
)
def test_what_the_laboratory_says_of_people_is_checked(studies, tmp_path, lines, message):
    copy = tmp_path / "two-sessions"
    shutil.copytree(studies / "two-sessions", copy)
    (copy / "participants.csv").write_text(lines)
    with pytest.raises(ParticipantsFileError, match=re.escape(message)):
        export_study("bids", copy, tmp_path / "out", Selection(participant=("sub-01",)))
