"""Labels of stimuli, from a simulated study to its tables, exclusions, exports and report."""

import csv
import json
from pathlib import Path

import pyreadstat
import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.selection import check_exclusion_measures
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.tables import select
from minihuman.errors import ProtocolError, ReportError
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.protocol.study_design import derive_design
from minihuman.exporters.bids.export import export as export_bids
from minihuman.exporters.tables import export_csv, export_spss, export_stata
from minihuman.planning.preregistration import build_preregistration
from minihuman.reporting.results import compute_results
from minihuman.runtime.simulated_session import simulate

TOML = """
[study]
name = "stroop"
version = "1"
seed = 5
participants = 20
[keys]
pool = ["d", "f", "j", "k"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["stroop"]
[[blocks]]
name = "stroop"
kind = "trials"
world = "minihuman/Stimulus-v0"
options = { responses = ["red", "green"] }
episodes = 24
actions = ["red", "green"]
key_map = "shown"
noop_action = "none"
response_deadline_ms = 2000
max_steps = 1
ready = "first"
final_frame_ms = 0
stimuli = { file = "words.csv", max_run = { congruent = 3 } }
[analysis]
conditions = ["label:congruent"]
primary_measure = "response_median_ms"
"""
TABLE = b"""text,colour,correct,congruent,soa (ms)
RED,red,red,yes,100
GREEN,red,red,no,200
GREEN,green,green,yes,100
RED,green,green,no,200
"""
EXCLUSION = """[[exclusions]]
reason = "far too slow where it is easy"
level = "episode"
measure = "response_median_ms"
above = 1.0
where = { congruent = "yes" }
"""


def decode(more: str = "") -> Protocol:
    return decode_protocol((TOML + more).encode(), "p.toml", {"words.csv": TABLE})


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("labels")
    assert len(list(simulate(decode(EXCLUSION), data, participants=3, seed=1, player="human-like"))) == 3
    return data / "stroop"


def test_a_study_of_trials_is_simulated_by_default_and_proven(study):
    for log in study.rglob("*.mcap"):
        assert all(is_proven for _, is_proven in verify_session(log))


def test_labels_are_in_the_table_of_episodes_and_in_queries(study):
    with select(study) as tables:
        rows = tables.query(
            "select labels->>'$.congruent' as congruent, count(*) as n from episodes group by 1 order by 1"
        ).to_pylist()
    assert rows == [{"congruent": "no", "n": 36}, {"congruent": "yes", "n": 36}]


def test_an_exclusion_rule_sees_the_labels_of_a_trial(study):
    with select(study) as tables:
        rows = tables.arrow("episodes", ["labels", "exclusion_reason"]).to_pylist()
    excluded = {json.loads(row["labels"])["congruent"]: row["exclusion_reason"] for row in rows}
    assert excluded == {"yes": "far too slow where it is easy", "no": None}


def read_rows(path: Path, delimiter: str = ",") -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter=delimiter))


def test_each_label_is_a_column_of_the_csv_export_with_its_meaning(study, tmp_path):
    export_csv(IncludedEpisodes(StudySessions(study)), tmp_path)
    rows = read_rows(tmp_path / "episodes.csv")
    assert {(row["label_congruent"], row["label_soa_ms"]) for row in rows} == {("yes", "100"), ("no", "200")}
    dictionary = json.loads((tmp_path / "dictionary.json").read_text())
    assert "'congruent'" in dictionary["episodes"]["label_congruent"]["meaning"]
    assert dictionary["episodes"]["label_soa_ms"]["type"] == "number"


def test_each_label_is_a_column_of_spss_and_stata(study, tmp_path):
    for export, kind in ((export_spss, "sav"), (export_stata, "dta")):
        export(IncludedEpisodes(StudySessions(study)), tmp_path)
        read = pyreadstat.read_sav if kind == "sav" else pyreadstat.read_dta
        frame, _ = read(str(tmp_path / f"episodes.{kind}"))
        assert set(frame["label_congruent"]) == {"yes", "no"}
        assert set(frame["label_soa_ms"]) == {100.0, 200.0}


def test_bids_events_have_labels_in_columns_of_their_own(study, tmp_path):
    export_bids(IncludedEpisodes(StudySessions(study)), tmp_path)
    (events,) = tmp_path.glob("sub-01/ses-01/beh/*_events.tsv")
    rows = read_rows(events, "\t")
    steps = [row for row in rows if row["trial_type"] == "step"]
    assert {row["label_congruent"] for row in steps} == {"yes", "no"}
    assert {row["trial_type"] for row in rows} <= {"episode", "step", "key", "flip", "pause"}
    (sidecar,) = tmp_path.glob("task-*_events.json")
    assert "'congruent'" in json.loads(sidecar.read_text())["label_congruent"]["Description"]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            'where = { congruent = "maybe" }',
            r"exclusions\[0\].where: has congruent = 'maybe'.*its levels are 'yes', 'no'",
        ),
        ('where = { side = "left" }', r"where: has 'side', which is no label; its labels are congruent, soa \(ms\)"),
    ],
)
def test_an_exclusion_of_a_label_or_level_that_there_is_not_is_refused(more, message):
    with pytest.raises(ProtocolError, match=message):
        check_worlds(decode(EXCLUSION.replace('where = { congruent = "yes" }', more)), "p.toml")


def test_labels_are_of_trials_and_not_of_participants():
    with pytest.raises(ReportError, match="a participant has no labels"):
        check_exclusion_measures(decode(EXCLUSION.replace('"episode"', '"participant"')).exclusions, "p.toml")


def test_conditions_that_are_no_label_are_refused():
    with pytest.raises(ProtocolError, match="has 'label:side', which is no label"):
        check_worlds(
            decode_protocol(TOML.replace("label:congruent", "label:side").encode(), "p.toml", {"words.csv": TABLE}), "p"
        )


CONTRAST = """
[design]
primary_effect = "conditions"
contrasts = [{{ name = "congruency", weights = {{ {first} = 1.0, {second} = {weight} }} }}]
"""


@pytest.mark.parametrize(
    ("first", "second", "weight", "message"),
    [
        ("no", "maybe", -1.0, r"contrasts\[0\].weights: has 'maybe', which is not a condition; conditions: no, yes"),
        ("no", "yes", 1.0, r"weights sum to 2; the weights of a contrast sum to 0"),
    ],
)
def test_a_contrast_of_levels_that_cannot_be_is_refused(first, second, weight, message):
    with pytest.raises(ProtocolError, match=message):
        check_worlds(decode(CONTRAST.format(first=first, second=second, weight=weight)), "p.toml")


def test_a_contrast_of_levels_is_tested_as_it_is_stated(study):
    protocol = decode(CONTRAST.format(first="no", second="yes", weight=-1.0))
    check_worlds(protocol, "p.toml")
    with select(study) as tables:
        frames = {
            name: tables.frame(name).assign(exclusion_reason=None) for name in ("episodes", "blocks", "participants")
        }
    results = compute_results(**frames, analysis=protocol.analysis, design=derive_design(protocol))
    assert results.within is not None
    assert {comparison.first for comparison in results.within.comparisons} == {"congruency"}
    plain = compute_results(**frames, analysis=protocol.analysis).within
    assert plain is not None
    assert [row.p for row in results.within.comparisons] == [row.p for row in plain.comparisons]
    planned = build_preregistration(protocol, expand_protocol(protocol, enrol_participant(protocol, 0)))
    assert "Within participants: contrasts congruency of the levels of congruent, paired permutation" in planned
