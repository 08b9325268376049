"""Conformance check of a world: play it as a participant would, and check every value that it returns.

The world is played without drawing, with a picture after each step, in a second process, and again from a saved state,
always from the same seeds with the same actions. The report says what would break a session, what would make its log
impossible to verify, and what is only unusual. This module knows no protocol.
"""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.adapters.foreign_code import contain_errors
from minihuman.worlds.adapters.spaces import VectorActions
from minihuman.worlds.adapters.transition import ResetResult, StepResult
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import Palette, View
from minihuman.worlds.hashing import hash64
from minihuman.worlds.observation_spaces import find_outside

EPISODE_STEPS = 100  # the most steps that are played of an episode
SLOW_START_S = 1.0
N_STEPS_BEFORE_SAVE = 5
N_STEPS_AFTER_SAVE = 20


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """The settings of a conformance check: the world to play, and how a block of a protocol shows it.

    Attributes:
        actions: the numbers of the actions that a participant can take.
        max_steps: the step limit of an episode.
        steps: the number of steps to play, over several episodes.
    """

    world: str
    options: dict[str, Any]
    seeds: tuple[int, ...]
    actions: tuple[int, ...]
    view: View | Literal["text"] = "partial"
    palette: Palette = "classic"
    size_px: tuple[int, int] = (640, 480)
    max_steps: int = EPISODE_STEPS
    steps: int = 300


class Moment(NamedTuple):
    """The values that a reset or a step returned. The picture's hash is 0 if no picture was drawn."""

    seed: int
    step: int  # 0 for the reset
    mission: str
    observation: int
    state: int
    reward: float
    terminated: bool
    truncated: bool
    picture: int = 0

    @property
    def description(self) -> str:
        """Return a description of the moment, such as "step 3 of seed 0"."""
        if self.step:
            return f"step {self.step} of seed {self.seed}"
        return f"the reset with seed {self.seed}"

    def find_difference(self, moment: "Moment") -> str:
        """Return the name of the first field that differs from another moment, or "" if none does. NaN equals NaN."""
        names = ("mission", "observation", "state", "reward", "terminated", "truncated", "picture")
        differing = (name for name in names if not _is_same(getattr(self, name), getattr(moment, name)))
        return next(differing, "")


@dataclass(slots=True)
class ConformanceReport:
    """The sentences of a conformance report.

    Attributes:
        broken: what would break a session.
        unsound: what would be wrong in a session's log.
        unprovable: what would keep a log from being verified.
        notices: what is unusual but does no harm.
    """

    broken: list[str] = field(default_factory=list)
    unsound: list[str] = field(default_factory=list)
    unprovable: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)


def examine_world(rehearsal: Rehearsal, replay_elsewhere: "SecondProcess | None" = None) -> ConformanceReport:
    """Play a world and report on its conformance.

    The first error that would break a session ends the check.

    Args:
        rehearsal: the world to play, and how to play it.
        replay_elsewhere: a function that plays the same rehearsal in a second process; None to skip this comparison.
    """
    report = ConformanceReport()
    try:
        _examine(rehearsal, replay_elsewhere, report)
    except WorldError as error:
        report.broken.append(str(error).removeprefix(f"{rehearsal.world}: "))
    return report


SecondProcess = Callable[[Rehearsal], Sequence[Moment] | str]  # returns the moments, or why there are none


def _examine(rehearsal: Rehearsal, replay_elsewhere: SecondProcess | None, report: ConformanceReport) -> None:
    """Play a world in the ways that a session does, and add what is wrong to the report."""
    started_s = time.perf_counter()
    with closing(World(rehearsal.world, rehearsal.options)) as world:
        start_s = time.perf_counter() - started_s
        if isinstance(world.actions, VectorActions) and world.actions.unbound:
            part_count = len(world.actions.rest)
            bound = part_count - world.actions.unbound
            report.notices.append(
                f"keys move the first {bound} of {part_count} parts of an action; the others stay at rest"
            )
        if world.is_built_in:
            return
        names = world.action_names
        duplicate = next((name for name in names if names.count(name) > 1), "")
        if duplicate:
            report.notices.append(
                f"two actions are called {duplicate!r}, and keys do the first of them; name them apart"
            )
        if start_s > SLOW_START_S:
            report.notices.append(f"it takes {start_s:.1f} s to make, which a participant waits")
        watch = _ValueWatch(world, report)
        with_pictures = play(world, rehearsal, draws=True, watch=watch)
        watch.report_pictures()
        with closing(World(rehearsal.world, rehearsal.options)) as second_world:
            without_pictures = play(second_world, rehearsal, draws=False)
            difference = _describe_difference(with_pictures, without_pictures)
            if difference:
                report.unprovable.append(_explain_replay(rehearsal, difference, without_pictures))
            else:
                _examine_copy(second_world, rehearsal, report)
    if replay_elsewhere is not None and not report.unprovable:
        _compare_processes(with_pictures, replay_elsewhere(rehearsal), report)


def play(world: World, rehearsal: Rehearsal, *, draws: bool, watch: "_ValueWatch | None" = None) -> list[Moment]:
    """Play episodes with the rehearsal's seeds in turn until its number of steps is reached, and return each moment.

    The actions are drawn at random from the rehearsal's first seed.

    Args:
        world: the world.
        rehearsal: how to play it.
        draws: whether a picture is drawn after each reset and step.
        watch: a checker of the values that the world returns; None to check none.

    Raises:
        WorldError: at the first error after which a session could not continue; the message says where it occurred.
    """
    random_stream = np.random.default_rng(rehearsal.seeds[0])
    moments: list[Moment] = []
    steps = 0
    episodes = 0
    while steps < rehearsal.steps and episodes < rehearsal.steps:
        seed = rehearsal.seeds[episodes % len(rehearsal.seeds)]
        episodes += 1
        moments.append(_take(world, rehearsal, (seed, 0), partial(world.reset, seed), draws=draws, watch=watch))
        for step in range(1, min(EPISODE_STEPS, rehearsal.max_steps) + 1):
            action = rehearsal.actions[int(random_stream.integers(len(rehearsal.actions)))]
            moments.append(_take(world, rehearsal, (seed, step), partial(world.step, action), draws=draws, watch=watch))
            steps += 1
            if moments[-1].terminated or moments[-1].truncated:
                break
    return moments


def _take(
    world: World,
    rehearsal: Rehearsal,
    seed_and_step: tuple[int, int],
    act: Callable[[], ResetResult | StepResult],
    *,
    draws: bool,
    watch: "_ValueWatch | None",
) -> Moment:
    """Call ``act``, which resets or steps the world, draw a picture if ``draws``, and return the values as a moment.

    The watch, if any, checks the values. The number of the step is 0 for a reset.
    """
    # only the seed and the step are known yet, for the messages of errors
    moment = Moment(*seed_and_step, "", 0, 0, 0.0, terminated=False, truncated=False)
    try:
        transition = act()
        if world.pose() is not None and not moment.step:
            world.map()
        if draws:
            picture = world.frame(rehearsal.view, rehearsal.size_px, rehearsal.palette)
        else:
            picture = None
        moment = moment._replace(
            observation=transition.observation_hash,
            state=world.state_hash(),
            picture=0 if picture is None else hash64(np.ascontiguousarray(picture)),
        )
    except WorldError as error:
        raise WorldError(f"{error}, at {moment.description}") from error
    if isinstance(transition, ResetResult):
        moment = moment._replace(mission=transition.mission)
    else:
        moment = moment._replace(
            reward=transition.reward, terminated=transition.terminated, truncated=transition.truncated
        )
    if watch is not None:
        watch.check(moment, None if picture is None else picture.shape)
    return moment


class _ValueWatch:
    """A checker of the observations, rewards and pictures of a play. It reports each kind of problem once."""

    def __init__(self, world: World, report: ConformanceReport) -> None:
        self._world = world
        self._report = report
        self._type = ""  # the type of the first picture that is not of uint8
        self._outside = ""  # what was first outside the observation space
        self._shapes: dict[tuple[int, ...], str] = {}  # by a picture's shape, where it first occurred

    def check(self, moment: Moment, shape: tuple[int, ...] | None) -> None:
        """Check the values that the world has just returned, with the shape of a picture if one was drawn."""
        if not self._outside and (outside := self._find_outside()):
            self._outside = outside
            self._report.notices.append(
                f"at {moment.description}, {outside}; correct it or observation_space, by which exports go"
            )
        if not math.isfinite(moment.reward) and not self._report.unsound:
            reward = moment.reward
            self._report.unsound.append(f"the reward is {reward} at {moment.description}; return a finite number")
        if shape is not None:
            self._shapes.setdefault(shape, moment.description)
            self._type = self._type or self._find_picture_type(moment)

    def _find_outside(self) -> str:
        """Return a description of the first part of the observation that is outside its space; "" if none is."""
        world = self._world
        with contain_errors(world.id, "its observation_space"):
            return find_outside(world.observation, world.observation_space)

    def _find_picture_type(self, moment: Moment) -> str:
        """Return the type of the picture that the environment itself draws after a reset.

        The result is "" for uint8, after a step, and if participants do not see the environment's own picture.
        """
        if moment.step or not self._world.draws_itself:
            return ""
        with contain_errors(self._world.id, "render()"):
            picture = self._world.render((640, 480))
        if picture.dtype == np.uint8:
            return ""
        return str(picture.dtype)

    def report_pictures(self) -> None:
        """Report pictures that change size, and pictures of a type other than uint8."""
        shapes = list(self._shapes.items())
        if len(shapes) > 1:
            (first_shape, _), (second_shape, moment_name) = shapes[:2]
            self._report.notices.append(
                f"its picture changes size: {first_shape[1]} x {first_shape[0]} pixels at first, {second_shape[1]} x "
                f"{second_shape[0]} at {moment_name}; LeRobot, robomimic and RLDS cannot hold that"
            )
        if self._type:
            self._report.notices.append(f"its picture is of {self._type}; fractions are cut off, so return uint8")


def _describe_difference(first_play: Sequence[Moment], second_play: Sequence[Moment]) -> str:
    """Describe where two plays first differ, such as "the observation at step 3 of seed 0"; "" if they are equal.

    Pictures are compared only where both plays drew them.
    """
    for first, second in zip(first_play, second_play, strict=False):
        if first.picture and second.picture:
            part = first.find_difference(second)
        else:
            part = first._replace(picture=0).find_difference(second._replace(picture=0))
        if part:
            return f"the {part} at {first.description}"
    if len(first_play) == len(second_play):
        return ""
    return "how many steps were made"


def _explain_replay(rehearsal: Rehearsal, difference: str, without_pictures: Sequence[Moment]) -> str:
    """Return a sentence that says why a play with pictures differs from one without.

    Either drawing has side effects, or the world is nondeterministic, so that another play without pictures differs.
    """
    with closing(World(rehearsal.world, rehearsal.options)) as world:
        repetition = play(world, rehearsal, draws=False)
    repeat_difference = _describe_difference(without_pictures, repetition)
    if not repeat_difference:
        return (
            f"drawing changes it: with pictures {difference} differs from without; let render() change nothing, so "
            "draw no random numbers from np_random in it"
        )
    first = without_pictures[0]
    is_unseeded = first.observation == repetition[0].observation and first.state != repetition[0].state
    if is_unseeded:
        remedy = "call super().reset(seed=seed) in reset()"
    else:
        remedy = "draw every random number from self.np_random"
    return (
        f"nondeterministic: two plays of one seed differ, first in {repeat_difference}, so no log proves it; {remedy}, "
        "or set record_observations = true in its block, which keeps what was seen"
    )


def _examine_copy(world: World, rehearsal: Rehearsal, report: ConformanceReport) -> None:
    """Check a copy of the world in mid-episode: play on, restore the copy, play on again, and report any difference."""
    seed = rehearsal.seeds[0]
    for n_steps in (N_STEPS_BEFORE_SAVE, 1):  # 1 if the episode is over within the former
        world.reset(seed)
        if _make_steps(world, rehearsal, n_steps):
            break
    else:
        return  # episodes end with their first step, so there is no middle to save
    try:
        saved = world.save()
    except WorldError:
        report.notices.append("it cannot be copied, so a browser shows each step one round trip after its key")
        return
    first_play = _play_after_save(world, rehearsal)
    try:
        world.restore(saved)
        second_play = _play_after_save(world, rehearsal)
    except WorldError as error:
        report.unprovable.append(f"a copy of it in mid-episode cannot be gone back to ({error}); {_COPY_ADVICE}")
        return
    difference = _describe_difference(first_play, second_play)
    if difference:
        report.unprovable.append(f"gone back to a copy of it in mid-episode, {difference} differs; {_COPY_ADVICE}")


_COPY_ADVICE = "keep all that changes in attributes of the environment, or let copy.deepcopy of one raise"


def _make_steps(world: World, rehearsal: Rehearsal, n_steps: int) -> bool:
    """Make steps with the rehearsal's actions in turn; return False as soon as a step ends the episode, else True."""
    for number in range(n_steps):
        transition = world.step(rehearsal.actions[number % len(rehearsal.actions)])
        if transition.terminated or transition.truncated:
            return False
    return True


def _play_after_save(world: World, rehearsal: Rehearsal) -> list[Moment]:
    """Play some steps from the world's present state; return what each of them returned."""
    moments = []
    for number in range(N_STEPS_AFTER_SAVE):
        transition = world.step(rehearsal.actions[number % len(rehearsal.actions)])
        moments.append(
            Moment(
                rehearsal.seeds[0],
                number + 1,
                "",
                transition.observation_hash,
                world.state_hash(),
                transition.reward,
                transition.terminated,
                transition.truncated,
            )
        )
        if transition.terminated or transition.truncated:
            break
    return moments


def _compare_processes(moments: Sequence[Moment], replay: Sequence[Moment] | str, report: ConformanceReport) -> None:
    """Report how a replay in another process differs from the play here, or the text that says why there is none."""
    if isinstance(replay, str):
        report.notices.append(f"it was not played in a second process: {replay}")
        return
    difference = _describe_difference(moments, replay)
    if difference.startswith("the picture"):
        report.unprovable.append(
            f"{difference} differs between two plays, and nothing else does, so no log proves what was seen; draw only "
            "what the seed and the actions decide"
        )
    elif difference:
        report.unprovable.append(
            f"it plays differently in a second process, first in {difference}, so no log proves it; the order of "
            "sets, hash(), time and files differ there"
        )


def _is_same(first: Any, second: Any) -> bool:
    """Return whether two values are equal, or both NaN."""
    return bool(first == second) or (first != first and second != second)
