"""Studies that are built with the mouse alone: at most 60 clicks and 400 keystrokes, and `check` accepts the file."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.runtime.simulated_session import simulate
from tests.builder.hand import Hand, at_the_page
from tests.machine import needs

pytestmark = [needs("chromium"), pytest.mark.program]
MOST_CLICKS = 60
MOST_KEYS = 400
WORDS = """\
text\tcolour\tcorrect\tcongruent
RED\t#e03131\tred\tyes
GREEN\t#e03131\tred\tno
RED\t#2f9e44\tgreen\tno
GREEN\t#2f9e44\tgreen\tyes
"""


def add_new(hand: Hand, lane: str, kind: str | re.Pattern[str]) -> None:
    """Add a new part of a kind to a lane, behind the chosen part of this lane."""
    hand.click(hand.button(f"Add a part to {lane}"))
    hand.click(hand.page.locator("dialog").get_by_role("button", name=kind))
    hand.page.locator("dialog").wait_for(state="detached")
    hand.wait_until_saved()


def add_known(hand: Hand, lane: str, part: str) -> None:
    """Add a part that the study has to a lane."""
    add_new(hand, lane, re.compile(f"^{part} (Text|Questions|World)$"))


def chip(hand: Hand, lane: str, part: str) -> Any:
    """Find the first mention of a part in a lane."""
    name = hand.page.locator(".part", has_text=re.compile(f"^{part}$"))
    return hand.page.get_by_role("list", name=f"Parts of {lane}").locator("li.chip").filter(has=name).first


def further(hand: Hand, setting: str) -> Any:
    """Find a setting among the further ones."""
    settings = hand.page.get_by_role("region", name="Further settings")
    return settings.get_by_role("button", name=re.compile(f"^{setting} "))


def expect_budget(hand: Hand, task: str) -> None:
    """Check that a task took no more than a person would bear, and say what it took."""
    print(f"{task}: {hand.clicks} clicks, {hand.keys} keys")
    assert hand.clicks <= MOST_CLICKS
    assert hand.keys <= MOST_KEYS


def check(study: Path) -> Protocol:
    """Check a file as `minihuman check` does, and return its protocol."""
    protocol = read_protocol(study)
    check_worlds(protocol, str(study))
    return protocol


@pytest.mark.nightly
def test_two_groups_three_worlds_a_quiz_that_loops_and_a_questionnaire_after_each_world(tmp_path: Path) -> None:
    study = tmp_path / "rooms.toml"
    with at_the_page(tmp_path) as (hand, _):
        page = hand.page
        hand.click(hand.button("Copy two groups"))
        hand.type(page.get_by_label("Name of your study"), "rooms")
        hand.click(hand.button("Make the study"))
        add_new(hand, "forward", "A text to read")
        hand.type(page.get_by_label("Text", exact=True), "Walk to the green square. Some keys turn you.")
        hand.drag(chip(hand, "forward", "page"), chip(hand, "forward", "world-1"))
        hand.wait_until_saved()
        hand.click(chip(hand, "forward", "page"))  # its place, behind which the quiz comes
        add_new(hand, "forward", "A questionnaire")
        hand.click(page.get_by_role("region", name="Questions").get_by_role("button", name="Choice", exact=True))
        hand.type(page.get_by_label("Ask *"), "Where do you walk?")
        page.get_by_label("Ask *").wait_for()
        hand.type(page.get_by_label("Right", exact=True), "1")
        hand.choose(page.get_by_label("Return to"), "page")
        for part in ("page", "questions"):
            add_known(hand, "backward", part)
        hand.wait_until_saved()
        for part in ("questions", "page"):
            hand.drag(
                chip(hand, "backward", part), chip(hand, "backward", "world-3" if part == "questions" else "questions")
            )
            hand.wait_until_saved()
        for lane, worlds in {"forward": ("world-1", "world-2"), "backward": ("world-3", "world-2")}.items():
            for world in worlds:
                hand.click(chip(hand, lane, world))
                add_known(hand, lane, "opinion")
        hand.wait_until_saved()
        expect_budget(hand, "two groups")
    groups = {group["name"]: group["parts"] for group in tomllib.loads(study.read_text())["groups"]}
    around = ["page", "questions"]
    assert groups["forward"] == [*around, "world-1", "opinion", "world-2", "opinion", "world-3", "opinion"]
    assert groups["backward"] == [*around, "world-3", "opinion", "world-2", "opinion", "world-1", "opinion"]
    protocol = check(study)
    logs = list(simulate(protocol, tmp_path / "sessions", participants=2, seed=1, player="random"))
    assert len(logs) == 2


@pytest.mark.nightly
def test_a_stroop_task_whose_words_are_pasted_from_a_spreadsheet(tmp_path: Path) -> None:
    with at_the_page(tmp_path) as (hand, _):
        page = hand.page
        hand.click(hand.button("Copy stroop"))
        hand.type(page.get_by_label("Name of your study"), "farben")
        hand.click(hand.button("Make the study"))
        hand.click(page.get_by_role("link", name="Tables and media"))
        hand.click(hand.button("Edit the table"))
        hand.paste(page.get_by_label("Name of column 1"), WORDS)
        page.get_by_label("congruent, row 4").wait_for()
        page.get_by_label("congruent, row 5").wait_for(state="detached")
        hand.click(page.get_by_role("link", name="Parts"))
        hand.click(page.get_by_role("list", name="Parts of everyone").locator(".name", has_text="stroop"))
        hand.type(page.get_by_label("Episodes *"), "8")
        hand.type(page.get_by_role("textbox", name="Response deadline"), "1500")
        hand.wait_until_saved()
        expect_budget(hand, "Stroop")
    [study] = tmp_path.glob("*/farben.toml")
    protocol = check(study)
    [block] = [block for block in protocol.blocks if block.stimuli]
    assert (block.episodes, block.response_deadline_ms) == (8, 1500)
    assert protocol.files["stroop.csv"].count(b"\n") == WORDS.count("\n")


def test_a_level_of_ones_own_that_needs_a_key(tmp_path: Path) -> None:
    with at_the_page(tmp_path) as (hand, _):
        page = hand.page
        hand.click(hand.button("Copy one world"))
        hand.type(page.get_by_label("Name of your study"), "locked")
        hand.click(hand.button("Make the study"))
        hand.click(chip(hand, "everyone", "play"))
        hand.click(page.get_by_role("button", name=re.compile("^World: .* choose another$")))
        hand.click(hand.button("Draw a level of your own"))
        level = page.get_by_role("application", name="Cells of the level")
        level.wait_for()
        hand.wait_until_saved()
        middle = 4.5 / 9
        hand.stroke(level, (middle, 1.5 / 7), (middle, 5.5 / 7))
        hand.wait_until_saved()
        for kind, place in (("locked door", (4, 3)), ("key", (1, 4))):
            hand.click(hand.button(kind))
            hand.stroke(level, *(((place[0] + 0.5) / 9, (place[1] + 0.5) / 7),) * 2)
            hand.wait_until_saved()
        hand.type(page.get_by_role("textbox", name="Mission", exact=True).first, "fetch the key and reach the goal")
        hand.wait_until_saved()
        hand.wait_for_preview("Go on")
        expect_budget(hand, "own level")
    study = tomllib.loads((tmp_path / "locked.toml").read_text())
    [block] = study["blocks"]
    assert block["options"]["diagram"].splitlines()[3:5] == ["WW      Ly      WW", "WWKy    WW      WW"]
    assert block["options"]["mission"] == "fetch the key and reach the goal"
    assert {"pickup", "toggle"} <= set(block["actions"])
    check(tmp_path / "locked.toml")


@pytest.mark.nightly
def test_a_kitchen_for_two_people_or_one_with_an_agent(tmp_path: Path) -> None:
    with at_the_page(tmp_path) as (hand, _):
        page = hand.page
        hand.click(page.get_by_role("region", name="Begin with").get_by_role("button", name="Copy team", exact=True))
        hand.type(page.get_by_label("Name of your study"), "kitchen")
        hand.click(hand.button("Make the study"))
        hand.click(hand.button("+ Add a group"))
        chip(hand, "group", "play").wait_for()
        hand.click(hand.button("Change group"))
        hand.type(page.get_by_label("Name of the group"), "with-agent")
        hand.click(hand.button("Close"))
        hand.click(chip(hand, "with-agent", "play"))
        hand.click(
            page.get_by_role("group", name="For whom these settings are").get_by_role("button", name="with-agent")
        )
        hand.click(hand.button("Further settings", exact=False))
        hand.click(further(hand, "Team"))
        hand.click(hand.button("Add team"))
        hand.choose(page.get_by_label("Seat 2"), "scripted:cook")
        hand.wait_until_saved()
        for lane in ("everyone", "with-agent"):
            hand.click(chip(hand, lane, "play"))
            if lane == "everyone":
                add_new(hand, lane, "A questionnaire")
                hand.click(
                    page.get_by_role("region", name="Questions").get_by_role("button", name="Likert", exact=True)
                )
                hand.type(page.get_by_label("Ask *"), "We worked together well.")
            else:
                add_known(hand, lane, "questions")
        hand.wait_until_saved()
        expect_budget(hand, "kitchen")
    protocol = check(tmp_path / "kitchen.toml")
    assert "interact" in protocol.blocks[0].actions
    seats = {group.name: protocol.block_for("play", group.name).team.seats for group in protocol.groups}
    assert seats == {"everyone": ("person", "person"), "with-agent": ("person", "scripted:cook")}
    assert [group.parts for group in protocol.groups] == [("play", "questions")] * 2


@pytest.mark.nightly
def test_two_days_of_which_the_second_ends_with_a_questionnaire(tmp_path: Path) -> None:
    with at_the_page(tmp_path) as (hand, _):
        page = hand.page
        hand.click(hand.button("Copy one world"))
        hand.type(page.get_by_label("Name of your study"), "retention")
        hand.click(hand.button("Make the study"))
        hand.click(hand.button("+ Add a group"))
        chip(hand, "group", "play").wait_for()
        hand.click(hand.button("+ Add a day"))
        chip(hand, "day-2 · group", "play").wait_for()
        hand.click(hand.button("Change day-2 · group"))
        hand.type(page.get_by_role("textbox", name="Days after previous"), "6")
        hand.type(page.locator("[id$=days_after_previous-second]"), "8")
        hand.type(page.get_by_label("Name of the group"), "shown")
        hand.click(hand.button("Close"))
        hand.click(chip(hand, "day-2 · everyone", "play"))
        add_new(hand, "day-2 · everyone", "A questionnaire")
        hand.click(page.get_by_role("region", name="Questions").get_by_role("button", name="Slider", exact=True))
        hand.type(page.get_by_label("Ask *"), "How much did you remember?")
        hand.click(chip(hand, "day-1 · shown", "play"))
        hand.click(page.get_by_role("group", name="For whom these settings are").get_by_role("button", name="shown"))
        hand.click(hand.button("Further settings", exact=False))
        hand.click(further(hand, "Show keys"))
        hand.click(page.get_by_label("Show keys"))
        hand.wait_until_saved()
        expect_budget(hand, "two days")
    protocol = check(tmp_path / "retention.toml")
    assert [session.parts for session in protocol.sessions] == [("play",), ("play", "questions")]
    assert protocol.sessions[1].days_after_previous == (6, 8)
    assert [protocol.block_for("play", group).show_keys for group in ("everyone", "shown")] == [False, True]
