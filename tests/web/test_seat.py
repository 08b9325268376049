"""A seat is a window: the same inputs give the same events; and killed anywhere, it goes on as if nothing had been."""

import random
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import (
    Event,
    KeyPressed,
    Linked,
    Noted,
    SessionStarted,
    Stepped,
)
from minihuman.experiment.machine.inputs import KeyDown, KeyUp, Stop
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay, resume_from_events
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.web import messages
from minihuman.web.computed import PageWorld
from minihuman.web.outbox import PageSettings
from minihuman.web.session_host import SessionHost
from minihuman.web.traffic_limits import PREFETCH_BACKLOG
from minihuman.worlds.adapters.world import World
from tests.web.page_model import PageModel, Press
from tests.web.protocols import GRID, study

MS = 1_000_000
FRAME_NS = 16 * MS
SETTINGS = PageSettings(picture_px=(84, 84))
TIMED = "inter_trial_interval_ms = 120\nfixation_ms = 90\nfinal_frame_ms = 210\n"
REAL_TIME = 'pace = "real_time"\nstep_period_ms = 150\nnoop_action = "done"\n'
PAGES = 'instructions = "Go."\nrest_text = "Rest."\n'
DESIGN = 'design = { name = "level-replay", settings = { seeds = [3, 4, 5], replay = 0.6 } }\n'
WITH_DONE = GRID[0], (*GRID[1], "done")


def plan_of(folder: Path, block: str, world: Any = GRID):
    protocol = decode_protocol(
        study(folder, world, max_steps=9, block=block).read_bytes().replace(b'"3"]', b'"3", "4"]')
    )
    return expand_protocol(protocol, enrol_participant(protocol, 0))


def script(*, every_ms: int = 170, count: int = 90) -> list[Press]:
    """Keys that go on and that mean something, a pause, a question, a tap of Escape."""
    keys = ["enter", "1", "2", "3", "1", "4", "f8", "enter", "2", "escape", "3", "enter", "2", "1", "x"]
    presses: list[Press] = []
    for number in range(count):
        t_ns = (number * every_ms + 37) * MS + number * 1001
        key = keys[number % len(keys)]
        presses += [(t_ns, key, True), (t_ns + 51 * MS, key, False)]
    return presses


def through_window(plan, presses: Sequence[Press]) -> list[Event]:
    clock, recorder = VirtualClock(), MemoryRecorder()
    inputs = [(KeyDown if down else KeyUp)(t_ns, key) for t_ns, key, down in presses]
    window = ScriptedWindow(inputs, clock, frame_ns=FRAME_NS)
    run_session(SessionMachine(plan, World, {"window": "scripted"}, picture_px=(84, 84)), window, recorder, clock)
    return recorder.events


def through_seat(
    plan, presses: Sequence[Press], *, closes: bool = True, computes: bool = False
) -> tuple[list[Event], PageModel]:
    recorder = MemoryRecorder()
    session = SessionMachine(plan, PageWorld, {"window": "web"}, picture_px=(84, 84), renders_steps=False)
    seat = SessionHost(session, recorder, PageWorld, SETTINGS)
    seat.restart(computes=computes)
    page = PageModel(seat, presses, frame_ns=FRAME_NS)
    page.run()
    if closes and not seat.over:
        seat.stop(Stop(max(seat.last_at_ns, presses[-1][0]), "window_closed", "the script has ended"))
    seat.close()
    return recorder.events, page


def about(event: Event) -> tuple[Any, ...]:
    """An event with its times to the microsecond: a page's messages are a nanosecond apart at least."""
    values: list[Any] = []
    for field in fields(event):
        value = getattr(event, field.name)
        if field.name.endswith("_ns") and value is not None:
            value = round(value / 1000)
        values.append(round(value, 3) if field.name == "rt_ms" and value is not None else value)
    return type(event), *values


@pytest.mark.parametrize(
    ("block", "world"),
    [("", GRID), (TIMED, GRID), (PAGES, GRID), (REAL_TIME, WITH_DONE), ("auto_repeat = true\n", GRID), (DESIGN, GRID)],
    ids=["plain", "timed", "pages", "real-time", "repeat", "design"],
)
def test_the_same_inputs_give_the_same_events_as_in_a_window_but_for_facts(tmp_path: Path, block: str, world) -> None:
    plan, presses = plan_of(tmp_path, block, world), script()
    window, (seat, page) = through_window(plan, presses), through_seat(plan, presses)
    pictures = [told for told in page.told if isinstance(told, messages.PictureMessage)]
    assert {(picture.width, picture.height) for picture in pictures} == {(84, 84)}, "nothing undrawn is shown"
    for one, other in zip(seat[1:], window[1:], strict=False):
        assert about(one) == about(other)
    assert len(seat) == len(window)
    assert sum(isinstance(event, Stepped) for event in seat) > 9
    assert isinstance(seat[0], SessionStarted)
    assert find_violations(seat) == []
    assert list(compare_replay(seat, World)) == []


@pytest.mark.parametrize("block", ["", TIMED, "auto_repeat = true\n"], ids=["plain", "timed", "repeat"])
def test_what_a_page_computes_is_what_a_window_shows_and_nothing_is_looked_ahead(tmp_path: Path, block: str) -> None:
    plan, presses = plan_of(tmp_path, block), script()
    window, (seat, page) = through_window(plan, presses), through_seat(plan, presses, computes=True)
    assert [about(event) for event in seat[1:]] == [about(event) for event in window[1:]]
    assert sum(isinstance(event, Stepped) for event in seat) > 9
    assert find_violations(seat) == []
    told = [type(message) for message in page.told]
    assert told.count(messages.LookAheadUpdate) == 0
    assert told.count(messages.PictureMessage) <= 2, "but for those that stay at an episode's end"
    assert told.count(messages.ArraysMessage) == 1


def test_word_of_a_picture_and_of_the_line_is_answered_with_nothing(tmp_path: Path) -> None:
    session = SessionMachine(plan_of(tmp_path, ""), World, {"window": "web"}, picture_px=(84, 84), renders_steps=False)
    seat = SessionHost(session, MemoryRecorder(), World, SETTINGS)
    page = PageModel(seat, [(t_ns * MS, "enter", True) for t_ns in (400, 800)], frame_ns=FRAME_NS)
    page.run()
    number, at_ns, said = page.sent[-1].n, page.sent[-1].at, seat.outgoing.last_number
    shown = messages.DisplayedMessage(at_ns, at_ns, episode=0, step=0)
    for more, what in enumerate(
        (shown, messages.RoundTripMessage(1, 2, 3, 4, 4), shown, messages.KeyMessage("1", True, at_ns)), 1
    ):
        assert seat.outgoing.last_number == said
        seat.receive(number + more, at_ns + more, what)
    [now] = [message for _, message in seat.outgoing.after(said) if isinstance(message, messages.EpisodeState)]
    assert (now.through, now.step) == (number + 4, 1)
    seat.close()


@pytest.mark.parametrize(
    ("block", "world", "computes"),
    [(TIMED, GRID, False), (TIMED, GRID, True), (REAL_TIME, WITH_DONE, False), (DESIGN, GRID, False)],
    ids=["timed", "computed", "real-time", "design"],
)
def test_killed_after_any_event_it_goes_on_where_it_was(tmp_path: Path, block: str, world, computes: bool) -> None:
    """Everything that was not acknowledged is said again, to a machine that was fed its own log."""
    plan = plan_of(tmp_path, block, world)
    events, page = through_seat(plan, script(count=24), closes=False, computes=computes)
    for kept in [*range(1, len(events), 7), *range(len(events) - 3, len(events))]:
        logged = events[:kept]
        session, unwritten = resume_from_events(logged, PageWorld, picture_px=(84, 84))
        recorder = MemoryRecorder()
        recorder.write(logged)
        seat = SessionHost(session, recorder, PageWorld, SETTINGS, logged=logged, unwritten=unwritten)
        seat.restart(computes=computes)
        for said in page.sent:
            seat.receive(said.n, said.at, said.what)
        seat.close()
        assert recorder.events[: len(events)] == events, kept


def a_seat(folder: Path, block: str = "") -> tuple[SessionHost, MemoryRecorder]:
    recorder = MemoryRecorder()
    return SessionHost(
        SessionMachine(plan_of(folder, block), World, {}, picture_px=(84, 84)), recorder, World, SETTINGS
    ), recorder


def playing(folder: Path) -> tuple[SessionHost, MemoryRecorder, PageModel]:
    """A seat in its first episode."""
    seat, recorder = a_seat(folder)
    page = PageModel(seat, [(300 * MS, "enter", True)], frame_ns=FRAME_NS)
    page.run()
    assert seat.session.play is not None
    return seat, recorder, page


def test_word_of_a_wrong_scene_is_noted(tmp_path: Path) -> None:
    _, recorder, page = playing(tmp_path)
    page.say(messages.DisplayedMessage(400 * MS, 410 * MS, episode=0, step=0, node=12345))
    [note] = [event for event in recorder.events if isinstance(event, Noted) and event.kind == "page"]
    assert "step 0 of episode 1 was shown as scene 12345" in note.text


def test_keys_that_no_finger_pressed_are_noted(tmp_path: Path) -> None:
    _, recorder, page = playing(tmp_path)
    page.say(messages.KeyMessage("2", True, 520 * MS, trusted=False))
    note, press = [event for event in recorder.events if isinstance(event, Noted | KeyPressed)][-2:]
    assert isinstance(note, Noted)
    assert "made by a script" in note.text
    assert isinstance(press, KeyPressed)


def test_a_keys_time_is_the_events_though_it_came_later(tmp_path: Path) -> None:
    seat, recorder, page = playing(tmp_path)
    seat.receive(len(page.sent) + 1, 900 * MS, messages.KeyMessage("2", True, 880 * MS))
    press = next(event for event in reversed(recorder.events) if isinstance(event, KeyPressed))
    assert (press.t_ns, press.waited_ns) == (900 * MS, 20 * MS)


def test_the_line_is_measured_by_its_quickest_message(tmp_path: Path) -> None:
    seat, recorder, page = playing(tmp_path)
    page.say(
        messages.RoundTripMessage(sent=100 * MS, received=5120 * MS, answered=5121 * MS, back=151 * MS, latest=80 * MS)
    )
    linked = next(event for event in recorder.events if isinstance(event, Linked))
    assert (linked.least_rtt_ns, linked.rtt_ns, linked.error_ns) == (50 * MS, 80 * MS, 25 * MS)
    assert linked.offset_ns == 4995 * MS
    assert seat.link.rtt_ns == 50 * MS


@pytest.mark.parametrize(("rate", "named"), [(1.0, 0), (1.0002, 0), (0.97, 5), (1.03, 5)])
def test_a_page_whose_time_runs_otherwise_than_the_servers_is_named(tmp_path: Path, rate: float, named: int) -> None:
    """Arrival decides, not what the page says of its pings; the first minute shows what the line is like."""
    seat, recorder, page = playing(tmp_path)
    number, zero_ns = len(page.sent), page.sent[-1].at
    chance = random.Random(4)
    for at_s in range(1, 111):
        number += 1
        at_ns = zero_ns + round(at_s * 1000 * MS * rate)
        link = messages.RoundTripMessage(at_ns, at_ns, at_ns, at_ns + 40 * MS, 40 * MS)
        what = link if at_s % 10 == 1 else messages.FocusMessage(at_s % 2 == 0)
        arrival_ns = 7_000 * MS + at_s * 1000 * MS + 20 * MS + chance.choice((0, 5, 2_500)) * MS  # after an outage
        seat.receive(number, at_ns, what, arrival_ns=arrival_ns)
    notes = [event.text for event in recorder.events if isinstance(event, Noted)]
    said = [text for text in notes if "the page's time moved" in text]
    assert len(said) >= named if named else said == []
    if named:
        moved_ms = [int(text.split("by ")[1].split(" ")[0]) for text in said]
        assert all((moved > 0) is (rate > 1) and abs(moved) > 200 for moved in moved_ms)


def test_what_led_to_no_event_is_safe_with_what_follows(tmp_path: Path) -> None:
    """When a text was shown is only in what is measured by it: it is kept by the page until that is on the disk."""
    seat, _ = a_seat(tmp_path)
    seat.receive(1, 1 * MS, messages.TickMessage())
    assert seat.safe() == 1
    seat.receive(2, 20 * MS, messages.DisplayedMessage(1 * MS, 17 * MS, screen=1))
    assert seat.safe() == 1
    seat.receive(3, 500 * MS, messages.KeyMessage("x", True, 500 * MS))
    assert seat.safe() == 3


@pytest.mark.parametrize("first", [messages.TickMessage(), messages.KeyMessage("enter", True, 4 * MS)])
def test_a_log_begins_with_the_session_whatever_is_noted_of_the_page_before(tmp_path: Path, first: Any) -> None:
    """A page whose first message comes after its server was killed may be ahead of the next server's clock."""
    seat, recorder = a_seat(tmp_path)
    seat.note("the page's time was claimed to be 1.6 s ahead of the server's")
    seat.receive(1, 5 * MS, first)
    assert isinstance(recorder.events[0], SessionStarted)
    assert [event.t_ns for event in recorder.events if isinstance(event, Noted) and event.kind == "page"] == [5 * MS]


def test_time_that_does_not_go_on_is_refused(tmp_path: Path) -> None:
    seat, _ = a_seat(tmp_path)
    seat.receive(1, 5 * MS, messages.TickMessage())
    with pytest.raises(messages.MessageError, match="which is not after"):
        seat.receive(2, 5 * MS, messages.TickMessage())


def test_the_experimenters_wish_has_the_pages_time(tmp_path: Path) -> None:
    seat, recorder, page = playing(tmp_path)
    seat.ask("note", "sneezed")
    page.say(messages.CommandEcho(7))  # nobody asked for that
    page.say(messages.CommandEcho(1))
    page.say(messages.CommandEcho(1))  # said twice, it is done once
    asked = [event for event in recorder.events if isinstance(event, Noted) and event.kind == "experimenter"]
    assert [event.text for event in asked] == ["note: sneezed"]


def test_a_new_page_is_told_all_that_there_is_to_show(tmp_path: Path) -> None:
    seat, _, page = playing(tmp_path)
    assert seat.session.play is not None
    key = next(iter(seat.session.play.plan.key_map.keys))
    page.say(messages.KeyMessage(key, True, 340 * MS))
    seat.restart()
    told = [message for _, message in seat.outgoing.after(0)]
    kinds = [type(message) for message in told]
    assert kinds.index(messages.EpisodeRules) < kinds.index(messages.ScreenMessage) < kinds.index(messages.EpisodeState)
    assert messages.PictureMessage in kinds
    now = told[kinds.index(messages.EpisodeState)]
    assert isinstance(now, messages.EpisodeState)
    assert (now.step, now.through) == (1, len(page.sent))


def test_a_page_that_hears_nothing_is_not_told_ever_more(tmp_path: Path) -> None:
    plan = expand_protocol(
        protocol := decode_protocol(study(tmp_path, episodes=8, max_steps=30).read_bytes()),
        enrol_participant(protocol, 0),
    )
    seat = SessionHost(
        SessionMachine(plan, World, {"window": "web"}, picture_px=(84, 84)), MemoryRecorder(), World, SETTINGS
    )
    page = PageModel(seat, script(count=300), frame_ns=FRAME_NS)
    page.hears = False
    page.run(lambda: seat.outgoing.n_unacknowledged > PREFETCH_BACKLOG)
    assert seat.outgoing.n_unacknowledged > PREFETCH_BACKLOG
    assert not seat.grow()
    seat.outgoing.acknowledge(seat.outgoing.last_number)
    assert seat.outgoing.n_unacknowledged == 0
    seat.close()


def test_a_page_lets_go_of_the_pictures_of_episodes_that_are_over(tmp_path: Path) -> None:
    plan = expand_protocol(
        protocol := decode_protocol(study(tmp_path, episodes=8, max_steps=9).read_bytes()),
        enrol_participant(protocol, 0),
    )
    seat = SessionHost(
        SessionMachine(plan, World, {"window": "web"}, picture_px=(84, 84)), MemoryRecorder(), World, SETTINGS
    )
    page, held = PageModel(seat, script(count=300), frame_ns=FRAME_NS), [0]

    def looks() -> bool:
        held.append(len(page.pictures))
        return False

    page.run(looks)
    sent = sum(isinstance(message, messages.PictureMessage) for message in page.told)
    assert seat.over
    assert max(held) < sent / 3, "it has pictures of many episodes"
    seat.close()
