"""Rules that every stream of events obeys: the order of events, their references to each other, and their counts."""

import math
from collections.abc import Iterable

from minihuman.experiment.machine.events import (
    Answered,
    EpisodeEnded,
    EpisodesSkipped,
    EpisodeStarted,
    Event,
    FrameShown,
    KeyMapDrawn,
    Noted,
    ObservationStored,
    Outcome,
    PartEnded,
    PartStarted,
    Paused,
    Resumed,
    Sampled,
    SessionEnded,
    SessionStarted,
    Stepped,
)
from minihuman.experiment.plan.session_plan import KeyMap
from minihuman.worlds.outcomes import OutcomeJudge


def find_violations(events: Iterable[Event]) -> list[str]:
    """Return a description of each violation of a rule in a stream of events; empty for a well-formed stream.

    That a stream ends early, as in a damaged log, is no violation.
    """
    checker = _StreamChecker()
    for number, event in enumerate(events):
        checker.check(number, event)
    return checker.violations


class _StreamChecker:
    """Checks the events of a stream one after another, and keeps the state that the rules need."""

    def __init__(self) -> None:
        self.violations: list[str] = []
        self._number = 0  # the number of the event that is checked
        self._event_name = ""  # the type of that event
        self._t_ns = 0  # the time of the last event, samples apart
        self._sampled_ns: dict[str, int] = {}  # the time of each device's last sample
        self._first_episode = 0  # of the segment
        self._next_episode = 0  # the episode that runs or will begin next
        self._playing: EpisodeStarted | None = None  # the start of the running episode
        self._last_step: Stepped | None = None  # of the running episode
        self._steps = 0  # count of the episode's steps
        self._observations = 0  # count of the episode's stored observations
        self._return = 0.0
        self._paused = False
        self._ended = False
        self._skipped = 0  # count of the segment's skipped episodes
        self._part: int | None = None  # the part that runs
        self._last_episode = -1  # the episode that runs, or ended last
        self._key_map: KeyMap | None = None
        self._judge = OutcomeJudge("")
        self._outcome: Outcome | None = None  # of the running episode, once a step has ended it

    def check(self, number: int, event: Event) -> None:
        """Check an event against those before it, and record violations; ``number`` is its index in the stream."""
        self._number = number
        self._event_name = type(event).__name__
        is_in_place = isinstance(event, SessionStarted) == (number == 0)
        self._require(is_in_place, "SessionStarted is the first event, and only it")
        self._require(not self._ended, "nothing follows SessionEnded")
        self._check_time(event)
        match event:
            case SessionStarted():
                self._first_episode = self._next_episode = event.plan.first_episode
            case SessionEnded():
                self._check_session_end(event)
            case KeyMapDrawn() | EpisodeStarted() | EpisodeEnded() | EpisodesSkipped():
                self._check_episode_event(event)
            case Stepped():
                self._check_step(event)
            case ObservationStored():
                self._check_observation(event)
            case FrameShown():
                self._check_frame(event)
            case PartStarted() | PartEnded() | Answered():
                self._check_part_event(event)
            case Paused() | Resumed():
                self._check_pause_event(event)
            case Noted():
                self._require(bool(event.kind), "a note says of what kind it is")

    def _check_time(self, event: Event) -> None:
        if isinstance(event, Sampled):
            last_ns = self._sampled_ns.get(event.device, 0)
            self._sampled_ns[event.device] = event.t_ns
        else:
            last_ns = self._t_ns
            self._t_ns = event.t_ns
        if event.t_ns < last_ns:
            self._require(False, f"time goes back from {last_ns} to {event.t_ns} ns")

    def _check_episode_event(self, event: KeyMapDrawn | EpisodeStarted | EpisodeEnded | EpisodesSkipped) -> None:
        match event:
            case KeyMapDrawn():
                self._require(self._playing is None, "key maps change between episodes")
                self._key_map = event.key_map
            case EpisodeStarted():
                self._check_episode_start(event)
            case EpisodeEnded():
                self._check_episode_end(event)
            case EpisodesSkipped():
                is_next = event.first == self._next_episode and event.count > 0
                self._require(self._playing is None, "episodes are skipped between episodes")
                self._require(is_next, f"episode {self._next_episode} is next to be skipped")
                self._next_episode += event.count
                self._skipped += event.count

    def _check_part_event(self, event: PartStarted | PartEnded | Answered) -> None:
        match event:
            case PartStarted():
                self._require(self._part is None, "one part at a time")
                self._part = event.part
            case PartEnded():
                self._require(event.part == self._part, "a part that began ends")
                self._part = None
            case Answered():
                self._require(event.part == self._part, "an answer belongs to the part that runs")

    def _check_pause_event(self, event: Paused | Resumed) -> None:
        if isinstance(event, Paused):
            self._require(self._playing is not None and not self._paused, "only play can be paused, once")
            self._paused = True
        else:
            self._require(self._paused, "only a pause can be resumed")
            self._paused = False

    def _check_frame(self, event: FrameShown) -> None:
        is_of_episode = event.episode == self._last_episode and event.step <= self._steps
        self._require(is_of_episode, "a frame shows a step of the running episode, or of the one that has just ended")
        self._require(event.submit_ns <= event.flip_ns, "a frame is submitted before it is flipped")

    def _check_session_end(self, event: SessionEnded) -> None:
        self._ended = True
        self._require(self._playing is None, "an episode ends before its session")
        completed = self._next_episode - self._skipped - self._first_episode
        self._require(event.episodes_completed == completed, "completed episodes are counted")

    def _check_episode_start(self, event: EpisodeStarted) -> None:
        self._require(self._playing is None, "one episode at a time")
        is_next = event.plan.episode == self._next_episode
        self._require(is_next, f"episode {self._next_episode} is next, not {event.plan.episode}")
        self._require(event.plan.key_map == self._key_map, "an episode's key map was drawn before")
        self._playing = event
        self._last_step = None
        self._steps = 0
        self._return = 0.0
        self._paused = False
        self._observations = 0
        self._last_episode = event.plan.episode
        self._judge = OutcomeJudge(event.plan.outcome_rule)
        self._outcome = None

    def _check_observation(self, event: ObservationStored) -> None:
        is_recorded = self._playing is not None and self._playing.plan.record_observations
        is_expected = is_recorded and event.episode == self._next_episode
        self._require(is_expected, "observations are stored where the plan asks for them")
        self._require(event.step == self._observations, f"the observation of step {self._observations} is next")
        self._observations += 1

    def _check_step(self, event: Stepped) -> None:
        playing = self._playing
        if playing is None or event.episode != playing.plan.episode:
            self._require(False, "steps belong to the running episode")
            return
        self._steps += 1
        self._return += event.reward
        self._check_step_order(event, playing)
        self._check_step_content(event, playing)
        self._check_step_end(event, playing)
        self._last_step = event
        self._outcome = self._judge.judge_step(event)

    def _check_step_order(self, event: Stepped, playing: EpisodeStarted) -> None:
        self._require(not self._paused, "nothing steps in a pause")
        if event.step != self._steps:
            self._require(False, f"step {self._steps} is next, not {event.step}")
        expected_observations = 0
        if playing.plan.record_observations:
            expected_observations = self._steps + 1  # the first is that of the reset
        self._require(self._observations == expected_observations, "a step's observation comes before it")

    def _check_step_content(self, event: Stepped, playing: EpisodeStarted) -> None:
        if not _is_same_return(event.return_, self._return):
            self._require(False, f"rewards sum to {self._return}, not {event.return_}")
        if not 0 <= event.action < len(playing.action_names):
            self._require(False, f"there is no action {event.action}")
        self._require(event.key_t_ns <= event.t_ns, "a key comes before its step")
        self._require(event.rt_ms is None or event.rt_ms >= 0, "a reaction follows what it answers")

    def _check_step_end(self, event: Stepped, playing: EpisodeStarted) -> None:
        is_spent = event.step >= playing.plan.max_steps
        self._require(event.terminated or event.truncated or not is_spent, "the plan's step limit ends an episode")
        last = self._last_step
        self._require(last is None or not (last.terminated or last.truncated), "nothing steps after the end")

    def _check_episode_end(self, event: EpisodeEnded) -> None:
        playing = self._playing
        last = self._last_step
        if playing is None or event.episode != playing.plan.episode:
            self._require(False, "only the running episode ends")
            return
        totals_match = event.steps == self._steps and _is_same_return(event.return_, self._return)
        self._require(totals_match, "an end counts the episode's steps")
        last_state_hash = playing.state_hash if last is None else last.state_hash
        self._require(event.state_hash == last_state_hash, "an episode ends in the state of its last step")
        expected: Outcome = "abandoned"
        if self._outcome is not None:
            expected = self._outcome
        elif event.cause == "agent_failed":
            expected = "agent_failed"
        elif event.cause:
            expected = self._judge.judge_time_limit()
        self._require(event.outcome == expected, f"the last step makes it {expected}, not {event.outcome}")
        self._playing = None
        if event.outcome != "abandoned":
            self._next_episode += 1

    def _require(self, holds: bool, rule: str) -> None:
        """Record a violation by the present event unless ``holds`` is true; ``rule`` is the text of the rule."""
        if not holds:
            self.violations.append(f"event {self._number}, {self._event_name}: {rule}")


def _is_same_return(logged: float, summed: float) -> bool:
    """Return whether a logged return equals the sum of the rewards, where NaN equals NaN."""
    return logged == summed or (math.isnan(logged) and math.isnan(summed))
