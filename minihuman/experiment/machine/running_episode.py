"""A running episode: the meaning of keys, the result of steps, and the time of the next tick. It knows no phases."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.experiment.keys import MOUSE_AXES, TOUCH_AXES
from minihuman.experiment.machine.events import (
    ClauseDone,
    EndCause,
    EpisodeEnded,
    EpisodeStarted,
    Event,
    FrameShown,
    ObservationStored,
    Outcome,
    Stepped,
)
from minihuman.experiment.machine.inputs import ScreenShown
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.worlds.action_names import join_action_names
from minihuman.worlds.adapters.foreign_code import WorldCodeError
from minihuman.worlds.outcomes import OutcomeJudge
from minihuman.worlds.picture_hash import hash_picture
from minihuman.worlds.pose import Pose

if TYPE_CHECKING:
    from minihuman.experiment.machine.bindings import AxisBinding, Bindings, SpotBinding
    from minihuman.worlds.adapters.spaces import Action, ActionVector
    from minihuman.worlds.adapters.world import World  # imports Gymnasium, which reading a log does not need

NS_PER_MS = 1_000_000
_MAX_HASHES = 256  # of pictures that are not displayed yet
EMPTY_IMAGE = np.zeros((0, 0, 3), dtype=np.uint8)


class WorldFailedError(Exception):
    """A world raised an exception, which is the cause of this one."""


class catch_world_errors:  # noqa: N801 - used as `contextlib.suppress` is
    """A context manager that turns any exception raised inside into a WorldFailedError.

    It separates a world's failures from this program's.
    """

    __slots__ = ()

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None:  # every step
            return
        if isinstance(error, WorldCodeError):
            cause = error.__cause__ if isinstance(error.__cause__, Exception) else error
            raise WorldFailedError(error.log_text) from cause
        if isinstance(error, WorldError):
            raise WorldFailedError(str(error)) from error
        if isinstance(error, Exception):
            raise WorldFailedError(f"{type(error).__name__}: {error}") from error


@dataclass(frozen=True, slots=True)
class _QueuedKey:
    """A key that waits for its tick."""

    t_ns: int
    key: str
    action: "Action"


class RunningEpisode:
    """An episode from its reset to its outcome.

    A subclass in whose episodes others act too sets ``is_joint``.

    Args:
        plan: the episode's plan.
        world: a world that was made for ``plan.world`` and ``plan.options``; the episode resets it.
        picture_px: the largest picture wanted, as width and height in pixels; None draws none.
        keys_down: the keys that are held, the latest last, with the time of each press; the caller keeps it current.
        bindings: the axes and clicks that set an action's components in addition to keys.
        axes: the values of the axes; the caller keeps it current, and a tick takes the mouse's motion from it.
    """

    is_joint: ClassVar[bool] = False  # whether others act, too, so that the session host closes each step
    open_action: int | None = None  # the person's own action in a joint step that is not closed yet

    def __init__(
        self,
        plan: EpisodePlan,
        world: "World",
        *,
        picture_px: tuple[int, int] | None,
        keys_down: Mapping[str, int] | None = None,
        bindings: "Bindings | msgspec.UnsetType" = msgspec.UNSET,
        axes: dict[str, float] | None = None,
    ) -> None:
        self.plan = plan
        self.world = world
        self.outcome: Outcome | None = None
        self._judge = OutcomeJudge(plan.outcome_rule)
        self.actions: list[int] = []  # the actions so far
        self.return_ = 0.0
        self.started = False
        self.next_tick_ns: int | None = None  # None until a picture has been shown
        self._picture_px = picture_px
        self._queued: _QueuedKey | None = None
        self._keys_down = {} if keys_down is None else keys_down
        self._axes = {} if axes is None else axes
        self._bindings = bindings
        self._pressed: dict[str, int] = {}  # the keys pressed since the last tick, with the time of each press
        self._flips_ns: list[int] = []  # the last two pictures' flips since play began or resumed
        self._shown_step = -1
        self._picture_hashes: dict[int, int] = {}  # by step, of the latest steps
        with catch_world_errors():
            world.name_actions(plan.actions)
            self._action_of = {key: _find_action_number(plan, world, name) for key, name in plan.key_map.keys.items()}
            self._noop = None if plan.noop is None else _find_action_number(plan, world, plan.noop)
            if bindings:
                check_bindings(world, bindings)
            self._observed = world.reset(plan.seed)
            self._state_hash = world.state_hash()

    @property
    def steps(self) -> int:
        """Return the number of steps so far."""
        return len(self.actions)

    def describe_correction(self, t_ns: int, step: int, submit_ns: int, flip_ns: int) -> Event | None:
        """Return the event that corrects the log of a picture shown before its step was final; None if it was right.

        The picture of ``step`` was submitted at ``submit_ns`` and displayed at ``flip_ns``; the event has the time
        ``t_ns``. Only in joint episodes can a picture precede its final step; other episodes return None.
        """
        return None

    @property
    def mission(self) -> str:
        """Return the world's mission; "" if it has none."""
        return self._observed.mission

    @property
    def real_time(self) -> bool:
        """Return whether steps happen by the clock rather than by keys."""
        return self.plan.pace == "real_time"

    @property
    def repeats_held(self) -> bool:
        """Return whether a held key repeats its action at every tick."""
        return self.plan.hold == "repeat"

    @property
    def axis_bindings(self) -> "Mapping[str, AxisBinding]":
        """Return, by the name of each axis that moves a component of the action, its binding; empty without any."""
        return self._bindings.axes if self._bindings else {}

    @property
    def held_inputs(self) -> tuple[tuple[str, ...], tuple[str, ...], dict[str, float]]:
        """Return the keys down, the keys pressed since the last tick (both latest last), and the axes' values."""
        return tuple(self._keys_down), tuple(self._pressed), dict(self._axes)

    def action_of(self, key: str) -> int | None:
        """Return the action number of a key; None if the key has no action."""
        return self._action_of.get(key)

    def start(self, t_ns: int) -> EpisodeStarted:
        """Start the episode, discard earlier motion of the mouse, and return the episode's event."""
        self.started = True
        self._take_mouse_motion()
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
        """Return the present picture as uint8[height, width, 3]; empty if no pictures are drawn."""
        if self._picture_px is None:
            return EMPTY_IMAGE
        with catch_world_errors():
            picture = self.world.frame(self.plan.view, self._picture_px, self.plan.palette)
        if not self.world.is_built_in:  # a built-in world's picture can be drawn again from the log
            picture = np.ascontiguousarray(picture)  # copied once for both the hash and the display
            self.keep_picture_hash(hash_picture(picture))
        return picture

    def keep_picture_hash(self, picture_hash: int) -> None:
        """Keep the hash of the present picture for the event of its display, unless it is 0 or the episode is joint."""
        if self.is_joint or not picture_hash:
            return
        self._picture_hashes.pop(self.steps, None)  # so that the latest step is the last
        self._picture_hashes[self.steps] = picture_hash
        if len(self._picture_hashes) > _MAX_HASHES:
            oldest_step = next(iter(self._picture_hashes))
            del self._picture_hashes[oldest_step]

    def picture_between(self, before: Pose, share: float) -> NDArray[np.uint8]:
        """Return a first-person world's picture between an earlier pose and the present one, uint8[height, width, 3].

        Args:
            before: the earlier pose.
            share: the share of the way from the earlier pose to the present one, 0 to 1.
        """
        env: Any = self.world.unwrapped
        assert self._picture_px is not None
        with catch_world_errors():
            picture: NDArray[np.uint8] = env.picture_between(
                before, share, size_px=self._picture_px, palette=self.plan.palette
            )
        return picture

    def record_shown(self, screen: ScreenShown) -> FrameShown:
        """Record that a picture reached the display, by default the picture of the latest step, and return its event.

        The first picture starts the clock of a real-time episode, and each new picture a response deadline.
        """
        step = self.steps if screen.step is None else min(screen.step, self.steps)
        if self._shown_step != step:
            self._flips_ns = [*self._flips_ns[-1:], screen.flip_ns]
            self._shown_step = step
        if self.real_time and self.next_tick_ns is None:
            self.next_tick_ns = screen.flip_ns + self._period_ns
        elif self.plan.response_deadline_ms and self.next_tick_ns is None and step == self.steps:
            self.next_tick_ns = screen.flip_ns + round(self.plan.response_deadline_ms * NS_PER_MS)
        picture_hash = self._picture_hashes.get(step, 0)
        return FrameShown(screen.t_ns, self.plan.episode, step, screen.submit_ns, screen.flip_ns, picture_hash)

    def note_onset(self, flip_ns: int) -> None:
        """Measure later response times from ``flip_ns``, a stimulus onset, where not every picture shows an onset."""
        self._flips_ns = [flip_ns]

    def step_without_key(self, t_ns: int) -> Stepped:
        """Make a step with the no-op action, for a trial that ended without a response, and return its event."""
        assert self._noop is not None, "the protocol's check asks for a no-op"
        return self.step(t_ns, self._noop, key="", key_t_ns=t_ns)

    @property
    def takes_clicks(self) -> bool:
        """Return whether a click in the picture is an action."""
        return bool(self._bindings and self._bindings.spot)

    def find_click_action(self, x: float, y: float) -> "Action":
        """Return the action of a click at (x, y), each 0 to 1 of the world's picture from its top left corner."""
        assert self._bindings
        assert self._bindings.spot
        with catch_world_errors():
            return _build_click_vector(self.world, self._bindings.spot, x, y)

    def queue(self, t_ns: int, key: str, action: "Action") -> None:
        """Keep a key press and its action for the next tick. A later press replaces it, unless held keys combine."""
        if self.repeats_held:
            self._pressed.pop(key, None)
            self._pressed[key] = t_ns
        else:
            self._queued = _QueuedKey(t_ns, key, action)

    def suspend(self) -> None:
        """Stop the clock and discard queued keys; the next picture shown restarts the clock."""
        self._queued = None
        self._pressed.clear()
        self._take_mouse_motion()
        self.next_tick_ns = None
        self._flips_ns = []
        self._shown_step = -1

    def tick(self, t_ns: int) -> Stepped | None:
        """Make the step that is due at a tick or deadline, and return its event; return None if no step is due.

        The action is that of the queued key or of the keys that are held; without a key, it is the no-op, or there is
        no step if the plan has none. Periods that passed entirely, as on a stalled machine, are skipped, because no
        pictures were shown in them.
        """
        if self.next_tick_ns is None or t_ns < self.next_tick_ns:
            return None
        if not self.real_time:  # nothing was pressed before the deadline
            if self._noop is None:
                return None
            return self.step(t_ns, self._noop, key="", key_t_ns=t_ns)
        n_missed_periods = (t_ns - self.next_tick_ns) // self._period_ns
        self.next_tick_ns += self._period_ns * (n_missed_periods + 1)
        if self.repeats_held:
            return self._step_held(t_ns)
        press = self._queued
        self._queued = None
        if press is not None:
            return self.step(t_ns, press.action, key=press.key, key_t_ns=press.t_ns)
        if self._noop is None:
            return None
        return self.step(t_ns, self._noop, key="", key_t_ns=t_ns)

    def _step_held(self, t_ns: int) -> Stepped | None:
        """Make a step with the keys down or pressed since the last tick; return None without key, axis and no-op.

        The latest of these keys is the step's key; it counts as a response only at the first tick after its press.
        """
        pressed = self._pressed
        self._pressed = {}
        held_keys = [key for key in self._keys_down if key in self._action_of and key not in pressed]
        keys = [*held_keys, *pressed]  # the latest last
        shares_of_components = self._take_component_shares()
        if not keys and not shares_of_components:
            if self._noop is None:
                return None
            return self.step(t_ns, self._noop, key="", key_t_ns=t_ns)
        with catch_world_errors():
            actions = [self._action_of[key] for key in keys]
            number, vector = self.world.actions.combine(actions or [0])  # action 0 of a vector is its rest
            for component, share in shares_of_components.items():
                vector = self.world.actions.move(vector, component, share)  # type: ignore[union-attr]
        latest = keys[-1] if keys else ""
        return self.step(t_ns, vector or number, key=latest, key_t_ns=pressed.get(latest, t_ns), held_keys=pressed)

    def _take_component_shares(self) -> dict[int, float]:
        """Return how far the axes move each component, as a signed share of the way from rest to its bound.

        A share may lie beyond -1 or 1 by its scale. Components that do not move are left out. Mouse motion is used up.
        """
        shares: dict[int, float] = {}
        if not self._bindings:
            return shares
        values = {**self._axes, **self._take_mouse_motion()}
        for axis, binding in self._bindings.axes.items():
            share = values.get(axis, 0.0) * binding.scale
            if axis in MOUSE_AXES:  # however fast the mouse moves, a component moves no further than to its bound
                share = max(-1.0, min(1.0, share))
            if share:
                shares[binding.component] = shares.get(binding.component, 0.0) + share
        return shares

    def _take_mouse_motion(self) -> dict[str, float]:
        """Return and forget the pixels by which the mouse moved since the last tick."""
        return {axis: self._axes.pop(axis) for axis in MOUSE_AXES if axis in self._axes}

    @property
    def window_axes(self) -> tuple[str, ...]:
        """Return the bound axes that a window or a page has to provide: those of the mouse and of touch sticks."""
        if not self._bindings:
            return ()
        return tuple(axis for axis in self._bindings.axes if axis in MOUSE_AXES or axis in TOUCH_AXES)

    def step(
        self, t_ns: int, action: "Action", *, key: str, key_t_ns: int, held_keys: Mapping[str, int] | None = None
    ) -> Stepped:
        """Make one step of the world and return its event; the plan's step limit counts as a truncation.

        Args:
            t_ns: the present session time.
            action: an action number, or a vector if actions are vectors.
            key: the key that caused the step; "" for none.
            key_t_ns: the time of the key press; ``t_ns`` without a key.
            held_keys: the keys pressed since the last tick, if held keys make steps; other keys answer no picture.
        """
        assert self.started, "call start() before the first step"
        with catch_world_errors():
            number, vector = self.world.actions.resolve(action)
            transition = self.world.step(vector or number)
            pose = self.world.pose()
            self._state_hash = self.world.state_hash()
            success = transition.find_success(self._judge.rule)
            info_json = transition.encode_info(self.plan.record_info) if self.plan.record_info else ""
        self.actions.append(number)
        if not self.real_time:
            self.next_tick_ns = None  # the deadline runs from the next picture
        self.return_ += transition.reward
        is_at_limit = self.steps >= self.plan.max_steps and not transition.terminated
        truncated = transition.truncated or is_at_limit
        answers_picture = bool(key) and (held_keys is None or key in held_keys)
        stepped = Stepped(
            t_ns=t_ns,
            episode=self.plan.episode,
            step=self.steps,
            action=number,
            key=key,
            key_t_ns=key_t_ns,
            reward=transition.reward,
            return_=self.return_,
            terminated=transition.terminated,
            truncated=truncated,
            pose=pose,
            rt_ms=self._compute_rt_ms(key_t_ns) if answers_picture else None,
            state_hash=self._state_hash,
            observation_hash=transition.observation_hash,
            onset=transition.onset,
            action_vector=vector,
            success=success,
            info_json=info_json,
        )
        self.outcome = self._judge.judge_step(stepped)
        return stepped

    def _compute_rt_ms(self, key_t_ns: int) -> float | None:
        """Compute the time from the display of the picture that a key press answered to the press, in milliseconds.

        None if no picture had been displayed.
        """
        earlier_flips_ns = [flip_ns for flip_ns in self._flips_ns if flip_ns <= key_t_ns]
        if not earlier_flips_ns:
            return None
        return (key_t_ns - earlier_flips_ns[-1]) / NS_PER_MS

    def clauses_done(self, t_ns: int) -> list[ClauseDone]:
        """Return the events of the instruction's subgoals that the last step reached."""
        with catch_world_errors():
            clauses = self.world.subgoals()
        return [
            ClauseDone(t_ns, self.plan.episode, self.steps, number, text)
            for number, (text, step) in enumerate(clauses)
            if step == self.steps
        ]

    def stored_observations(self, t_ns: int) -> list[ObservationStored]:
        """Return the event of the present observation in a list; empty if the protocol records no observations."""
        if not self.plan.record_observations:
            return []
        with catch_world_errors():  # a copy, as a world may use its arrays again
            observation = copy.deepcopy(self.world.observation)
        return [ObservationStored(t_ns, self.plan.episode, self.steps, observation)]

    def end(self, t_ns: int, cause: EndCause = "") -> EpisodeEnded:
        """End the episode and return its event.

        The outcome is that of the last step, of a failed agent or of a time limit; "abandoned" if none of these ended
        the episode.
        """
        self.outcome = self.outcome or self._judge_cause(cause)
        return EpisodeEnded(t_ns, self.plan.episode, self.outcome, self.steps, self.return_, self._state_hash, cause)

    def _judge_cause(self, cause: EndCause) -> Outcome:
        """Return the outcome of an episode that no step has ended, from the cause of its end."""
        if cause == "agent_failed":
            return "agent_failed"
        if cause:
            return self._judge.judge_time_limit()
        return "abandoned"

    @property
    def _period_ns(self) -> int:
        return max(1, round(self.plan.step_period_ms * NS_PER_MS))


def check_bindings(world: "World", bindings: "Bindings") -> None:
    """Check that a world accepts the bindings of axes and clicks.

    Raises:
        WorldError: if the world's actions are not vectors, or lack a bound component.
    """
    if world.actions.is_discrete:
        raise WorldError(
            f"{world.id} has {world.action_space}; axes and clicks move vectors, so bind keys to its actions"
        )
    for binding in bindings.axes.values():
        world.actions.require_component(binding.component)  # type: ignore[union-attr]
    if bindings.spot is not None:
        world.actions.value(_build_click_vector(world, bindings.spot, 0.0, 1.0))  # any point in the picture will do


def _build_click_vector(world: "World", spot: "SpotBinding", x: float, y: float) -> "ActionVector":
    """Build the action vector of a click at (x, y), each 0 to 1 of the picture from its top left corner.

    Raises:
        WorldError: if the world lacks ``spot.action``, the action that the click also makes.
    """
    action = 0
    if spot.action:
        if spot.action not in world.action_names:
            raise WorldError(
                f"{world.id} has no action {spot.action!r}; it has {join_action_names(world.action_names)}"
            )
        action = world.action_names.index(spot.action)
    _, vector = world.actions.combine([action])
    for component, share in ((spot.x, x), (spot.y, y)):
        vector = world.actions.point(vector, component, share)  # type: ignore[union-attr]
    return vector


def _find_action_number(plan: EpisodePlan, world: "World", name: str) -> int:
    """Return the number of the action of a given name.

    Raises:
        WorldError: if the world has no such action.
    """
    if name not in world.action_names:
        raise WorldError(
            f"{plan.world} has no action {name!r}; its actions are {join_action_names(world.action_names)}"
        )
    return world.action_names.index(name)
