"""The sample in the methods: numbers by mean, SD and range, levels by count; free texts are left out."""

from pathlib import Path

from minihuman.dataset.person_table import build_person_table
from minihuman.reporting.sample_description import describe_sample
from tests.data.test_people import ABOUT, HEAD
from tests.export.study import DEMO, recorded

TOML = DEMO.read_bytes() + ABOUT.encode()


def describe(folder: Path, lines: str, groups: dict[str, str]) -> list[str]:
    (folder / "participants.csv").write_text(HEAD + lines)
    people = [("demo", f"sub-{number:02}") for number in (1, 2, 3)]
    return describe_sample(build_person_table(folder, people, [TOML]), groups)


def test_the_included_participants_are_described(tmp_path):
    lines = "sub-01,20,,TRUE,left,Rome\nsub-02,30,,FALSE,right,Oslo\nsub-03,99,1,TRUE,right,Bonn\n"
    [paragraph] = describe(tmp_path, lines, dict.fromkeys(["sub-01", "sub-02"], "all"))
    assert paragraph.split(". ") == [
        "Age at the session: M = 25.0, SD = 7.1, range 20 to 30 (year)",
        "Whether they wore glasses: 1 yes, 1 no",
        "The hand at the keys: 1 left, 1 right.",
    ]


def test_groups_are_described_apart(tmp_path):
    lines = "sub-01,20,,TRUE,left,Rome\nsub-02,30,,FALSE,right,Oslo\nsub-03,40,,TRUE,right,Bonn\n"
    [paragraph] = describe(tmp_path, lines, {"sub-01": "a", "sub-02": "b", "sub-03": "b"})
    assert paragraph.split(". ") == [
        "Age at the session: M = 30.0, SD = 10.0, range 20 to 40 (year); a: M = 20.0; b: M = 35.0, SD = 7.1",
        "Whether they wore glasses: 2 yes, 1 no; a: 1 yes; b: 1 no, 1 yes",
        "The hand at the keys: 2 right, 1 left; a: 1 left; b: 2 right.",
    ]


def test_what_is_not_stated_is_counted(tmp_path):
    assert describe(tmp_path, "sub-01,20,,,,\n", dict.fromkeys(["sub-01", "sub-02"], "all")) == [
        "Age at the session: M = 20.0 (year); 1 not stated."
    ]


def test_a_study_of_which_nothing_is_stated_has_no_such_paragraph(tmp_path):
    assert describe(tmp_path, "", {"sub-01": "all"}) == []
    assert describe_sample(None, {"sub-01": "all"}) == []


def test_the_report_describes_the_sample_and_has_the_table(tmp_path):
    from minihuman.api import report

    study = recorded(tmp_path, participants=2, toml=TOML)
    (study / "participants.csv").write_text(HEAD + "sub-01,20,,,left,\nsub-02,31,,,right,\n")
    summary = report(study, tmp_path / "out")
    assert "Age at the session: M = 25.5, SD = 7.8, range 20 to 31 (year)." in summary.page.read_text()
    assert (tmp_path / "out/tables/people.csv").exists()
