"""The builder's editors in a browser: trials, consents, replays, a colleague's folder; each in light and in dark."""

import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from minihuman.builder.messages import NewStudyRequest
from minihuman.builder.new_study import make_study
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from tests.builder.hand import Hand, at_the_page
from tests.builder.test_data import TOML as ROOMS
from tests.machine import needs
from tests.web.test_accessible import serious

pytestmark = [needs("chromium"), pytest.mark.program]
NAVIGATION = Path(__file__).parents[2] / "protocols" / "navigation"


def judge(hand: Hand) -> list[str]:
    """Return what axe-core finds on the view as it is, in light and in dark."""
    findings = []
    for colours in ("light", "dark"):
        hand.page.emulate_media(color_scheme=colours, reduced_motion="reduce")  # no colour between two
        findings += serious(hand.page)
    return findings


def read(study: Path) -> dict[str, Any]:
    return tomllib.loads(study.read_text())


@pytest.mark.nightly
def test_a_stimulus_is_moved_and_lengthened_by_mouse_and_by_keys(tmp_path: Path) -> None:
    study = make_study(NewStudyRequest("stop", template="trials/stop-signal"), tmp_path, None)
    with at_the_page(tmp_path) as (hand, address):
        page = hand.page
        page.goto(f"{address}#/study/stop%2Fstop.toml/parts/stop-signal")
        length = page.get_by_label("Length of fixation")
        length.focus()
        page.keyboard.press("ArrowRight")
        hand.wait_until_saved()
        assert read(study)["blocks"][0]["timeline"]["stimuli"][0]["duration_ms"] == 510
        page.get_by_text("for 510 ms").wait_for()  # the bars stand where they will be
        start = page.get_by_label("Start of go")
        box = start.bounding_box()
        page.mouse.move(box["x"] + 20, box["y"] + 5)
        page.mouse.down()
        page.mouse.move(box["x"] + 80, box["y"] + 5, steps=10)
        page.mouse.up()
        page.get_by_text("after the end of fixation").wait_for()
        hand.wait_until_saved()
        go = read(study)["blocks"][0]["timeline"]["stimuli"][1]
        assert go["after"] == "fixation"
        assert go["onset_ms"] > 50
        page.get_by_label("Start of stop").press("Enter")
        page.get_by_role("group", name="stop").get_by_label("Text", exact=True).wait_for()
        assert judge(hand) == []


@pytest.mark.nightly
def test_a_consent_is_filled_in_and_its_record_names_what_is_missing(tmp_path: Path) -> None:
    study = make_study(NewStudyRequest("schlaf", template="one-world", language="de"), tmp_path, None)
    with at_the_page(tmp_path) as (hand, address):
        page = hand.page
        page.goto(f"{address}#/study/schlaf.toml")
        hand.click(hand.button("Add a part to everyone"))
        hand.click(page.locator("dialog").get_by_role("button", name="Consent"))
        hand.type(page.get_by_label("Minuten", exact=True), "20")
        hand.type(page.get_by_label("Was Teilnehmende tun", exact=True), "Sie gehen durch Räume")
        page.get_by_label("Minuten", exact=True).wait_for(state="detached")
        hand.wait_until_saved()
        assert judge(hand) == []
        (consent,) = read(study)["pages"]
        assert "Ihre Aufgabe: Sie gehen durch Räume. Es dauert etwa 20 Minuten." in consent["text"]
        hand.click(hand.button("Change everyone"))
        assert judge(hand) == []
        hand.click(hand.button("Close"))
        hand.click(page.get_by_role("link", name="Settings"))
        hand.click(hand.button("Record of processing"))
        missing = page.get_by_role("status").filter(has_text="Not said yet").inner_text()
        assert "Responsible" in missing
        assert "Minuten" not in missing
        assert judge(hand) == []


def test_an_episode_plays_to_its_end_and_a_participant_who_asks_for_it_is_erased(tmp_path: Path) -> None:
    (tmp_path / "rooms.toml").write_text(ROOMS)
    list(simulate(decode_protocol(ROOMS.encode()), tmp_path / "sessions", participants=2, seed=1, player="random"))
    with at_the_page(tmp_path) as (hand, address):
        page = hand.page
        page.goto(f"{address}#/study/rooms.toml/data")
        hand.click(hand.button("Details of sub-02, session 1"))
        hand.click(page.get_by_role("group", name="Speed").get_by_role("button").last)
        hand.click(hand.button("Play"))
        steps = page.get_by_label("Step", exact=True)
        hand.button("Pause").wait_for(state="detached")
        last = page.locator(".steps tr.now th").inner_text()
        assert (
            last
            == steps.get_attribute("max")
            == str(len(page.locator(".way").last.get_attribute("points").split()) - 1)
        )
        assert judge(hand) == []
        hand.click(page.get_by_label("Withdraw:", exact=False))
        hand.type(page.get_by_label("Reason of the departure"), "asked for it")
        assert hand.button("Erase the data").is_disabled()
        hand.type(page.get_by_label("Type sub-02 to erase"), "sub-02")
        hand.click(hand.button("Erase the data"))
        hand.button("Details of sub-02, session 1").wait_for(state="detached")
        page.get_by_role("status").filter(has_text="minihuman withdraw sub-02").wait_for()
    assert not list((tmp_path / "sessions" / "rooms" / "sub-02").rglob("*.mcap"))


def test_a_folder_is_imported_by_mouse_and_its_code_is_seen_before_it_is_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINIHUMAN_CONFIG", str(tmp_path / "config"))
    lab, sent = tmp_path / "lab", tmp_path / "Water Maze"
    lab.mkdir()
    (sent / ".git").mkdir(parents=True)
    (sent / ".git" / "config.txt").write_text("secret")
    for name in ("water-maze.toml", "water_maze.py"):
        shutil.copy(NAVIGATION / name, sent)
    with at_the_page(lab) as (hand, _):
        page = hand.page
        page.get_by_label("Import a colleague's folder", exact=True).set_input_files(sent)
        page.get_by_text("2 files copied into water-maze; 1 other file left out.").wait_for()
        hand.click(hand.button("Open water-maze", exact=True))
        hand.click(hand.button("Look at the code, then decide"))
        page.get_by_label("Code of water_maze.py").wait_for()
        assert judge(hand) == []
        hand.click(hand.button("I trust this folder"))
        hand.button("Look at the code, then decide").wait_for(state="detached")
    assert sorted(path.name for path in (lab / "water-maze").iterdir()) == ["water-maze.toml", "water_maze.py"]
    assert str(lab / "water-maze") in (tmp_path / "config" / "trust.jsonl").read_text()
