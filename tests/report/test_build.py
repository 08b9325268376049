"""A study's folder to a report: the page, the tables, and what could not be read."""

import dataclasses
import hashlib
import re
import shutil
import warnings

import msgspec
import pandas as pd
import pytest

from minihuman.admin.protocol_file import find_shipped_protocol
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.dataset.caches import is_cache, list_caches
from minihuman.dataset.selection import Selection
from minihuman.dataset.tables import select
from minihuman.errors import LogError, ReportError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.exporters.exporter import export_study
from minihuman.figures import style
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.build import read_planned_analysis
from minihuman.runtime.simulated_session import simulate
from tests.builders import episode, session, session_of, write_log
from tests.machine import needs
from tests.report.reports import write_report
from tests.web.browser import browsing

pytestmark = pytest.mark.program

PROTOCOL = """
study = { name = "transfer", version = "1", seed = 1, participants = 2 }
groups = [{ name = "a", blocks = ["b"] }]
[[blocks]]
name = "b"
world = "minihuman/MiniGrid-FourRooms-v0"
actions = ["left", "right", "forward"]
max_steps = 10
episodes = 1
"""


def fingerprints(folder):
    return {
        path: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and not is_cache(path.relative_to(folder))
    }


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Four whole sessions, a damaged one, an empty one, a foreign one and one cut off."""
    data = tmp_path_factory.mktemp("data")
    for index in range(4):
        group = ("grid_first", "direct")[index % 2]
        write_log(session(participant=f"sub-0{index + 1}", index=index, group=group, seed=index, episodes=2), data)
    whole = data / "transfer" / "sub-01" / "ses-01" / "sub-01_ses-01.mcap"
    bad = data / "transfer" / "bad"
    bad.mkdir()
    content = bytearray(whole.read_bytes())
    content[len(content) // 2] ^= 0xFF
    (bad / "damaged.mcap").write_bytes(content)
    (bad / "empty.mcap").write_bytes(b"")
    (bad / "foreign.mcap").write_bytes(b"this is no log\n" * 100)
    half = data / "transfer" / "sub-09" / "ses-01"
    half.mkdir(parents=True)
    (half / "sub-09_ses-01.mcap").write_bytes(whole.read_bytes()[: len(content) // 2])
    (half / "notes.txt").write_text("not a log, and nobody minds")
    mark = Annotation("exclude", "2026-01-06T10:00:00Z", episode=4, note="phone rang")
    add_annotation(read_log(whole), mark)
    return data / "transfer"


@pytest.fixture(scope="module")
def built(study, tmp_path_factory):
    said: list[str] = []
    before = fingerprints(study)
    paths = write_report(select(study, say=said.append, processes=1), tmp_path_factory.mktemp("out"))
    return paths, said, before, fingerprints(study)


def test_what_cannot_be_read_is_named_with_its_reason_and_the_rest_is_done(built):
    paths, said, _, _ = built
    assert len(said) == 4
    for name in ("damaged.mcap", "empty.mcap", "foreign.mcap", "sub-09"):
        (line,) = [line for line in said if name in line]
        assert re.match(r"skipped .+: .{20,}", line)
    people = pd.read_parquet(next(path for path in paths if path.name == "participants.parquet"))
    assert people["participant"].tolist() == ["sub-01", "sub-02", "sub-03", "sub-04"]


def test_reading_changes_nothing(built):
    _, _, before, after = built
    assert before == after


@pytest.mark.program
@needs("chromium")
def test_what_is_folded_on_the_screen_is_there_in_print(built):
    """A fold cannot be opened on paper."""
    with browsing() as sit_down:
        page = sit_down(built[0][0].as_uri()).page
        for medium, seen in (("screen", False), ("print", True)):
            page.emulate_media(media=medium)
            folded = page.locator("details:not([open]) table").all()
            assert len(folded) > 5
            assert {table.is_visible() for table in folded} == {seen}


def test_the_page_holds_everything_and_fetches_nothing(built):
    text = built[0][0].read_text()
    assert text.count("<img") == text.count("data:image/png;base64,") == 18
    assert not re.search(r"""(src|href)=["'](?!data:|tables/|participants\.html|#)""", text)
    assert "<script" not in text
    for words in (
        "Excess steps over the shortest path (log scale), block room: direct",
        "Groups of these sizes cannot reach p &lt; 0.05, whatever the difference.",
        "Power: with 2 and 2",
        "needs two participants of a group",
        "The protocol names no primary measure for this block",
        "Groups compared in block room (direct",
        "<th>mean, direct</th><th>mean, grid_first</th>",
        "ln(1 + steps \N{MINUS SIGN} shortest)",
    ):
        assert words in text
    assert "Published" not in text, "another study in the same worlds is not the published one"
    for table in re.findall(r'href="(tables/[^"]+)"', text):
        assert (built[0][0].parent / table).is_file()
    assert text.count("damaged.mcap") >= 1


def test_a_marked_episode_is_listed_and_does_not_count(built):
    paths = {path.name: path for path in built[0]}
    episodes = pd.read_parquet(paths["episodes.parquet"])
    marked = episodes[episodes["exclusion_reason"].notna()]
    assert marked[["participant", "episode", "exclusion_reason"]].to_numpy().tolist() == [
        ["sub-01", 4, "tagged exclude"]
    ]
    assert "tagged exclude" in paths["report.html"].read_text()
    people = pd.read_parquet(paths["participants.parquet"]).set_index("participant")
    assert people["episodes"].tolist() == [3, 4, 4, 4]


def test_the_grids_excess_is_over_the_exact_shortest_path(built):
    episodes = pd.read_parquet(next(path for path in built[0] if path.name == "episodes.parquet"))
    grid = episodes[episodes["block"] == "grid"]
    assert (grid["shortest_steps"] == grid["feasible_steps"]).all()
    assert grid["shortest_steps"].notna().all()


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_second_report_is_the_same_to_the_byte_and_no_figure_of_it_is_drawn(built, study, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("drawn again")

    first = contents(built[0][0].parent)
    monkeypatch.setattr(style, "save_figure", refuse)
    write_report(select(study, processes=1), built[0][0].parent)
    assert contents(built[0][0].parent) == first


@pytest.mark.nightly(by_day=["a mark"])
@pytest.mark.parametrize("became", ["a mark", "another selection"])
def test_a_report_of_what_changed_is_as_if_nothing_had_been_kept(built, study, tmp_path, became):
    changed = shutil.copytree(study, tmp_path / "study", ignore=shutil.ignore_patterns("bad", "sub-09"))
    selection = Selection()
    match became:
        case "a mark":
            one = next((changed / "sub-02").rglob("*.mcap"))
            add_annotation(read_log(one), Annotation("exclude", "2026-01-06T10:00:00Z", episode=1))
        case "another selection":
            selection = Selection(participant=("sub-01", "sub-02"))
    shutil.copytree(built[0][0].parent, tmp_path / "kept")  # with figures of before, some of which are others now
    write_report(select(changed, selection, processes=1), tmp_path / "kept")
    for cache in list(list_caches(changed)):
        shutil.rmtree(cache) if cache.is_dir() else cache.unlink()
    write_report(select(changed, selection, processes=1), tmp_path / "anew")
    assert contents(tmp_path / "kept") == contents(tmp_path / "anew")
    assert contents(tmp_path / "kept") != contents(built[0][0].parent)


@pytest.mark.nightly
def test_the_published_study_stands_beside_its_own_protocol_alone(tmp_path):
    shipped = find_shipped_protocol("fourrooms-transfer").read_bytes()
    changed = shipped.replace(b"seed = 20230623", b"seed = 20230624")
    texts = []
    for name, toml in (("own", shipped), ("changed", changed)):
        for _ in simulate(decode_protocol(toml), tmp_path / name, participants=2, seed=1, player="random"):
            pass
        page, *_ = write_report(
            select(tmp_path / name / "fourrooms-transfer", processes=1), tmp_path / f"{name}-report"
        )
        texts.append(page.read_text())
    own, other = texts
    for words in ("Comparison with the published study", "Reward, block first-person: grid-first minus"):
        assert words in own
    for mean in ("0.93", "0.74", "0.866"):
        assert f"{mean}" in own
    assert "ublished" not in other


def test_two_studies_are_not_mixed(study, tmp_path):
    both = tmp_path / "both"
    shutil.copytree(study / "sub-01", both / "transfer" / "sub-01")
    other = session(participant="sub-01", episodes=1)
    write_log(dataclasses.replace(other, plan=msgspec.structs.replace(other.plan, study="another")), both)
    with pytest.raises(ReportError, match="name the folder of a single study"):
        write_report(select(both, processes=1), tmp_path / "out")


def test_a_report_of_one_version_describes_those_who_played_it_and_no_others(tmp_path):
    """Its methods, its quality, and what its own protocol named before anybody played."""
    for number, primary in ((1, "success"), (2, "reward_mean")):
        toml = f'{PROTOCOL}[analysis]\nprimary_measure = "{primary}"\n'.encode()
        log = session(participant=f"sub-0{number}", index=number, episodes=2)
        plan = msgspec.structs.replace(
            log.plan, study_version=str(number), protocol_toml=toml, protocol_sha256=hashlib.sha256(toml).hexdigest()
        )
        write_log(dataclasses.replace(log, plan=plan), tmp_path)
    with select(tmp_path, Selection(version=("2",)), processes=1) as tables:
        assert read_planned_analysis(tables.read_protocols()).primary_measure == "reward_mean"
        assert [one.outline.participant for one in tables.sessions if one.outline] == ["sub-02"]
        assert [one.quality.participant for one in tables.sessions if one.quality] == ["sub-02"]
    export_study("psych-ds", tmp_path / "transfer", tmp_path / "out", Selection(version=("2",)))
    assert msgspec.json.decode((tmp_path / "out/dataset_description.json").read_bytes())["version"] == "2"
    with pytest.raises(ReportError, match="no session that matches --participant sub-07"):
        write_report(select(tmp_path, Selection(participant=("sub-07",)), processes=1), tmp_path / "none")


def test_a_folder_without_a_log_says_so(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(ReportError, match="contains no readable session log"):
        write_report(select(tmp_path / "empty"), tmp_path / "out")
    with pytest.raises(LogError, match="does not exist"):
        write_report(select(tmp_path / "nowhere"), tmp_path / "out")


def _timeouts(index: int) -> SessionLog:
    """A session of which no episode reached the goal."""
    given_up = [episode(number, seed=index, outcome="timeout", start_ns=number * 10**11) for number in range(2)]
    return session_of(given_up, participant=f"sub-0{index + 1}", index=index, group=("grid_first", "direct")[index % 2])


TINY = {
    "one participant": [session(episodes=2)],
    "no first-person block": [
        session(participant=f"sub-0{index + 1}", index=index, group="ab"[index % 2], seed=index, blocks=("grid",))
        for index in range(4)
    ],
    "only timeouts": [_timeouts(index) for index in range(4)],
}


@pytest.mark.nightly(by_day=["one participant"])
@pytest.mark.parametrize("people", TINY.values(), ids=TINY)
def test_a_tiny_study_has_a_report_and_nobody_is_warned_of_arithmetic(people, tmp_path, capfd):
    for one in people:
        write_log(one, tmp_path / "data")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page, *_ = write_report(select(tmp_path / "data", processes=1), tmp_path / "out")
    told = capfd.readouterr()
    assert (told.out, told.err) == ("", "")
    text = page.read_text()
    assert f"{len(people)} sessions read, 0 skipped" in text
    assert not re.search(r"Warning|mle_retvals|>nan<|\bnan\b|None<", text)
