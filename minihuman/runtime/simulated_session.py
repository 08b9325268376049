"""Simulated sessions: the same session as a participant's, with a simulated player at the keys of a virtual window.

The clock is virtual and no picture is drawn, so that a session takes as long as its computation.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np

from minihuman.activities.agent_blocks.activity import AgentPlayActivity
from minihuman.activities.correction.activity import CorrectionActivity
from minihuman.activities.correction.plan import CorrectionPlan
from minihuman.activities.correction.screens import FilmScreen
from minihuman.activities.preferences.activity import PreferencesActivity
from minihuman.activities.preferences.events import PairAnswer
from minihuman.activities.preferences.plan import PreferencesPlan
from minihuman.activities.preferences.screens import PairScreen
from minihuman.activities.questions.activity import QuestionsActivity
from minihuman.activities.questions.question import Click
from minihuman.activities.rating.activity import RatingActivity
from minihuman.admin.enrolment_entries import ParticipantReplaced
from minihuman.admin.enrolment_log import free_slot, now_text, record_departure, require_free_slots
from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.window import VirtualClock, Window
from minihuman.errors import MinihumanError, PlayerFailedError
from minihuman.experiment.keys import BUTTON_NAMES
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.inputs import (
    Input,
    KeyDown,
    KeyUp,
    PointerPressed,
    PointerReleased,
    ScreenShown,
    TextInput,
)
from minihuman.experiment.machine.running_episode import NS_PER_MS, RunningEpisode
from minihuman.experiment.machine.screens import PageScreen, PlayScreen, QuestionScreen, Screen, TextScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.paths import SegmentPath
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import BufferedRecorder, DeferredRecorder
from minihuman.plugins import limit_answer_time, locate_error
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts, list_world_ids
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.team_host import TeamTable, list_teams
from minihuman.simulation.participant import (
    KeyPress,
    SimulatedParticipant,
    SimulatedTeacher,
    WatchedStep,
    make_participant,
)
from minihuman.worlds.adapters.world import World

FRAME_NS = 16_666_667
READING_MS = 1_000.0
STEPPING_MS = 200.0  # from one picture to the next, through an episode that is looked at
HOLD_MS = 90.0
LONGEST_NS = 3_600_000_000_000  # without a key and a new screen
MOST_USELESS_PRESSES = 1_000  # in a row that lead to no step


class SimulatedWindow(Window):
    """Presses keys for a simulated participant; texts are read in a second and answered as they ask.

    Args:
        player: presses the keys while playing.
        session: the session it sits in, for the world that the player looks at.
        clock: the session's; waiting moves it.
        before: how many earlier participants of this slot left no data.
        wrong_in_ten: of answers to questions that have a right one, how many in ten are any answer.
        at_rest: called between episodes, when nothing is urgent.
    """

    def __init__(
        self,
        player: SimulatedParticipant,
        session: SessionMachine,
        clock: VirtualClock,
        *,
        before: int = 0,
        wrong_in_ten: int = 1,
        at_rest: Callable[[], None] = lambda: None,
    ) -> None:
        self._before = before
        self._wrong_in_ten = wrong_in_ten
        self._player = player
        self._session = session
        self._clock = clock
        self._at_rest = at_rest
        self._screen: Screen = TextScreen("", "", "")
        self._playing: RunningEpisode | None = None
        self._looked: tuple[str, int] | None = None  # who steered and which step it was when the player looked last
        self._answers = 0  # given so far
        self._steps_at_last_key = 0  # of the running episode, at the last key
        self._useless_presses = 0  # since then
        self._last_ns = 0  # of the last key, and of the last new screen
        self._compared: tuple[int, int] | None = None  # part and pair that were looked at last
        self._looked_through: tuple[int, int] | None = None  # part and episode
        self._coming: list[Input] = []  # in order of time

    def show(self, screen: Screen) -> ScreenShown:
        """Look at a screen; it is there one frame later."""
        self._screen = screen
        submit_ns = self._last_ns = self._clock()
        self._clock.advance_to(submit_ns + FRAME_NS)
        if not isinstance(screen, PlayScreen):
            self._at_rest()
        return ScreenShown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

    def wait(self, until_ns: int | None) -> list[Input]:
        """Move the clock to the player's next key, or to ``until_ns``."""
        if not any(isinstance(happened, KeyDown | PointerPressed | TextInput) for happened in self._coming):
            self._think()
        if not self._coming or (until_ns is not None and until_ns < self._coming[0].t_ns):
            assert until_ns is not None, "neither a key nor a deadline: this would wait for ever"
            if until_ns > self._last_ns + LONGEST_NS:
                raise PlayerFailedError(f"no key was pressed for an hour in phase {self._session.phase}", "no key")
            self._clock.advance_to(until_ns)
            return []
        happened = self._coming.pop(0)
        self._last_ns = max(self._last_ns, happened.t_ns)
        self._clock.advance_to(happened.t_ns)
        return [happened]

    def facts(self) -> dict[str, str]:
        """What it is."""
        return {"window": "simulated"}

    def close(self) -> None:
        """Nothing to give back."""

    def _think(self) -> None:
        """Decide on the next key."""
        part = self._session.part
        if self._session.phase is part.phase and (key := part.simulate(self._any)) is not None:
            self._press(key, READING_MS)
            return
        match self._screen:
            case PlayScreen() if self._session.play is not None and isinstance(self._session.part, AgentPlayActivity):
                self._watch(self._session.part, self._session.play)
            case PlayScreen() if isinstance(rating := self._session.part, RatingActivity) and rating.held is not None:
                self._watch(rating, rating.held)
            case PlayScreen() if self._session.play is not None:  # else the last picture is held
                self._press(*self._play(self._session.play))
            case PairScreen():
                self._prefer(self._session.part)
            case FilmScreen():
                self._look(self._session.part)
            case PageScreen():
                self._press("enter", READING_MS)
            case QuestionScreen() if isinstance(part, QuestionsActivity):
                self._answer(part)
            case TextScreen(keys=keys) if missing := [key for key, pressed in keys if not pressed]:
                self._press(missing[0], READING_MS)
            case TextScreen() if self._session.next_tick_ns is None:  # else a rest is running: nothing to press yet
                self._press("enter", READING_MS)

    def _look(self, part: Activity) -> None:
        """Look an episode through; a teacher goes to the step from which they show what should have been done, once."""
        if not isinstance(part, CorrectionActivity) or part.reviewed_episode is None:
            return
        plan: CorrectionPlan = part.part.plan
        episode, at = part.reviewed_episode
        step = None
        if isinstance(self._player, SimulatedTeacher) and part.review_id != self._looked_through:
            with _failures_named():
                step = self._player.correct(episode)
        self._looked_through = part.review_id
        if step is None:
            self._press("enter", READING_MS)
            return
        key, steps = plan.forward if step > at else plan.back, abs(step - at)
        for number in range(steps):
            self._press(key, READING_MS + number * STEPPING_MS)
        self._press(plan.begin, 2 * READING_MS + steps * STEPPING_MS)

    def _prefer(self, part: Activity) -> None:
        """Watch a pair to its end, then choose a side; a participant who is no teacher answers at random."""
        if not isinstance(part, PreferencesActivity) or part.pair is None or self._compared == part.pair_id:
            return
        plan: PreferencesPlan = part.part.plan
        seen_ms = (part.length + 1) * plan.step_ms
        self._compared = part.pair_id
        if isinstance(self._player, SimulatedTeacher):
            with _failures_named():
                answer, delay_ms = self._player.prefer(*part.pair)
                key = str(getattr(plan, answer))
        else:
            key, delay_ms = str(getattr(plan, get_args(PairAnswer)[self._any(2)])), READING_MS
        self._press(key, seen_ms + delay_ms)

    def _answer(self, questions: QuestionsActivity) -> None:
        """Answer as the question's kind says; nothing is known of what these people think, but most attend."""
        match questions.draft.simulate(self._any, lambda: self._any(10) >= self._wrong_in_ten):
            case Click(target, along):
                self._point(target, along)
            case str() as text:
                self._type(text)
            case None:
                self._press("tab", READING_MS)

    def _any(self, count: int) -> int:
        """A number below ``count``, from the study's seed, who answers and how many answers came before."""
        plan = self._session.plan
        purpose = f"simulated-answers-session-{plan.session}" + (f"-after-{self._before}" if self._before else "")
        self._answers += 1
        drawn = draw_words(self._answers, seed=plan.study_seed, purpose=purpose, index=plan.participant.index)
        return int(drawn[-1] % count)

    def _point(self, target: str, along: float = 0.5) -> None:
        down_ns = self._clock() + round(READING_MS * NS_PER_MS)
        up_ns = down_ns + round(HOLD_MS * NS_PER_MS)
        self._coming += [
            PointerPressed(down_ns, 0.5, 0.5, target, along),
            PointerReleased(up_ns, 0.5, 0.5, target, along),
        ]

    def _type(self, text: str) -> None:
        self._coming.append(TextInput(self._clock() + round(READING_MS * NS_PER_MS), text))

    def _play(self, play: RunningEpisode) -> tuple[str, float, float]:
        self._begin(play)
        self._useless_presses = 0 if play.steps != self._steps_at_last_key else self._useless_presses + 1
        self._steps_at_last_key = play.steps
        if self._useless_presses > MOST_USELESS_PRESSES:
            message = f"{MOST_USELESS_PRESSES} keys in a row led to no step of {play.plan.world}"
            raise PlayerFailedError(message, "no key that steps")
        press = self._ask(play)
        return press.key, press.delay_ms, press.hold_ms

    def _ask(self, play: RunningEpisode) -> KeyPress:
        """The player's next key.

        Raises:
            PlayerFailedError: if there is none.
        """
        with _failures_named():
            press = self._player.press(play.world)
        if press is None:
            raise PlayerFailedError("it gave no answer", "no answer")
        return _checked(press)

    def _begin(self, play: RunningEpisode) -> None:
        if play is not self._playing:
            self._playing, self._looked = play, None
            with _failures_named():
                self._player.begin(play.plan, self._session.plan.key_pool, play.world)

    def _watch(self, part: AgentPlayActivity, play: RunningEpisode) -> None:
        """Look once at each state; only a teacher intervenes, others play where no agent does."""
        self._begin(play)
        now = (part.who, play.steps)
        if self._looked == now:
            return
        self._looked = now
        if isinstance(self._player, SimulatedTeacher):
            with _failures_named():
                press = self._player.watch(play.world, build_watched_input(part, play, self._clock()))
            press = None if press is None else _checked(press)
        else:
            press = self._ask(play) if part.who == "person" else None
        if press is not None:
            self._press(press.key, press.delay_ms, press.hold_ms)

    def _press(self, key: str, delay_ms: float, hold_ms: float = HOLD_MS) -> None:
        down_ns = self._clock() + round(delay_ms * NS_PER_MS)
        self._coming += [KeyDown(down_ns, key, key), KeyUp(down_ns + round(hold_ms * NS_PER_MS), key, key)]
        self._coming.sort(key=lambda happened: happened.t_ns)


@contextmanager
def _failures_named() -> Iterator[None]:
    """Name whatever a player raises, and a player that takes too long."""
    try:
        with limit_answer_time():
            yield
    except MinihumanError as error:  # it says what is the matter
        raise PlayerFailedError(str(error), type(error).__name__) from error
    except Exception as error:  # of a lab's own player: its session has an end of its own
        kind = type(error).__name__
        raise PlayerFailedError(f"{kind} at {locate_error(error)}: {error}", kind) from error


def _checked(press: object) -> KeyPress:
    if not isinstance(press, KeyPress):
        answered = f"a {type(press).__name__}, not a KeyPress"
        raise PlayerFailedError(
            f"it answered with {answered}, which is not a possible answer", f"answered with {answered}"
        )
    longest = max(press.delay_ms, press.hold_ms) * NS_PER_MS
    if press.key not in BUTTON_NAMES or min(press.delay_ms, press.hold_ms) < 0 or not longest <= LONGEST_NS:
        raise PlayerFailedError(
            f"it answered with {press!r}, which is not a possible key press", "an impossible key press"
        )
    return press


def build_watched_input(part: AgentPlayActivity, play: RunningEpisode, t_ns: int) -> WatchedStep:
    """What a teacher sees of a state."""
    advised = part.advised
    action = "" if advised is None else play.world.action_names[advised.action]
    reached = play.outcome == "goal"
    return WatchedStep(part.who, play.steps, t_ns / NS_PER_MS, action, part.hand_back_key, *part.rating_keys, reached)


def simulate(protocol: Protocol, data: Path, *, participants: int, seed: int, player: str) -> Iterator[Path]:
    """Run simulated participants one after the other, in the next free slots; yield the log of each of their sessions.

    A study of several sessions is played to its end, without the days between; a participant who is screened out does
    not come back.
    Each has a random stream of its own, from ``seed``, its slot, and how many left that slot before.

    A player that crashes or gives no answer ends its session as ``player_failed``, its slot is free again, and no
    further session begins.

    Raises:
        AllocationError: if there are too few free slots, before any session; or another program took them since.
        LogError: if a log cannot be written.
        SimulationError: if there is no such player; ``PlayerFailedError`` if it fails, or cannot play a block's world.
    """
    facts = {"player": player, "player_seed": str(seed), **collect_machine_facts()}
    require_free_slots(protocol, data / protocol.study.name, participants)
    _require_player(protocol, player, seed)  # one that cannot play must not cost a slot
    left = Counter[int]()  # by place: who left no data

    def begin() -> tuple[SessionPlan, SimulatedParticipant]:
        plan = plan_next_session(protocol, data)
        place = plan.participant.index
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(place, *filter(None, (left[place],)))))
        return plan, make_participant(player, rng)

    if any(len(team.persons) > 1 for _, team in list_teams(protocol, None)):
        yield from _simulate_teams(protocol, data, [begin() for _ in range(participants)], facts)
        return
    for _ in range(participants):
        plan, person = begin()
        yield from _play_sessions(protocol, data, plan, person, facts, left)


def _simulate_teams(
    protocol: Protocol, data: Path, people: list[tuple[SessionPlan, SimulatedParticipant]], facts: dict[str, str]
) -> Iterator[Path]:
    """All at once, a thread each, as they wait for each other; what they do depends on no thread's speed."""
    teams = TeamTable(protocol, data, lambda: 0.0, gather=len(people))

    def play(one: tuple[SessionPlan, SimulatedParticipant]) -> list[Path]:
        try:
            return list(_play_sessions(protocol, data, *one, facts, Counter(), teams))
        finally:
            teams.depart()

    with ThreadPoolExecutor(len(people), "minihuman-team") as pool:
        for logs in pool.map(play, people):
            yield from logs


def _play_sessions(
    protocol: Protocol,
    data: Path,
    plan: SessionPlan,
    person: SimulatedParticipant,
    facts: dict[str, str],
    left: Counter[int],
    teams: TeamTable | None = None,
) -> Iterator[Path]:
    """All sessions of one person, who is counted in ``left`` if there are no data of them."""
    place = plan.participant.index
    log, reason = _play(protocol, plan, person, data, facts, before=left[place], teams=teams)
    if log is None:
        free_slot(data / plan.study, plan.participant.id, reason)
        left[place] += 1
    else:
        yield log
    for session in range(2, len(protocol.sessions) + 1):
        if reason != "complete":
            break
        plan = plan_next_session(protocol, data, participant=plan.participant.id, session=session, any_day=True)
        log, reason = _play(protocol, plan, person, data, facts, teams=teams)
        if log is not None:
            yield log


def _require_player(protocol: Protocol, player: str, seed: int) -> None:
    """Let a player press its first key in each world of the study that it plays alone.

    Raises:
        SimulationError: if there is no such player, or it cannot play one of the worlds.
    """
    person, tried = make_participant(player, np.random.default_rng(seed)), list[tuple[str, dict[str, Any]]]()
    for group, session in product(protocol.groups, range(1, max(1, len(protocol.sessions)) + 1)):
        plan = expand_protocol(protocol, enrol_participant(protocol, 0, group.name), session=session, overridden=True)
        for episode in plan.episodes:
            made_from = episode.world, episode.options
            if protocol.block(episode.block_name).kind in ("play", "team") and made_from not in tried:
                tried.append(made_from)
                with closing(World(*made_from)) as world:
                    world.reset(episode.seed)
                    try:
                        with limit_answer_time():
                            person.begin(episode, plan.key_pool, world)
                            person.press(world)
                    except MinihumanError:  # it says that it cannot play here
                        raise
                    except Exception:  # whatever else it does wrong is recorded in its session
                        return


def _play(
    protocol: Protocol,
    plan: SessionPlan,
    player: SimulatedParticipant,
    data: Path,
    facts: dict[str, str],
    *,
    before: int = 0,
    teams: TeamTable | None = None,
) -> tuple[Path | None, str]:
    """Return the log (None if screened out before the group was drawn) and why the session ended."""
    clock = VirtualClock()
    facts = facts | collect_world_facts(list_world_ids(plan)) | {"window": "simulated"}
    session = build_session(plan, World, facts, picture_px=None)
    log = DeferredRecorder(plan, lambda: McapRecorder(data, session.plan, started_ns=time.time_ns()))
    recorder = BufferedRecorder(log)
    window = SimulatedWindow(player, session, clock, before=before, at_rest=recorder.flush)
    agent = make_agent_host(protocol, plan, data, patient=True, teams=teams)
    try:
        path = run_session(session, window, recorder, clock, agent=agent, finished=record_log_end)
    except PlayerFailedError as error:
        raise PlayerFailedError(f"{facts['player']}: {error}; {_free(data, plan, error)}", error.reason) from error
    if session.failure is not None:
        raise session.failure
    return path, session.end_reason


def _free(data: Path, plan: SessionPlan, error: PlayerFailedError) -> str:
    """Give the slot of a player that failed to the next one, and say where its log is."""
    study_dir, code, why = data / plan.study, plan.participant.id, f"player_failed: {error.reason}"
    log = SegmentPath.of_plan(data, plan).log
    if not log.exists():
        if plan.session == 1:
            free_slot(study_dir, code, "player_failed")
        return "nothing was recorded, and the slot is free again"
    record_log_end(log)
    record_departure(study_dir, ParticipantReplaced(code, now_text(), reason=why))
    return f"{log} has the session up to there, and the slot is free again"
