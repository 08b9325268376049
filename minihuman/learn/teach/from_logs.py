"""What was taught, from logs: episodes are played again and checked; who steered and what was rated is read beside."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.data.chosen import ChosenEpisodes
from minihuman.data.selection import Selection
from minihuman.data.study import Sessions
from minihuman.errors import LearnError
from minihuman.learn.agent.observe import Eyesight, Looker, Observation
from minihuman.learn.teach.dataset import NOBODY_ASKED, Answer, Comparison, Dataset, Lesson, Rating, Source, Stretch
from minihuman.learn.teach.made import file_sha256
from minihuman.log.read.open_log import open_log
from minihuman.recorded.corrected import Corrected
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.study.activities import pair_events
from minihuman.worlds.adapt.world import World

Taken = tuple[SessionLog, Episode]
VIEW = Eyesight(missions=False)
ANSWERS: dict[pair_events.Verdict, Answer] = {
    "left": "left",
    "right": "right",
    "equal": "equal",
    "cannot_tell": "cannot tell",
}


def of_session(logs: Sequence[Path], block: str, episodes: int, *, eyesight: Eyesight = VIEW) -> Dataset:
    """Everything taught in one block of a session, of its first episodes; the session may still be going on.

    What was shown better of these episodes counts too, and what was compared, if it is of episodes of the same world;
    these are taken with it.

    Args:
        logs: The session's logs, finished or live, all in one folder.
        block: The block's name.
        episodes: Episodes of the session from this one on, counted from 0, are left out.
        eyesight: What the policy is to see.

    Raises:
        LearnError: if there is no such episode, or one does not replay.
    """
    log = open_log(logs[0].parent)
    played = [episode for episode in log.episodes if episode.plan.episode < episodes and len(episode.actions)]
    own = [episode for episode in played if episode.plan.block_name == block]
    if not own:
        raise LearnError(f"{logs[0].parent} has no step of block {block!r} before episode {episodes + 1}")
    of = own[0].plan
    compared = {(side.episode, side.attempt) for each in log.comparisons for side in (each.left, each.right)}
    taken = [
        (log, episode)
        for episode in played
        if episode in own
        or (
            (episode.plan.episode, episode.attempt) in compared
            and (episode.plan.world, episode.plan.options) == (of.world, of.options)
        )
    ]
    finished = [path for path in sorted(logs) if path.suffix == ".mcap"]
    sources = [Source(path.name, file_sha256(path), len(taken)) for path in finished]
    sources += [Source(path.name, "", len(taken)) for path in sorted(logs) if path.suffix != ".mcap"]
    return _dataset(taken, eyesight, tuple(sources), (f"block {block!r}, episodes before {episodes + 1}",))


def of_study(source: Path, world: str, *, eyesight: Eyesight = VIEW, selection: Selection | None = None) -> Dataset:
    """Everything taught in one world in a study's logs, of the episodes that count.

    Raises:
        LearnError: if there is none, they were made under different options, or one does not replay.
    """
    sessions = Sessions(source, selection or Selection())
    chosen = [item for item in ChosenEpisodes(sessions) if item.episode.plan.world == world]
    taken = [(item.log, item.episode) for item in chosen if len(item.episode.actions)]
    account = tuple(sessions.account.lines())
    if not taken:
        raise LearnError(f"{source} has no episode of {world} that counts: {'; '.join(account)}")
    logs = {log.path: sum(other.path == log.path for other, _ in taken) for log, _ in taken}
    sources = tuple(
        Source(path.name, file_sha256(path) if path.is_file() else "", lessons) for path, lessons in logs.items()
    )
    return _dataset(taken, eyesight, sources, account)


def _dataset(
    taken: Sequence[Taken], eyesight: Eyesight, sources: tuple[Source, ...], selection: tuple[str, ...]
) -> Dataset:
    plan = taken[0][1].plan
    if odd := next((episode for _, episode in taken if episode.plan.options != plan.options), None):
        raise LearnError(
            f"{taken[0][0].path} has episodes of {plan.world} with options {plan.options} and {odd.plan.options}; "
            "choose one kind with --block"
        )
    names = taken[0][1].start.action_names
    used = {name for _, episode in taken for name in _actions_of(episode)}
    shown = [int(each.actions.max()) for _, each in _corrected(taken) if len(each.actions)]
    kept = names[: 1 + max([*(names.index(name) for name in used), *shown])]
    world = World(plan.world, plan.options)
    world.reset(plan.seed)
    lessons = tuple(_lessons(taken, world, eyesight.looker(), len(kept)))
    lessons += tuple(_corrections(taken, world, eyesight.looker()))
    return Dataset(
        world=plan.world,
        options=plan.options,
        action_names=kept,
        most_steps=max(episode.plan.max_steps for _, episode in taken),
        eyesight=eyesight,
        space=eyesight.space(world.unwrapped),
        lessons=lessons,
        ratings=tuple(_ratings(taken)),
        comparisons=tuple(_comparisons(taken)),
        sources=sources,
        selection=selection,
    )


def _actions_of(episode: Episode) -> tuple[str, ...]:
    """The actions that had a key, or were a tick's no-op."""
    return *episode.plan.key_map.keys.values(), *([episode.plan.noop] if episode.plan.noop else [])


def _lessons(taken: Sequence[Taken], world: World, looker: Looker, actions: int) -> Iterator[Lesson]:
    for log, episode in taken:
        seen = list(_replayed(log, episode, world, looker))
        n, taught = len(episode.actions), episode.taught
        said = None
        if taught is not None and taught.probabilities.any():
            said = np.ascontiguousarray(taught.probabilities[:, :actions])
        yield Lesson(
            name=_name(log, episode),
            participant=log.plan.participant.id,
            seed=episode.plan.seed,
            observations={part: np.stack([each[part] for each in seen]) for part in seen[0]},
            actions=np.asarray(episode.actions, np.int64),
            by_person=np.ones(n, np.bool_) if taught is None else taught.by_person,
            policy_actions=np.full(n, NOBODY_ASKED, np.int64) if taught is None else taught.policy_actions,
            shown_ns=_shown_ns(episode),
            rewards=np.asarray(episode.rewards, np.float64),
            policy_probabilities=said,
            policy="" if taught is None else taught.policy,
        )


def _replayed(log: SessionLog, episode: Episode, world: World, looker: Looker) -> Iterator[Observation]:
    """What was seen before each step, the world checked against the log."""
    hashes = [world.reset(episode.plan.seed).observation_hash]
    for action in episode.actions:
        yield looker.see(world.unwrapped, world.observation)
        hashes.append(world.step(int(action)).observation_hash)
    if not np.array_equal(np.array(hashes, dtype=np.uint64), episode.observation_hashes):
        raise LearnError(f"{log.path}: {episode.name} does not replay; see `minihuman verify` for where")


def _corrected(taken: Sequence[Taken]) -> Iterator[tuple[SessionLog, Corrected]]:
    """What was shown better of episodes that were taken."""
    there = {(log.path, episode.plan.episode, episode.attempt) for log, episode in taken}
    for log in {log.path: log for log, _ in taken}.values():
        for each in log.corrections:
            if (log.path, each.episode, each.attempt) in there:
                yield log, each


def _corrections(taken: Sequence[Taken], world: World, looker: Looker) -> Iterator[Lesson]:
    for log, each in _corrected(taken):
        n = len(each.actions)
        if not n:
            continue
        seen, hashes = list[Observation](), list[int]()
        world.reset(each.seed)
        for step, action in enumerate((*each.before, *each.actions)):
            looked = looker.see(world.unwrapped, world.observation)
            if step >= each.step:
                seen.append(looked)
                hashes.append(world.state_hash())
            world.step(int(action))
        name = lesson_name(_session(log), each.episode, each.attempt)
        if not np.array_equal(np.array([*hashes, world.state_hash()], np.uint64), each.state_hashes):
            raise LearnError(f"{log.path}: a correction of {name} does not replay; see `minihuman verify` for where")
        yield Lesson(
            name=f"{name}:corrected-{each.part}-{each.correction}",
            participant=log.plan.participant.id,
            seed=each.seed,
            observations={part: np.stack([one[part] for one in seen]) for part in seen[0]},
            actions=np.asarray(each.actions, np.int64),
            by_person=np.ones(n, np.bool_),
            policy_actions=np.full(n, NOBODY_ASKED, np.int64),
            shown_ns=np.asarray(each.t_ns[:-1], np.int64),
            rewards=np.asarray(each.rewards, np.float64),
            corrects=(name, each.step),
        )


def _shown_ns(episode: Episode) -> NDArray[np.int64]:
    """When the picture before each step reached the display; when the step before was made, where it never did."""
    shown = np.array(episode.t_ns[:-1], np.int64)
    steps, flips = episode.frames.column("step"), episode.frames.column("flip_ns")
    for step, flip_ns in zip(reversed(steps), reversed(flips), strict=True):  # the first flip of a step stays
        if step < len(shown):
            shown[step] = flip_ns
    return shown


def _ratings(taken: Sequence[Taken]) -> Iterator[Rating]:
    for log, episode in taken:
        if episode.taught is not None:
            for rated in episode.taught.ratings:
                yield Rating(rated.pressed_ns, rated.value, _name(log, episode))


def _comparisons(taken: Sequence[Taken]) -> Iterator[Comparison]:
    """What was said of pairs, both of whose episodes were taken."""
    names = {(log.path, episode.plan.episode, episode.attempt): _name(log, episode) for log, episode in taken}
    for log in {log.path: log for log, _ in taken}.values():
        for each in log.comparisons:
            places = [(log.path, side.episode, side.attempt) for side in (each.left, each.right)]
            if all(place in names for place in places):
                left, right = (
                    stretch_of(side, names[place]) for side, place in zip((each.left, each.right), places, strict=True)
                )
                yield Comparison(left, right, ANSWERS[each.said.answer])


def stretch_of(side: pair_events.Stretch, lesson: str) -> Stretch:
    """A stretch that was shown, as steps of a lesson."""
    return Stretch(lesson, side.first, len(side.actions) - 1)


def _name(log: SessionLog, episode: Episode) -> str:
    return lesson_name(_session(log), episode.plan.episode, episode.attempt)


def _session(log: SessionLog) -> str:
    return f"{log.plan.participant.id}_ses-{log.plan.session:02}"


def lesson_name(session: str, episode: int, attempt: int) -> str:
    """The name of an episode's lesson, as in "sub-01_ses-01:3"; ``episode`` is 0 for the session's first."""
    return f"{session}:{episode + 1}" + (f":{attempt}" if attempt > 1 else "")
