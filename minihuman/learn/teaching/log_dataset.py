"""Reading a teaching dataset from logs.

Episodes are replayed and checked against the logs; steering, ratings and comparisons are read with them.
"""

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
    check_equal_options,
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

    Corrections of these episodes are included. So are comparisons of episodes of the same world, with the episodes that
    they compare.

    Args:
        logs: the session's logs, finished or live, all in one folder
        block: the block's name
        episodes: the number of episodes from the session's start that can be included
        eyesight: the settings of the policy's observations

    Raises:
        LearnError: if there is no such episode, or an episode does not replay.
    """
    log = read_log(logs[0].parent)
    played = [episode for episode in log.episodes if episode.plan.episode < episodes and len(episode.actions)]
    own = [episode for episode in played if episode.plan.block_name == block]
    if not own:
        raise LearnError(
            f"{logs[0].parent} has no step of block {block!r} before episode {episodes + 1}; play an episode of that "
            "block first"
        )
    compared = _list_compared(log, played, own[0].plan)
    selected = [(log, episode) for episode in played if episode in own or episode in compared]
    finished = [path for path in sorted(logs) if path.suffix == ".mcap"]
    running = [path for path in sorted(logs) if path.suffix != ".mcap"]
    sources = [Source(path.name, hash_file(path), len(selected)) for path in finished]
    sources += [Source(path.name, "", len(selected)) for path in running]
    return _build_dataset(selected, eyesight, tuple(sources), (f"block {block!r}, episodes before {episodes + 1}",))


def _list_compared(log: SessionLog, episodes: Sequence[EpisodeLog], plan: EpisodePlan) -> list[EpisodeLog]:
    """Return the episodes that a comparison shows and that have the world and the options of a plan."""
    compared = set[tuple[int, int]]()
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

    Raises:
        LearnError: if there is no such episode, episodes have different options, or an episode does not replay.
    """
    selected, summary = select_episodes(source, world, selection or Selection())
    logs = {log.path: sum(other.path == log.path for other, _ in selected) for log, _ in selected}
    sources = tuple(_describe_source(path, lessons) for path, lessons in logs.items())
    return _build_dataset(selected, eyesight, sources, tuple(summary.lines()))


def _describe_source(path: Path, lessons: int) -> Source:
    """Return a log's name and digest; the digest is "" while the log is still being written."""
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
    """Replay episodes and return them as a dataset, with their corrections, ratings and comparisons."""
    plan = check_equal_options(episodes)
    corrected = (
        int(correction.actions.max()) for _, correction in _select_corrections(episodes) if len(correction.actions)
    )
    names = list_used_actions(episodes, least=max(corrected, default=0))
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
    """Replay episodes, and yield each as a lesson with the probabilities of the world's first ``actions`` actions."""
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
            shown_ns=_shown_ns(episode),
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
        name = make_lesson_name(_session(log), correction.episode, correction.attempt)
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


def _shown_ns(episode: EpisodeLog) -> NDArray[np.int64]:
    """Return the session time at which the frame before each step was displayed, in nanoseconds.

    If a frame was never displayed, its time is that of the previous step.
    """
    display_times_ns = np.array(episode.t_ns[:-1], np.int64)
    steps = episode.frames.column("step")
    flips = episode.frames.column("flip_ns")
    for step, flip_ns in zip(reversed(steps), reversed(flips), strict=True):  # the first flip of a step stays
        if step < len(display_times_ns):
            display_times_ns[step] = flip_ns
    return display_times_ns


def _list_ratings(episodes: Sequence[LoggedEpisode]) -> Iterator[LessonRating]:
    for log, episode in episodes:
        if episode.taught is not None:
            for rated in episode.taught.ratings:
                yield LessonRating(rated.pressed_ns, rated.value, _name_lesson(log, episode))


def _list_comparisons(episodes: Sequence[LoggedEpisode]) -> Iterator[Comparison]:
    """Yield the comparisons whose two episodes are both among the given ones."""
    names = {(log.path, episode.plan.episode, episode.attempt): _name_lesson(log, episode) for log, episode in episodes}
    for log in {log.path: log for log, _ in episodes}.values():
        for comparison in log.comparisons:
            places = [(log.path, side.episode, side.attempt) for side in (comparison.left, comparison.right)]
            if all(place in names for place in places):
                left, right = (
                    make_fragment(side, names[place])
                    for side, place in zip((comparison.left, comparison.right), places, strict=True)
                )
                yield Comparison(left, right, ANSWERS[comparison.preference.answer])


def make_fragment(side: EpisodeClip, lesson: str) -> LessonFragment:
    """Return a clip as a fragment of its episode's lesson."""
    return LessonFragment(lesson, side.first, len(side.actions) - 1)


def _name_lesson(log: SessionLog, episode: EpisodeLog) -> str:
    return make_lesson_name(_session(log), episode.plan.episode, episode.attempt)


def _session(log: SessionLog) -> str:
    return f"{log.plan.participant.id}_ses-{log.plan.session:02}"


def make_lesson_name(session: str, episode: int, attempt: int) -> str:
    """Return the name of an episode's lesson, such as "sub-01_ses-01:3"; ``episode`` counts from 0 in the session."""
    name = f"{session}:{episode + 1}"
    if attempt > 1:
        name += f":{attempt}"
    return name
