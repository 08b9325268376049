"""Every number of every output of seven invented laboratories' studies is what a second program finds in their logs."""

import re
from pathlib import Path

import pytest

from tests.recompute.play import OUTPUTS, PROTOCOLS, play_study, recompute_outputs, write_outputs
from tests.recompute.tables import Tally, read_csv

pytestmark = pytest.mark.program  # whole studies are simulated

TRIALS = Path(__file__).parent / "trials" / "timeline.toml"
FILES = ("csv", "parquet")
SMALL = next(path for path in PROTOCOLS if path.stem == "kadur")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A study of twelve with one of each course, and all of its outputs."""
    folder = tmp_path_factory.mktemp("small")
    study = play_study(SMALL, folder, 12)
    write_outputs(study, folder / "outputs")
    return study, folder / "outputs"


def check(study: Path, outputs: Path) -> dict[str, list[int]]:
    counts, told = recompute_outputs(study, outputs)
    assert {name for name, (_, wrong) in counts.items() if not wrong} == {*OUTPUTS, "methods"}, told
    return counts


def test_every_number_of_a_small_study_is_what_its_logs_say(small: tuple[Path, Path]) -> None:
    assert all(compared > 500 for compared, _ in check(*small).values())


def test_every_number_of_trials_with_a_time_course_is_what_their_logs_say(tmp_path: Path) -> None:
    study = play_study(TRIALS, tmp_path, 6, players=("human-like", "random"))
    write_outputs(study, tmp_path / "outputs", FILES)
    counts, told = recompute_outputs(study, tmp_path / "outputs", FILES)
    assert {name for name, (compared, wrong) in counts.items() if compared > 10_000 and not wrong} == {*FILES}, told
    pictures = read_csv(tmp_path / "outputs" / "csv" / "trial_stimuli.csv")
    assert {(row["attempt"], row["segment"]) for row in pictures} > {("1", "1"), ("2", "2")}  # voided and resumed


EDITS = {
    "query/outcomes.csv": (r",(\d+),", ",1\\1,"),
    "csv/episodes.csv": ('"timeout"', '"goal"'),
    "bids/participants.tsv": ("gilui", "galui"),
    "notebook/notebook.json": (r'"steps": (\d+)', '"steps": 1\\1'),
    "report/report.html": (r"<td>(\d\.\d+ \(\d\.\d+)\)</td>", "<td>\\1 1)</td>"),
}


def test_one_number_that_is_changed_in_an_output_is_found(small: tuple[Path, Path]) -> None:
    study, outputs = small
    for name, (old, new) in EDITS.items():
        text = (outputs / name).read_text(encoding="utf-8")
        (outputs / name).write_text(re.sub(old, new, text, count=1), encoding="utf-8")
    counts, told = recompute_outputs(study, outputs, [Path(name).parts[0] for name in EDITS])
    assert all(wrong for name, (_, wrong) in counts.items() if name != "methods"), told
    assert len(counts) == len(EDITS) + 1


def test_a_column_that_is_not_computed_a_second_time_is_found() -> None:
    tally = Tally()
    tally.rows("csv episodes", [{"steps": "3", "first_action": "left"}], [{"steps": 3}], is_whole=True)
    [line] = tally.wrong
    assert line.startswith("csv episodes has columns ['first_action'], which tests/recompute/tables.py")


@pytest.mark.nightly
@pytest.mark.parametrize("protocol", PROTOCOLS, ids=lambda path: path.stem)
def test_every_number_of_a_study_of_forty_is_what_its_logs_say(protocol: Path, tmp_path: Path) -> None:
    study = play_study(protocol, tmp_path, 40)
    write_outputs(study, tmp_path / "outputs")
    print(protocol.stem, check(study, tmp_path / "outputs"))
