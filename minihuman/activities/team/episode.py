"""An episode of a team, seen from one seat: the person's submissions, and joint steps with their digest."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from minihuman.activities.team.events import ActionSource, PictureCorrected
from minihuman.activities.team.requests import JointTaken, Team
from minihuman.experiment.machine.events import FrameShown, Stepped
from minihuman.experiment.machine.inputs import ScreenShown
from minihuman.experiment.machine.running_episode import RunningEpisode, catch_world_errors
from minihuman.experiment.plan.session_plan import EpisodePlan

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World


def digest_joint_actions(team: str, seed: int, actions: Sequence[Sequence[int]]) -> int:
    """Return the 64-bit digest of an episode's joint actions.

    It is a chain of BLAKE2b hashes over the team's id and the seed, and then over each step's actions.
    """
    return reduce(extend_digest, actions, start_digest(team, seed))


def start_digest(team: str, seed: int) -> int:
    """Return the 64-bit digest of an episode of a team, by its id and the seed, before the first step."""
    return _hash64(f"{team} {seed}".encode())


def extend_digest(digest: int, actions: Sequence[int]) -> int:
    """Return the 64-bit digest of an episode after one more joint action, given as the action of each seat."""
    return _hash64(np.array([digest, *actions], np.uint64).astype("<u8").tobytes())


def _hash64(content: bytes) -> int:
    return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "little")


@dataclass(frozen=True, slots=True)
class Submission:
    """The action that this seat has submitted for the next step, until the step is closed."""

    action: int
    key: str
    key_t_ns: int
    is_new: bool = True  # its key went down since the step before, and is not only held


class TeamEpisode(RunningEpisode):
    """An episode of a team, seen from one seat; each of its steps needs a joint action."""

    is_joint = True

    def __init__(
        self,
        plan: EpisodePlan,
        world: "World",
        team: Team,
        *,
        picture_px: tuple[int, int] | None,
        keys_down: Mapping[str, int] | None = None,
    ) -> None:
        super().__init__(plan, world, picture_px=picture_px, keys_down=keys_down)
        self.team = team
        self.joint_actions: list[tuple[int, ...]] = []
        self.sources: list[tuple[ActionSource, ...]] = []
        self.submitted: Submission | None = None
        self.digest = start_digest(team.team, plan.seed)
        self._due_ns: int | None = None  # of the tick that is submitted

    @property
    def open_action(self) -> int | None:  # type: ignore[override]
        """Return the action that this seat has submitted in turn-based play; None without one, or in real time."""
        if self.real_time or self.submitted is None:
            return None
        return self.submitted.action

    def describe_correction(self, t_ns: int, step: int, submit_ns: int, flip_ns: int) -> PictureCorrected:
        """Return the event of a picture that showed this seat's action before the others' actions changed the step.

        ``t_ns``, ``submit_ns`` and ``flip_ns`` are session times: of the report, of the picture's submission to the
        display, and of its appearance there.
        """
        return PictureCorrected(t_ns, self.plan.episode, step, submit_ns, flip_ns)

    def poses(self) -> tuple[float, ...]:
        """Return x, y, z and yaw_rad of every body in one flat tuple, seat after seat, as the world states them."""
        with catch_world_errors():
            poses = self.world.unwrapped.poses()
        return tuple(number for pose in poses for number in (pose.x, pose.y, pose.z, pose.yaw_rad))

    def record_shown(self, screen_shown: ScreenShown) -> FrameShown:
        """Return the event of a picture that reached the display.

        While a submitted action waits for the joint action, no new tick is scheduled.
        """
        event = super().record_shown(screen_shown)
        if self.submitted is not None:
            self.next_tick_ns = None
        return event

    def tick(self, t_ns: int) -> Stepped | None:
        """Submit this seat's action if a tick is due at the session time ``t_ns``; return None.

        The step follows when the joint action arrives. The submitted action is that of the queued or held keys, or the
        idle action.
        """
        if self.next_tick_ns is not None and t_ns >= self.next_tick_ns and self.submitted is None:
            self._due_ns = self.next_tick_ns
            self.next_tick_ns = None
            self.submitted = self._take_submission(t_ns)
        return None

    def _take_submission(self, t_ns: int) -> Submission:
        """Return this seat's submission at a tick and remove the key presses that it uses.

        It has the action of the queued or held keys, or the idle action if there are none.
        """
        idle: int = self.world.unwrapped.team.idle_action
        if not self.repeats_held:
            press = self._queued
            self._queued = None
            if press is None:
                return Submission(idle, "", t_ns)
            return Submission(press.action, press.key, press.t_ns)  # type: ignore[arg-type]  # bodies act by number
        pressed = self._pressed
        self._pressed = {}
        held_keys = [key for key in self._keys_down if key in self._action_of and key not in pressed]
        keys = [*held_keys, *pressed]
        if not keys:
            return Submission(idle, "", t_ns)
        with catch_world_errors():
            action, _ = self.world.actions.combine([self._action_of[key] for key in keys])
        latest_key = keys[-1]
        return Submission(action, latest_key, pressed.get(latest_key, t_ns), latest_key in pressed)

    def step_joint(self, t_ns: int, joint: JointTaken) -> tuple[Stepped, tuple[float, ...], Submission | None]:
        """Make a joint step and return its event, the rewards by seat, and this seat's submission for it.

        The submission is None if this seat had not submitted an action. ``t_ns`` is the session time of the step.
        """
        submission = self.submitted
        self.submitted = None
        key = ""
        key_t_ns = t_ns
        held_keys: Mapping[str, int] | None = None
        if submission is not None and joint.sources[self.team.seat] == "person":
            key = submission.key
            if submission.key:
                key_t_ns = submission.key_t_ns
            if not submission.is_new:
                held_keys = {}
        env = self.world.unwrapped
        env.joint = joint.actions
        with catch_world_errors():
            stepped = self.step(t_ns, joint.actions[self.team.seat], key=key, key_t_ns=key_t_ns, held_keys=held_keys)
        self.joint_actions.append(joint.actions)
        self.sources.append(joint.sources)
        self.digest = extend_digest(self.digest, joint.actions)
        if self._due_ns is not None:
            n_missed_periods = max(0, t_ns - self._due_ns) // self._period_ns
            self.next_tick_ns = self._due_ns + self._period_ns * (n_missed_periods + 1)
            self._due_ns = None
        return stepped, env.rewards, submission
