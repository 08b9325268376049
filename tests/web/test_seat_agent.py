"""A seat with an agent beside the person: the same events as in a window, and what the page is told ahead."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from minihuman.activities.agent_blocks.events import Advised, ControlChanged, PolicyGiven
from minihuman.activities.agent_blocks.requests import Advice, AdviceRequest, NewPolicy, PolicyRequest
from minihuman.activities.clip_requests import ClipRequest, EpisodeRequest
from minihuman.activities.correction.events import CorrectionSeen
from minihuman.activities.episode_clips import ClipOffered, EpisodeClip
from minihuman.activities.preferences.events import PairSeen, Preferred
from minihuman.activities.rating.events import Rated
from minihuman.agents.agent import BaseAgent, make_agent
from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import Event, Stepped
from minihuman.experiment.machine.inputs import ActivityInput, KeyDown, KeyUp, Stop
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay, resume_from_events
from minihuman.log.model.teaching_events import gather_corrections
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.web import messages
from minihuman.web.session_host import SessionHost
from minihuman.worlds.adapters.world import World
from tests.web.page_model import PageModel, Press
from tests.web.protocols import GRID, study
from tests.web.test_seat import FRAME_NS, MS, SETTINGS, about

TAKEOVER = 'kind = "takeover"\nfinal_frame_ms = 200\nagent = { policy = "optimal:0.3", step_ms = 300 }\n'
RATING = 'kind = "rating"\nfinal_frame_ms = 200\nagent = { policy = "optimal:0.3", step_ms = 300 }\n'
LEARNING = 'kind = "takeover"\nagent = { policy = "optimal:0.3", learner = "any", step_ms = 300, wait_s = 5 }\n'
PAIRS = """
[[activities]]
name = "compare"
kind = "preferences"
settings = { source = "tried", pairs = 3, steps = 2, step_ms = 100 }
"""
ANSWERS = (PolicyGiven, Advised)
STRETCHES = tuple(EpisodeClip(0, 1, 0, GRID[0], "{}", seed, (2, 2)) for seed in (1, 2))
CORRECTIONS = """
[[activities]]
name = "correct"
kind = "correction"
settings = { source = "tried", episodes = 2, steps = 4 }
"""
FILMS = tuple(EpisodeClip(number, 1, 0, GRID[0], "{}", 3 + number, (2, 0, 2, 2)) for number in (0, 1))


class Beside(RequestHandler):
    """Answers at once, as whoever plays beside the person does; a learner after it was asked so often."""

    def __init__(self, learns_after: int = 3) -> None:
        self.closed = False
        self.asked = 0
        self._learns_after = learns_after
        self._agent: BaseAgent | None = None
        self._episode = -1

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        match want:
            case PolicyRequest(learning=True):
                self.asked += 1
                return NewPolicy(t_ns, "optimal:0") if self.asked % self._learns_after == 0 else None
            case PolicyRequest():
                return NewPolicy(t_ns, want.policy)
            case ClipRequest():
                return ClipOffered(t_ns, STRETCHES[want.place])
            case EpisodeRequest():
                return ClipOffered(t_ns, FILMS[want.number])
            case AdviceRequest() if play is not None:
                if self._agent is None or play.plan.episode != self._episode:
                    self._agent, self._episode = make_agent(want.policy), play.plan.episode
                    self._agent.begin(play.plan, play.world)
                return Advice(
                    t_ns, want.step, tuple(float(chance) for chance in self._agent.action_probabilities(play.world))
                )
        return None

    def close(self) -> None:
        self.closed = True


def plan_of(folder: Path, block: str, more: str = "", parts: str = ""):
    text = study(folder, GRID, max_steps=9, block=block, more="").read_text() + more
    if parts:
        text = text.replace('blocks = ["tried"]', f"parts = {parts}")
    protocol = decode_protocol(text.encode())
    return expand_protocol(protocol, enrol_participant(protocol, 0))


def script(keys: Sequence[str], *, every_ms: int = 370, count: int = 60) -> list[Press]:
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
    session = SessionMachine(plan, World, {"window": "scripted"}, picture_px=(84, 84))
    run_session(session, window, recorder, clock, agent=Beside())
    return recorder.events


def through_seat(plan, presses: Sequence[Press], *, closes: bool = True) -> tuple[list[Event], PageModel]:
    recorder = MemoryRecorder()
    session = SessionMachine(plan, World, {"window": "web"}, picture_px=(84, 84))
    seat = SessionHost(session, recorder, World, SETTINGS, agent=Beside())
    page = PageModel(seat, presses, frame_ns=FRAME_NS)
    page.run()
    if closes and not seat.over:
        seat.stop(Stop(max(seat.last_at_ns, presses[-1][0]), "window_closed", "the script has ended"))
    seat.close()
    return recorder.events, page


def assert_alike(seat: list[Event], window: list[Event]) -> None:
    """The same, but for when what comes from outside was answered: a window is shown first."""
    others = [[about(event) for event in events[1:] if not isinstance(event, ANSWERS)] for events in (seat, window)]
    assert others[0] == others[1]
    answers = [[replace(event, t_ns=0) for event in events if isinstance(event, ANSWERS)] for events in (seat, window)]
    assert answers[0] == answers[1]


@pytest.mark.parametrize(
    ("block", "keys", "expected"),
    [
        (TAKEOVER, ["enter", "1", "x", "2", "space", "x", "x", "3", "1", "space", "f8", "enter"], ControlChanged),
        (RATING, ["enter", "j", "1", "f", "x", "x", "j"], Rated),
    ],
    ids=["takeover", "rating"],
)
def test_with_an_agent_the_same_inputs_give_the_same_events_as_in_a_window(
    tmp_path: Path, block: str, keys: list[str], expected: type
) -> None:
    plan, presses = plan_of(tmp_path, block), script(keys)
    window, (seat, _) = through_window(plan, presses), through_seat(plan, presses)
    assert_alike(seat, window)
    assert sum(isinstance(event, expected) for event in seat) > 4
    assert any(isinstance(event, Stepped) and not event.key for event in seat), "the agent made no step"
    assert find_violations(seat) == []
    assert list(compare_replay(seat, World)) == []


def assert_whole(page: PageModel, name: int, reels: list[list[int]], *, length: int) -> None:
    """A film came with the picture that is seen, and the others one at a time."""
    frames = [message for message in page.told if isinstance(message, messages.FilmFrame) and message.name == name]
    for side, reel in enumerate(reels):
        assert len(reel) == length
        assert sum(picture >= 0 for picture in reel) == 1
        drawn = {place: picture for place, picture in enumerate(reel) if picture >= 0}
        drawn |= {frame.place: frame.picture for frame in frames if frame.side == side}
        assert sorted(drawn) == list(range(length))


def test_films_are_told_once_a_pair_and_every_picture_of_theirs_is_logged(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, 'kind = "play"\n', PAIRS, '["compare"]')
    presses = script(["x", "x", "f", "x", "r", "x", "j"], count=30)
    seat, page = through_seat(plan, presses)
    assert find_violations(seat) == []
    assert list(compare_replay(seat, World)) == []
    assert sum(isinstance(event, Preferred) for event in seat) == 3
    assert sum(isinstance(event, PairSeen) for event in seat) > 12
    told = [
        message
        for message in page.told
        if isinstance(message, messages.ScreenMessage) and message.screen.get("view") == "pair"
    ]
    assert len(told) == 3
    for message in told:
        assert_whole(page, message.name, message.screen["films"], length=3)


def test_an_episode_is_told_whole_and_gone_through_and_corrected_as_in_a_window(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, 'kind = "play"\n', CORRECTIONS, '["correct", "tried"]')
    keys = ["period", "period", "comma", "space", "1", "3", "space", "period", "space", "3", "3", "3", "3", "enter"]
    events, page = through_seat(plan, script(keys, count=28))
    assert find_violations(events) == []
    assert list(compare_replay(events, World)) == []
    corrected = gather_corrections(events)
    assert [(its.episode, its.step, len(its.actions)) for its in corrected][:2] == [(0, 1, 2), (0, 2, 4)]
    told = [
        message
        for message in page.told
        if isinstance(message, messages.ScreenMessage) and message.screen.get("view") == "film"
    ]
    for message in told[:2]:
        assert_whole(page, message.name, message.screen["films"], length=5)
    shown = [message for message in page.told if isinstance(message, messages.EpisodeState) and message.step > 0]
    assert all(message.node > 0 for message in shown), "what a key of a correction leads to is not told ahead"


@pytest.mark.parametrize(
    ("block", "more", "parts", "keys"),
    [
        (TAKEOVER, "", "", ["enter", "1", "x", "space"]),
        ('kind = "play"\n', CORRECTIONS, '["correct", "tried"]', ["period", "space", "1", "3", "space", "enter"]),
    ],
    ids=["takeover", "correction"],
)
def test_killed_after_any_event_a_seat_goes_on_where_it_was(
    tmp_path: Path, block: str, more: str, parts: str, keys: list[str]
) -> None:
    plan = plan_of(tmp_path, block, more, parts)
    events, page = through_seat(plan, script(keys, count=16), closes=False)
    for kept in [*range(1, len(events), 5), *range(len(events) - 3, len(events))]:
        logged = events[:kept]
        session, unwritten = resume_from_events(logged, World, picture_px=(84, 84))
        recorder = MemoryRecorder()
        recorder.write(logged)
        seat = SessionHost(session, recorder, World, SETTINGS, agent=Beside(), logged=logged, unwritten=unwritten)
        seat.restart()
        for said in page.sent:
            seat.receive(said.n, said.at, said.what)
        seat.close()
        assert without_looks(recorder.events)[: len(without_looks(events))] == without_looks(events), kept


def without_looks(events: list[Event]) -> list[Event]:
    """Screens have other numbers after a kill, so what was seen of a film and not acknowledged is not known."""
    return [event for event in events if not isinstance(event, CorrectionSeen)]


def test_the_agents_next_action_and_where_it_leads_are_told_before_its_step(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, RATING)
    _, page = through_seat(plan, script(["enter"], count=3), closes=False)
    known: set[tuple[int, int]] = set()
    scene, seen = -1, 0
    for message in page.told:
        match message:
            case messages.LookAheadUpdate():
                known |= {(origin, action) for origin, action, *_ in message.edges}
            case messages.EpisodeState(action=action, node=node) if action >= 0:
                scene, seen = node, seen + 1
                assert (scene, action) in known
    assert seen > 3


def test_what_a_learner_made_is_taken_when_the_page_says_so(tmp_path: Path) -> None:
    recorder = MemoryRecorder()
    seat = SessionHost(
        SessionMachine(plan_of(tmp_path, LEARNING), World, {}), recorder, World, SETTINGS, agent=(beside := Beside())
    )
    page = PageModel(seat, script(["enter", "1"], every_ms=200, count=24), frame_ns=FRAME_NS)
    page.run(lambda: isinstance(seat.session.request, PolicyRequest))
    assert [seat.poll() for _ in range(4)] == [False, False, True, False]
    ask = next(message for _, message in seat.outgoing.after(0) if isinstance(message, messages.CommandMessage))
    seat.restart()  # another page, before the first one said anything
    assert any(isinstance(message, messages.CommandMessage) for _, message in seat.outgoing.after(0))
    page.say(messages.CommandEcho(ask.number))
    given = [event for event in recorder.events if isinstance(event, PolicyGiven)]
    assert [event.policy for event in given] == ["optimal:0.3", "optimal:0"]
    assert given[1].t_ns == page.sent[-1].at
    seat.close()
    assert beside.closed
    assert any(isinstance(event, Advised) for event in recorder.events)
