"""One running episode: what a key means, what a step gives and when the next tick is due. Knows no phases."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.experiment.machine.events import (
    ClauseDone,
    EndCause,
    EpisodeEnded,
    EpisodeStarted,
    FrameShown,
    ObservationStored,
    Outcome,
    Stepped,
)
from minihuman.experiment.machine.inputs import ScreenShown
from minihuman.experiment.plan.session_plan import EpisodePlan

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World  # imports Gymnasium, which reading a log does not need

NS_PER_MS = 1_000_000
EMPTY_IMAGE = np.zeros((0, 0, 3), dtype=np.uint8)


class WorldFailedError(Exception):
    """Anything a world raised; the cause is what it raised."""


@contextmanager
def catch_world_errors() -> Iterator[None]:
    """Tell a world's failures from our own: anything raised inside becomes a WorldFailedError."""
    try:
        yield
    except Exception as error:
        raise WorldFailedError(f"{type(error).__name__}: {error}") from error


@dataclass(frozen=True, slots=True)
class _QueuedKey:
    """A key that waits for its tick."""

    t_ns: int
    key: str
    action: int


class RunningEpisode:
    """An episode from reset to outcome.

    Args:
        plan: the episode.
        world: one made for ``plan.world`` and ``plan.options``; it is reset here.
        picture_px: the largest picture wanted, width and height; None draws none.
    """

    def __init__(self, plan: EpisodePlan, world: "World", *, picture_px: tuple[int, int] | None) -> None:
        self.plan = plan
        self.world = world
        self.outcome: Outcome | None = None
        self.actions: list[int] = []  # done so far
        self.return_ = 0.0
        self.started = False
        self.next_tick_ns: int | None = None  # None until a picture has been shown
        self._picture_px = picture_px
        self._queued: _QueuedKey | None = None
        self._flips_ns: list[int] = []  # of the pictures shown since play began or went on, the last two
        self._shown_step = -1
        with catch_world_errors():
            self._action_of = {key: _index(plan, world, name) for key, name in plan.key_map.keys.items()}
            self._noop = None if plan.noop is None else _index(plan, world, plan.noop)
            self._observed = world.reset(plan.seed)
            self._state_hash = world.state_hash()

    @property
    def steps(self) -> int:
        """How many were made."""
        return len(self.actions)

    @property
    def mission(self) -> str:
        """The world's mission; "" if it has none."""
        return self._observed.mission

    @property
    def real_time(self) -> bool:
        """Whether time, not a key, makes the steps."""
        return self.plan.pace == "real_time"

    def action_of(self, key: str) -> int | None:
        """The action number of a key; None if it has none."""
        return self._action_of.get(key)

    def start(self, t_ns: int) -> EpisodeStarted:
        """Begin the episode."""
        self.started = True
        with catch_world_errors():
            return EpisodeStarted(
                t_ns=t_ns,
                plan=self.plan,
                action_names=self.world.action_names,
                mission=self.mission,
                map=self.world.map(),
                pose=self.world.pose(),
                state_hash=self._state_hash,
                observation_hash=self._observed.observation_hash,
                onset=self.plan.onset_at_reset or self._observed.onset,
            )

    def picture(self) -> NDArray[np.uint8]:
        """The present picture, uint8[H, W, 3]; empty if none are drawn."""
        if self._picture_px is None:
            return EMPTY_IMAGE
        with catch_world_errors():
            return self.world.frame(self.plan.view, self._picture_px, self.plan.palette)

    def record_shown(self, shown: ScreenShown) -> FrameShown:
        """Take note that a picture reached the display; by default the present one.

        The first one starts a real_time clock.
        """
        step = self.steps if shown.step is None else min(shown.step, self.steps)
        if self._shown_step != step:
            self._flips_ns = [*self._flips_ns[-1:], shown.flip_ns]
            self._shown_step = step
        if self.real_time and self.next_tick_ns is None:
            self.next_tick_ns = shown.flip_ns + self._period_ns
        return FrameShown(shown.t_ns, self.plan.episode, step, shown.submit_ns, shown.flip_ns)

    def queue(self, t_ns: int, key: str, action: int) -> None:
        """Keep a key for the next tick; a later key takes its place."""
        self._queued = _QueuedKey(t_ns, key, action)

    def suspend(self) -> None:
        """Stop the clock: what was queued is forgotten, and the next picture shown starts anew."""
        self._queued = None
        self.next_tick_ns = None
        self._flips_ns = []
        self._shown_step = -1

    def tick(self, t_ns: int) -> Stepped | None:
        """If a period has run out, step with the queued key's action or the no-op; None if nothing is to be done.

        Periods missed altogether (a stalled machine) are skipped: no pictures were shown between.
        """
        if self.next_tick_ns is None or t_ns < self.next_tick_ns:
            return None
        self.next_tick_ns += self._period_ns * ((t_ns - self.next_tick_ns) // self._period_ns + 1)
        press, self._queued = self._queued, None
        if press is not None:
            return self.step(t_ns, press.action, key=press.key, key_t_ns=press.t_ns)
        return None if self._noop is None else self.step(t_ns, self._noop, key="", key_t_ns=t_ns)

    def step(self, t_ns: int, action: int, *, key: str, key_t_ns: int) -> Stepped:
        """Step the world once. The plan's step limit counts as a truncation, whether or not the world has one."""
        assert self.started, "start() comes first"
        with catch_world_errors():
            transition = self.world.step(action)
            pose, self._state_hash = self.world.pose(), self.world.state_hash()
        self.actions.append(action)
        self.return_ += transition.reward
        spent = self.steps >= self.plan.max_steps and not transition.terminated
        truncated = transition.truncated or spent
        if transition.terminated:
            self.outcome = "goal" if transition.reward > 0 else "failure"
        elif truncated:
            self.outcome = "timeout"
        return Stepped(
            t_ns=t_ns,
            episode=self.plan.episode,
            step=self.steps,
            action=action,
            key=key,
            key_t_ns=key_t_ns,
            reward=transition.reward,
            return_=self.return_,
            terminated=transition.terminated,
            truncated=truncated,
            pose=pose,
            rt_ms=self._rt_ms(key_t_ns) if key else None,
            state_hash=self._state_hash,
            observation_hash=transition.observation_hash,
            onset=transition.onset,
        )

    def clauses_done(self, t_ns: int) -> list[ClauseDone]:
        """The subgoals of the instruction that the last step has reached."""
        with catch_world_errors():
            clauses = self.world.subgoals()
        return [
            ClauseDone(t_ns, self.plan.episode, self.steps, number, text)
            for number, (text, step) in enumerate(clauses)
            if step == self.steps
        ]

    def stored_observations(self, t_ns: int) -> list[ObservationStored]:
        """The present observation if the protocol records observations, else none."""
        if not self.plan.record_observations:
            return []
        with catch_world_errors():  # a copy, as a world may use its arrays again
            observation = copy.deepcopy(self.world.observation)
        return [ObservationStored(t_ns, self.plan.episode, self.steps, observation)]

    def end(self, t_ns: int, cause: EndCause = "") -> EpisodeEnded:
        """End the episode: by its last step, a failed agent, a time limit, or abandoned if none of them ended it."""
        by_cause: Outcome = "agent_failed" if cause == "agent_failed" else "timeout" if cause else "abandoned"
        self.outcome = self.outcome or by_cause
        return EpisodeEnded(t_ns, self.plan.episode, self.outcome, self.steps, self.return_, self._state_hash, cause)

    @property
    def _period_ns(self) -> int:
        return max(1, round(self.plan.step_period_ms * NS_PER_MS))

    def _rt_ms(self, key_t_ns: int) -> float | None:
        """The key's time after the flip of the latest picture that was there when it was pressed."""
        seen = [flip_ns for flip_ns in self._flips_ns if flip_ns <= key_t_ns]
        return (key_t_ns - seen[-1]) / NS_PER_MS if seen else None


def _index(plan: EpisodePlan, world: "World", name: str) -> int:
    if name not in world.action_names:
        raise WorldError(f"{plan.world} has no action {name!r}; it has {', '.join(world.action_names)}")
    return world.action_names.index(name)
