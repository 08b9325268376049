"""Two people in Chromium write to each other and mark cells while they play."""

import re
from pathlib import Path
from typing import Any

import pytest

from minihuman.activities.team.events import JointStepped, TeamFormed
from minihuman.activities.team.message_events import MessageEdited, MessageShown, MessageTyped
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import EpisodeStarted, Event, KeyPressed, Noted, TextTyped
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.activities.team.test_messages import talk_study
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.serving import serving

pytestmark = needs("chromium")

WORDS = " go left: 1 2 3, 火\N{NO-BREAK SPACE}می\N{ZERO WIDTH NON-JOINER}خواهم"
CELLS = """() => {
  const canvas = document.querySelector("#screen canvas").getBoundingClientRect();
  return [...document.querySelectorAll(".cell")].map((cell) => {
    const box = cell.getBoundingClientRect();
    return [(box.left - canvas.left) / canvas.width, (box.top - canvas.top) / canvas.height,
      box.width / canvas.width, box.height / canvas.height];
  });
}"""


def write(somebody: Somebody, text: str) -> None:
    somebody.press("enter")
    somebody.page.wait_for_selector(".chat [data-target=field]")
    somebody.page.keyboard.insert_text(text)
    somebody.press("enter")
    somebody.page.wait_for_selector(".chat [data-target=field]", state="detached")


def until_reads(somebody: Somebody, *said: str) -> None:
    """Wait until these words, and no others, stand below the picture."""
    want = [re.sub(" +", " ", line) for line in said]
    somebody.page.wait_for_function(
        "(want) => JSON.stringify([...document.querySelectorAll('.chat .lines p')]"
        ".map((line) => line.textContent.replace(/ +/g, ' '))) === JSON.stringify(want)",
        arg=want,
    )


@pytest.mark.nightly(by_day=["turns"])
@pytest.mark.program
@pytest.mark.parametrize("pace", ["turns", "ticks"])
def test_words_and_marks_are_on_both_screens_and_in_both_logs(tmp_path: Path, pace: str) -> None:
    path = talk_study(tmp_path)
    if pace == "ticks":
        ticks = 'view = "full"\npace = "real_time"\nstep_period_ms = 200\noptions = { max_steps = 100_000 }'
        text = path.read_text(encoding="utf-8").replace("max_steps = 3", "max_steps = 100_000")
        path.write_text(text.replace('view = "full"', ticks), encoding="utf-8")
    with serving(path, tmp_path, links=2) as server, browsing() as sit_down:
        people = [sit_down(f"http://127.0.0.1:{server.port}/#t={token}") for token in server.tokens]
        for somebody in people:
            somebody.until("s.welcomed && s.kind !== ''")
        while not all(somebody.state["playing"] and somebody.state["known"] for somebody in people):
            for somebody in people:
                if somebody.state["kind"] != "play":
                    somebody.press("enter")
            people[0].page.wait_for_timeout(60)
        for somebody in people:
            somebody.page.wait_for_selector(".chat")
            if somebody.page.locator(".chat [data-target=field]").count():  # an Enter that came as it began
                somebody.press("enter")
        one, two = people
        write(one, WORDS)
        until_reads(one, f"You {WORDS}")
        two.page.wait_for_function("document.querySelector('.chat .lines p') !== null")
        author = two.page.locator(".chat .lines b").inner_text()
        until_reads(two, f"{author} {WORDS}")
        two.page.keyboard.press("F2")
        until_reads(two, f"{author} {WORDS} (reported)")
        two.press("m")
        shown = []
        for somebody in people:
            somebody.page.wait_for_selector(".cell")
            shown.append(somebody.page.evaluate(CELLS))
        if pace == "turns":
            one.page.screenshot(path=tmp_path / "one.png")
        for somebody in people:
            somebody.page.wait_for_selector(".cell", state="detached")
        one.page.reload()
        one.until_seen("s.welcomed && s.kind !== ''")
        if one.state["kind"] == "text":  # in ticks a page that is loaded again is a pause
            one.press("enter")
        one.until("s.playing")
        until_reads(one, f"You {WORDS}")
        server.kill()
        server.again()
        until_reads(two, f"{author} {WORDS} (reported)")
        until_reads(one, f"You {WORDS}")
        for somebody in people if pace == "turns" else []:
            assert somebody.state["step"] == 0, "what was typed moved nobody"
        assert [somebody.errors for somebody in people] == [[], []]
        server.stop()
    logs = [list(read_events(log)) for log in sorted(tmp_path.rglob("*.mcap*"))]
    author_log, other_log = sorted(logs, key=lambda events: not find(events, MessageEdited))
    assert find(author_log, MessageTyped) == []
    assert [event.text for event in find(author_log, MessageEdited)] == [WORDS]
    assert [event.text for event in find(author_log, MessageShown) if not event.cell] == [WORDS]
    assert [event.text for event in find(other_log, MessageShown) if not event.cell] == [""]
    assert WORDS not in repr(other_log)
    for events in logs:
        assert find(events, TextTyped) == []
        assert [event for event in find(events, KeyPressed) if event.verdict == "typing"] == []
    [mark] = {(event.seat, *event.cell) for events in logs for event in find(events, MessageShown) if event.cell}
    assert mark[0] == find(other_log, TeamFormed)[0].seat
    left, top, right, bottom = find(other_log, EpisodeStarted)[0].map.bounds
    x, z, width, height = mark[1] - 0.5 - left, mark[2] - 0.5 - top, right - left, bottom - top
    for boxes in shown:
        assert boxes == [pytest.approx([x / width, z / height, 1 / width, 1 / height], abs=0.01)]
    assert len([note for note in find(other_log, Noted) if note.kind == "report"]) == 1
    assert [list(find_log_differences(log, World)) for log in tmp_path.rglob("*.mcap*")] == [[], []]
    assert [good for _, good in verify_teams(tmp_path / "duet")] == [True]
    assert pace == "ticks" or all(find(events, JointStepped) == [] for events in logs)


def start_talk(people: list[Somebody]) -> None:
    """Go on until all play, with no field open."""
    for somebody in people:
        somebody.until("s.welcomed && s.kind !== ''")
    while not all(somebody.state["playing"] and somebody.state["known"] for somebody in people):
        for somebody in people:
            if somebody.state["kind"] != "play":
                somebody.press("enter")
        people[0].page.wait_for_timeout(60)
    for somebody in people:
        somebody.page.wait_for_selector(".chat")
        if somebody.page.locator(".chat [data-target=field]").count():  # an Enter that came with the episode's start
            somebody.press("enter")
            somebody.page.wait_for_selector(".chat [data-target=field]", state="detached")


@pytest.mark.nightly
@pytest.mark.program
def test_a_message_is_edited_by_the_browser_while_the_partners_words_come(tmp_path: Path) -> None:
    with serving(talk_study(tmp_path), tmp_path, links=2) as server, browsing() as sit_down:
        people = [sit_down(f"http://127.0.0.1:{server.port}/#t={token}") for token in server.tokens]
        start_talk(people)
        one, two = people
        page = one.page
        line = page.context.new_cdp_session(page)
        one.press("enter")
        page.wait_for_selector(".chat [data-target=field]")
        page.keyboard.type("go rigth")
        page.click(".picture")  # no key of what follows is the game's
        page.keyboard.type("!")
        write(two, "where?")
        until_reads(one, f"{two_name(one)} where?")
        page.keyboard.press("Backspace")
        page.keyboard.press("Control+z")
        page.keyboard.press("Control+Shift+ArrowLeft")
        page.keyboard.press("Control+Shift+ArrowLeft")
        page.keyboard.insert_text("right ")
        line.send("Input.imeSetComposition", {"text": "ひだ", "selectionStart": 2, "selectionEnd": 2})
        line.send("Input.insertText", {"text": "左"})
        shown = page.input_value(".chat [data-target=field]")
        one.page.screenshot(path=tmp_path / "field.png")
        one.press("enter")
        page.wait_for_selector(".chat [data-target=field]", state="detached")
        until_reads(one, f"{two_name(one)} where?", f"You {shown}")
        one.press("enter")
        page.wait_for_selector(".chat [data-target=field]")
        page.keyboard.insert_text("x" * 201)
        page.wait_for_selector(".chat .limit:not([hidden])")
        one.page.screenshot(path=tmp_path / "long.png")
        assert [somebody.state["step"] for somebody in people] == [0, 0]
        assert [somebody.errors for somebody in people] == [[], []]
        server.stop()
    logs = [list(read_events(log)) for log in tmp_path.rglob("*.mcap*")]
    texts = [event.text for events in logs for event in find(events, MessageEdited)]
    assert shown in texts
    assert sorted(event.text for events in logs for event in find(events, MessageShown)) == ["", "", shown, "where?"]
    keys = {event.key for events in logs for event in find(events, KeyPressed)}
    assert keys == {"enter"}, keys
    assert [list(find_log_differences(log, World)) for log in tmp_path.rglob("*.mcap*")] == [[], []]


def two_name(reader: Somebody) -> str:
    """The name of the last message's author as a reader's page has it."""
    reader.page.wait_for_selector(".chat .lines b")
    return str(reader.page.locator(".chat .lines b").first.inner_text())


def find(events: list[Event], kind: type) -> list[Any]:
    return [event for event in events if isinstance(event, kind)]
