"""What every stream of session events obeys, whatever was pressed, and what a stream breaks."""

from collections.abc import Iterable

from minihuman.study.events import (
    Answered,
    EpisodeEnded,
    EpisodesSkipped,
    EpisodeStarted,
    Event,
    FrameShown,
    KeyMapDrawn,
    Noted,
    ObservationStored,
    PartEnded,
    PartStarted,
    Paused,
    Resumed,
    Sampled,
    SessionEnded,
    SessionStarted,
    Stepped,
)
from minihuman.study.plan import KeyMap


def complaints(events: Iterable[Event]) -> list[str]:
    """Every rule a stream breaks, in words; empty for a well-formed one. A stream that is cut short breaks none."""
    reader = _Reader()
    for number, event in enumerate(events):
        reader.read(number, event)
    return reader.found


class _Reader:
    """Reads a stream once and remembers what the rules need."""

    def __init__(self) -> None:
        self.found: list[str] = []
        self._where = ""
        self._t_ns = 0
        self._sampled_ns: dict[str, int] = {}  # of each device's last sample
        self._first = 0
        self._next = 0
        self._playing: EpisodeStarted | None = None
        self._last_step: Stepped | None = None
        self._steps = 0
        self._observations = 0  # stored of the episode
        self._return = 0.0
        self._paused = False
        self._ended = False
        self._skipped = 0
        self._part: int | None = None
        self._shown = -1  # the episode that runs, or ended last
        self._key_map: KeyMap | None = None

    def read(self, number: int, event: Event) -> None:
        """Hold one event against what came before."""
        self._where = f"event {number}, {type(event).__name__}"
        self._rule(isinstance(event, SessionStarted) == (number == 0), "SessionStarted is the first event, and only it")
        self._rule(not self._ended, "nothing follows SessionEnded")
        last_ns = self._sampled_ns.get(event.device, 0) if isinstance(event, Sampled) else self._t_ns
        self._rule(event.t_ns >= last_ns, f"time goes back from {last_ns} to {event.t_ns} ns")
        match event:
            case Sampled():
                self._sampled_ns[event.device] = event.t_ns
                return
            case SessionStarted():
                self._first = self._next = event.plan.first_episode
            case KeyMapDrawn():
                self._rule(self._playing is None, "key maps change between episodes")
                self._key_map = event.key_map
            case EpisodeStarted():
                self._episode_started(event)
            case Stepped():
                self._stepped(event)
            case ObservationStored():
                self._observed(event)
            case FrameShown():
                inside = event.episode == self._shown and event.step <= self._steps
                self._rule(inside, "a frame shows a step of the running episode, or of the one that has just ended")
                self._rule(event.submit_ns <= event.flip_ns, "a frame is submitted before it is flipped")
            case EpisodeEnded():
                self._episode_ended(event)
            case EpisodesSkipped():
                self._rule(self._playing is None, "episodes are skipped between episodes")
                self._rule(event.first == self._next and event.count > 0, f"episode {self._next} is next to be skipped")
                self._next += event.count
                self._skipped += event.count
            case PartStarted():
                self._rule(self._part is None, "one part at a time")
                self._part = event.part
            case PartEnded():
                self._rule(event.part == self._part, "a part that began ends")
                self._part = None
            case Answered():
                self._rule(event.part == self._part, "an answer belongs to the part that runs")
            case Paused():
                self._rule(self._playing is not None and not self._paused, "only play can be paused, once")
                self._paused = True
            case Resumed():
                self._rule(self._paused, "only a pause can be resumed")
                self._paused = False
            case SessionEnded():
                self._ended = True
                self._rule(self._playing is None, "an episode ends before its session")
                self._rule(
                    event.episodes_completed == self._next - self._skipped - self._first,
                    "completed episodes are counted",
                )
            case Noted():
                self._rule(bool(event.kind), "a note says of what kind it is")
        self._t_ns = event.t_ns

    def _episode_started(self, event: EpisodeStarted) -> None:
        self._rule(self._playing is None, "one episode at a time")
        self._rule(event.plan.episode == self._next, f"episode {self._next} is next, not {event.plan.episode}")
        self._rule(event.plan.key_map == self._key_map, "an episode's key map was drawn before")
        self._playing, self._last_step, self._steps, self._return, self._paused = event, None, 0, 0.0, False
        self._observations, self._shown = 0, event.plan.episode

    def _observed(self, event: ObservationStored) -> None:
        asked = self._playing is not None and self._playing.plan.record_observations
        self._rule(asked and event.episode == self._next, "observations are stored where the plan asks for them")
        self._rule(event.step == self._observations, f"the observation of step {self._observations} is next")
        self._observations += 1

    def _stepped(self, event: Stepped) -> None:
        playing = self._playing
        if playing is None or event.episode != playing.plan.episode:
            self._rule(False, "steps belong to the running episode")
            return
        self._steps += 1
        self._return += event.reward
        self._rule(not self._paused, "nothing steps in a pause")
        self._rule(event.step == self._steps, f"step {self._steps} is next, not {event.step}")
        asked = playing.plan.record_observations
        self._rule(self._observations == asked * (self._steps + 1), "a step's observation comes before it")
        self._rule(event.return_ == self._return, f"rewards sum to {self._return}, not {event.return_}")
        self._rule(0 <= event.action < len(playing.action_names), f"there is no action {event.action}")
        self._rule(event.key_t_ns <= event.t_ns, "a key comes before its step")
        self._rule(event.rt_ms is None or event.rt_ms >= 0, "a reaction follows what it answers")
        spent = event.step >= playing.plan.max_steps
        self._rule(event.terminated or event.truncated or not spent, "the plan's step limit ends an episode")
        last = self._last_step
        self._rule(last is None or not (last.terminated or last.truncated), "nothing steps after the end")
        self._last_step = event

    def _episode_ended(self, event: EpisodeEnded) -> None:
        playing, last = self._playing, self._last_step
        if playing is None or event.episode != playing.plan.episode:
            self._rule(False, "only the running episode ends")
            return
        self._rule((event.steps, event.return_) == (self._steps, self._return), "an end counts the episode's steps")
        final = playing.state_hash if last is None else last.state_hash
        self._rule(event.state_hash == final, "an episode ends in the state of its last step")
        expected = "abandoned"
        if last is not None and last.terminated:
            expected = "goal" if last.reward > 0 else "failure"
        elif (last is not None and last.truncated) or event.cause:
            expected = "timeout"
        self._rule(event.outcome == expected, f"the last step makes it {expected}, not {event.outcome}")
        self._playing, self._paused = None, False
        self._next += event.outcome != "abandoned"

    def _rule(self, holds: bool, rule: str) -> None:
        if not holds:
            self.found.append(f"{self._where}: {rule}")
