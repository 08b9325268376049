"""Screens outside of episodes are on the page before the server has heard of the key; what it says counts."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.errors import WorldError
from minihuman.experiment.machine.events import Answered, Noted, PageShown
from minihuman.experiment.machine.inputs import KeyDown, ScreenShown, Tick
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.session_copy import copy_session
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.web import messages
from minihuman.web.outbox import PageSettings
from minihuman.web.prefetch import describe_screen
from minihuman.web.session_host import SessionHost
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.page_model import PageModel
from tests.web.protocols import study
from tests.web.serving import line, serving

MS = 1_000_000
PARTS = """
[[sessions]]
name = "day"
parts = ["read", "asked", "tried"]
[[pages]]
name = "read"
title = "First"
text = "Read this."
[[questions]]
name = "asked"
[[questions.items]]
name = "hand"
kind = "choice"
ask = "Which hand?"
options = ["left", "right"]
[[questions.items]]
name = "sure"
kind = "likert"
ask = "How sure?"
points = 5
"""
TIMED = (
    'inter_trial_interval_ms = 120\nfixation_ms = 90\nfinal_frame_ms = 210\nrest_text = "Rest."\ninstructions = "Go."\n'
)
KEYS = ["enter", "2", "enter", "right", "4", "page_up", "enter", "enter", "enter", "enter", "1", "2", "3"]


def protocol_in(folder: Path) -> Path:
    path = study(folder, max_steps=4, block=TIMED)
    path.write_text(path.read_text().replace('blocks = ["tried"]', "") + PARTS)
    return path


def protocol(folder: Path) -> Protocol:
    return decode_protocol(protocol_in(folder).read_bytes())


class Watching(PageModel):
    """A page that holds what it was told would come against what comes."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.ways: dict[tuple[int, str], int] = {}
        self.right: list[str] = []
        self.wrong: list[str] = []

    def say(self, what: messages.PageMessage) -> None:
        before, said = self._screen.name, _input(what)
        foreseen = self.ways.get((before, said)) if self._screen.screen["kind"] != "play" or self._tick_ns else None
        super().say(what)
        for message in self.told:
            if isinstance(message, messages.ScreenPrefetch):
                self.ways.update({(a, way): b for a, way, b in message.edges})
        if foreseen is not None:
            (self.right if foreseen == self._screen.name else self.wrong).append(said)


def _input(what: messages.PageMessage) -> str:
    match what:
        case messages.KeyMessage(down=True):
            return f"key:{what.key}"
        case messages.TickMessage():
            return "tick"
    return ""


def test_every_screen_that_was_foreseen_is_the_one_that_comes(tmp_path: Path) -> None:
    plan = expand_protocol(found := protocol(tmp_path), enrol_participant(found, 0))
    session = SessionMachine(plan, World, {}, picture_px=(84, 84))
    page = Watching(
        SessionHost(session, MemoryRecorder(), World, PageSettings(picture_px=(84, 84))),
        [((number * 331 + 40) * MS + number, KEYS[number % len(KEYS)], True) for number in range(60)],
        frame_ns=16 * MS,
    )
    page.run()
    assert page.wrong == []
    assert {"key:enter", "key:2", "key:right", "key:page_up", "tick"} <= set(page.right)


def test_a_fork_leaves_the_session_as_it_is(tmp_path: Path) -> None:
    plan = expand_protocol(found := protocol(tmp_path), enrol_participant(found, 0))
    alone, forked = (SessionMachine(plan, World, {}, picture_px=None) for _ in range(2))
    first = True
    for number, key in enumerate(KEYS * 3):
        t_ns = (number + 1) * 400 * MS
        for happened in (Tick(t_ns), ScreenShown(t_ns + MS, t_ns, t_ns + MS), KeyDown(t_ns + 9 * MS, key)):
            if not first:
                try_everything(forked, t_ns)
            first = False
            assert alone.receive(happened) == forked.receive(happened)
    assert alone.phase == forked.phase
    assert describe_screen(alone, lambda _: 0) == describe_screen(forked, lambda _: 0)


def try_everything(session: SessionMachine, t_ns: int) -> None:
    """Go on in forks, each by another key, and then by time."""
    for key in ("enter", "1", "page_up", "escape", "f8"):
        tried = copy_session(session, lambda *_: None)
        tried.receive(ScreenShown(t_ns + 2 * MS, t_ns, t_ns))
        if tried.play is None:  # a step would be one in the session's own world
            with suppress(WorldError):
                tried.receive(KeyDown(t_ns + 5 * MS, key))
                tried.receive(Tick(t_ns + 9_000 * MS))


@pytest.mark.program
@needs("chromium")
def test_with_the_line_cut_what_is_read_answered_and_waited_for_goes_on(tmp_path: Path) -> None:
    path = protocol_in(tmp_path)
    with (
        serving(path, tmp_path) as served,
        line(served.port, rtt_ms=100) as wire_to,
        browsing() as sit_down,
    ):
        somebody = sit_down(f"http://127.0.0.1:{wire_to.port}/#t={served.tokens[0]}")
        somebody.until_seen("s.kind === 'page' && s.foreseen >= 40")  # every way from there, three inputs on
        wire_to.cut()
        somebody.press("enter")
        somebody.until_seen("s.kind === 'question' && s.ahead")
        assert "Which hand?" in somebody.screen()
        somebody.press("1")
        somebody.until_seen("document.querySelector('.option.chosen')?.textContent.includes('left')")
        somebody.press("enter")
        somebody.until("document.querySelector('#ask').textContent === 'How sure?'")
        wire_to.mend()
        somebody.until("s.welcomed && !s.ahead && s.unsafe === 0")
        somebody.press("4", "enter")
        for _ in range(2):
            somebody.to_play()
            somebody.press("1", "2", "1", "2")
            somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
    [log] = tmp_path.rglob("*.mcap")
    events = list(read_events(log))
    answers = {event.item: event.value for event in events if isinstance(event, Answered)}
    assert answers == {"hand": "1", "sure": "4"}
    assert all(event.shown_ns for event in events if isinstance(event, Answered))
    assert any(isinstance(event, PageShown) for event in events)
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == "page"] == []
    assert list(find_log_differences(log, World)) == []
