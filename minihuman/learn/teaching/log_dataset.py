"""Reading a teaching dataset from logs.

Episodes are replayed and checked against the logs; steering, ratings and comparisons are read with them.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences.events import PairAnswer
from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.learn.demonstrations import (
    LoggedEpisode,
    get_shared_plan,
    list_used_actions,
    replay_observations,
    select_episodes,
)
from minihuman.learn.policy.observation import EpisodeEncoder, Observation, ObservationEncoder
from minihuman.learn.teaching.dataset import (
    NO_QUERY,
    Answer,
    Comparison,
    Dataset,
    Lesson,
    LessonFragment,
    LessonRating,
    Source,
)
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.log.model.teaching_events import CorrectionRecord
from minihuman.log.read.session_reader import read_log
from minihuman.storage.durable_files import hash_file
from minihuman.worlds.adapters.world import World

VIEW = ObservationEncoder(missions=False)
ANSWERS: dict[PairAnswer, Answer] = {
    "left": "left",
    "right": "right",
    "equal": "equal",
    "cannot_tell": "cannot tell",
}


def read_session_dataset(
    logs: Sequence[Path], block: str, episodes: int, *, eyesight: ObservationEncoder = VIEW
) -> Dataset:
    """Return the dataset of one block of a session, which can still be running, up to a given episode.

    It includes the corrections of these episodes. It also includes the session's comparisons of episodes of the same
    world, and the compared episodes.

    Args:
        logs: the session's logs, finished or live, all in one folder
        block: the block's name
        episodes: only episodes among this many from the start of the session are included
        eyesight: the settings of the policy's observations

    Raises:
        LearnError: if there is no such episode, or an episode does not replay.
    """
    log = read_log(logs[0].parent)
    played = [episode for episode in log.episodes if episode.plan.episode < episodes and len(episode.actions)]
    block_episodes = [episode for episode in played if episode.plan.block_name == block]
    if not block_episodes:
        raise LearnError(
            f"{logs[0].parent} has no step of block {block!r} before episode {episodes + 1}; play an episode of that "
            "block first"
        )
    compared = _list_compared(log, played, block_episodes[0].plan)
    selected = [(log, episode) for episode in played if episode in block_episodes or episode in compared]
    finished_logs = [path for path in sorted(logs) if path.suffix == ".mcap"]
    live_logs = [path for path in sorted(logs) if path.suffix != ".mcap"]
    sources = [Source(path.name, hash_file(path), len(selected)) for path in finished_logs]
    sources += [Source(path.name, "", len(selected)) for path in live_logs]
    return _build_dataset(selected, eyesight, tuple(sources), (f"block {block!r}, episodes before {episodes + 1}",))


def _list_compared(log: SessionLog, episodes: Sequence[EpisodeLog], plan: EpisodePlan) -> list[EpisodeLog]:
    """Return the episodes that were compared in a session and have the world and the options of a plan.

    Args:
        log: the log of the session.
        episodes: the episodes from which to choose.
        plan: the plan of an episode with the world and the options.
    """
    compared = set[tuple[int, int]]()  # episode and attempt
    for comparison in log.comparisons:
        compared.add((comparison.left.episode, comparison.left.attempt))
        compared.add((comparison.right.episode, comparison.right.attempt))
    return [
        episode
        for episode in episodes
        if (episode.plan.episode, episode.attempt) in compared
        and episode.plan.world == plan.world
        and episode.plan.options == plan.options
    ]


def read_study_dataset(
    source: Path, world: str, *, eyesight: ObservationEncoder = VIEW, selection: Selection | None = None
) -> Dataset:
    """Return the dataset of all included episodes of one world in a study's logs.

    Args:
        source: a study's folder, or a log.
        world: the world's Gymnasium id.
        eyesight: the settings of the policy's observations.
        selection: the rule for which sessions and episodes are included; None for that of ``Selection()``.

    Raises:
        LearnError: if there is no such episode, episodes have different options, or an episode does not replay.
    """
    selected, summary = select_episodes(source, world, selection or Selection())
    n_lessons = Counter(log.path for log, _ in selected)
    sources = tuple(_describe_source(path, lessons) for path, lessons in n_lessons.items())
    return _build_dataset(selected, eyesight, sources, tuple(summary.lines()))


def _describe_source(path: Path, lessons: int) -> Source:
    """Return a log as a source of lessons; its digest is "" for a session in several files, which is unfinished.

    Args:
        path: the log, or the folder of the session's files.
        lessons: the number of the log's episodes in the dataset.
    """
    sha256 = ""
    if path.is_file():
        sha256 = hash_file(path)
    return Source(path.name, sha256, lessons)


def _build_dataset(
    episodes: Sequence[LoggedEpisode],
    eyesight: ObservationEncoder,
    sources: tuple[Source, ...],
    selection: tuple[str, ...],
) -> Dataset:
    """Replay episodes and return them as a dataset, with their corrections, ratings and comparisons.

    Args:
        episodes: the episodes, each with its log.
        eyesight: the settings of the policy's observations.
        sources: the logs, as the dataset names them.
        selection: lines that say which episodes are included.

    Raises:
        LearnError: if episodes have different options, or an episode or a correction does not replay.
    """
    plan = get_shared_plan(episodes)
    corrections = [correction for _, correction in _select_corrections(episodes)]
    corrected_actions = [int(correction.actions.max()) for correction in corrections if len(correction.actions)]
    names = list_used_actions(episodes, least=max(corrected_actions, default=0))
    world = World(plan.world, plan.options)
    world.reset(plan.seed)
    lessons = tuple(_list_lessons(episodes, world, eyesight.episode_encoder(), len(names)))
    lessons += tuple(_list_corrections(episodes, world, eyesight.episode_encoder()))
    return Dataset(
        world=plan.world,
        options=plan.options,
        action_names=names,
        most_steps=max(episode.plan.max_steps for _, episode in episodes),
        eyesight=eyesight,
        space=eyesight.space(world.unwrapped),
        lessons=lessons,
        ratings=tuple(_list_ratings(episodes)),
        comparisons=tuple(_list_comparisons(episodes)),
        sources=sources,
        selection=selection,
    )


def _list_lessons(
    episodes: Sequence[LoggedEpisode], world: World, encoder: EpisodeEncoder, actions: int
) -> Iterator[Lesson]:
    """Replay episodes, and yield each as a lesson.

    Args:
        episodes: the episodes, each with its log.
        world: a world of their id and options.
        encoder: encodes the world's observations.
        actions: the number of actions, from the world's first, whose probabilities by the policy a lesson has.
    """
    for log, episode in episodes:
        observations = list(replay_observations(log, episode, world, encoder))
        n = len(episode.actions)
        taught = episode.taught
        probabilities = None
        by_person = np.ones(n, np.bool_)
        policy_actions = np.full(n, NO_QUERY, np.int64)
        policy = ""
        if taught is not None:
            by_person = taught.by_person
            policy_actions = taught.policy_actions
            policy = taught.policy
            if taught.probabilities.any():
                probabilities = np.ascontiguousarray(taught.probabilities[:, :actions])
        yield Lesson(
            name=_name_lesson(log, episode),
            participant=log.plan.participant.id,
            seed=episode.plan.seed,
            observations=_stack_observations(observations),
            actions=np.asarray(episode.actions, np.int64),
            by_person=by_person,
            policy_actions=policy_actions,
            shown_ns=_get_display_times_ns(episode),
            rewards=np.asarray(episode.rewards, np.float64),
            policy_probabilities=probabilities,
            policy=policy,
        )


def _select_corrections(episodes: Sequence[LoggedEpisode]) -> Iterator[tuple[SessionLog, CorrectionRecord]]:
    """Yield the corrections of the given episodes, each with the log of its session."""
    episode_keys = {(log.path, episode.plan.episode, episode.attempt) for log, episode in episodes}
    for log in {log.path: log for log, _ in episodes}.values():
        for correction in log.corrections:
            if (log.path, correction.episode, correction.attempt) in episode_keys:
                yield log, correction


def _stack_observations(observations: Sequence[Observation]) -> dict[str, NDArray[Any]]:
    """Return each part of the observations as an array with one row per observation."""
    return {name: np.stack([observation[name] for observation in observations]) for name in observations[0]}


def _list_corrections(episodes: Sequence[LoggedEpisode], world: World, encoder: EpisodeEncoder) -> Iterator[Lesson]:
    """Replay the corrections of episodes, and yield each as a lesson that begins where the person took over.

    Raises:
        LearnError: if a correction does not replay as recorded.
    """
    for log, correction in _select_corrections(episodes):
        n = len(correction.actions)
        if not n:
            continue
        observations = list[Observation]()
        hashes = list[int]()
        world.reset(correction.seed)
        for step, action in enumerate((*correction.before, *correction.actions)):
            observation = encoder.encode(world.unwrapped, world.observation)
            if step >= correction.step:
                observations.append(observation)
                hashes.append(world.state_hash())
            world.step(int(action))
        name = make_lesson_name(_name_session(log), correction.episode, correction.attempt)
        hashes.append(world.state_hash())
        if not np.array_equal(np.array(hashes, np.uint64), correction.state_hashes):
            raise LearnError(
                f"{log.path}: a correction of {name} does not replay as recorded; run `minihuman verify` to see where "
                "it differs"
            )
        yield Lesson(
            name=f"{name}:corrected-{correction.part}-{correction.correction}",
            participant=log.plan.participant.id,
            seed=correction.seed,
            observations=_stack_observations(observations),
            actions=np.asarray(correction.actions, np.int64),
            by_person=np.ones(n, np.bool_),
            policy_actions=np.full(n, NO_QUERY, np.int64),
            shown_ns=np.asarray(correction.t_ns[:-1], np.int64),
            rewards=np.asarray(correction.rewards, np.float64),
            corrects=(name, correction.step),
        )


def _get_display_times_ns(episode: EpisodeLog) -> NDArray[np.int64]:
    """Return the session time at which the frame before each step was displayed, in nanoseconds, int64[steps].

    If a frame was never displayed, its time is that of the previous step.
    """
    display_times_ns = np.array(episode.t_ns[:-1], np.int64)
    steps = episode.frames.column("step")
    flips = episode.frames.column("flip_ns")
    for step, flip_ns in zip(reversed(steps), reversed(flips), strict=True):  # so that a step's first flip counts
        if step < len(display_times_ns):
            display_times_ns[step] = flip_ns
    return display_times_ns


def _list_ratings(episodes: Sequence[LoggedEpisode]) -> Iterator[LessonRating]:
    """Yield the ratings that people gave during episodes."""
    for log, episode in episodes:
        if episode.taught is not None:
            for rated in episode.taught.ratings:
                yield LessonRating(rated.pressed_ns, rated.value, _name_lesson(log, episode))


def _list_comparisons(episodes: Sequence[LoggedEpisode]) -> Iterator[Comparison]:
    """Yield the comparisons whose two episodes are both among the given ones."""
    names = {(log.path, episode.plan.episode, episode.attempt): _name_lesson(log, episode) for log, episode in episodes}
    for log in {log.path: log for log, _ in episodes}.values():
        for comparison in log.comparisons:
            left_name = names.get((log.path, comparison.left.episode, comparison.left.attempt))
            right_name = names.get((log.path, comparison.right.episode, comparison.right.attempt))
            if left_name is not None and right_name is not None:
                left = make_fragment(comparison.left, left_name)
                right = make_fragment(comparison.right, right_name)
                yield Comparison(left, right, ANSWERS[comparison.preference.answer])


def make_fragment(clip: EpisodeClip, lesson: str) -> LessonFragment:
    """Return the part of an episode's lesson that a clip of the episode shows.

    Args:
        clip: the clip.
        lesson: the name of the lesson.
    """
    return LessonFragment(lesson, clip.first, len(clip.actions) - 1)


def _name_lesson(log: SessionLog, episode: EpisodeLog) -> str:
    return make_lesson_name(_name_session(log), episode.plan.episode, episode.attempt)


def _name_session(log: SessionLog) -> str:
    """Return the name of a session, such as "sub-01_ses-01"."""
    return f"{log.plan.participant.id}_ses-{log.plan.session:02}"


def make_lesson_name(session: str, episode: int, attempt: int) -> str:
    """Return the name of an episode's lesson, such as "sub-01_ses-01:3", or "sub-01_ses-01:3:2" for a second attempt.

    Args:
        session: the name of the session.
        episode: the number of the episode in the session, from 0.
        attempt: the number of the attempt, from 1.
    """
    name = f"{session}:{episode + 1}"
    if attempt > 1:
        name += f":{attempt}"
    return name
