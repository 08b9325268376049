"""Recorded episodes as the page replays them: times and places from the log, pictures drawn again by the world.

Each picture is checked against the log (`render_frames`), so that a replay shows what the participant saw.
"""

import io
import json
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image

from minihuman.builder.data_messages import (
    EpisodeReplay,
    EpisodeSummary,
    GivenAnswer,
    ReplayMap,
    ReplayStep,
    ReplayThing,
    SessionDetails,
)
from minihuman.dataset.measures import response_ms
from minihuman.errors import LogError
from minihuman.experiment.machine.events import Answered
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.replay.frames import render_frames
from minihuman.worlds.pose import Map

FRAME_PX = (480, 360)
_KEPT_EPISODES = 2  # whose pictures are cached, as a page requests them one by one
_POINT_DIGITS = 3  # of a position and a yaw
_NS_PER_MS = 1e6
_Point = tuple[float, float]


def describe_session(log: SessionLog) -> SessionDetails:
    """Return the last attempt at each of a session's episodes, and all answers of the participant."""
    last_attempts = {episode.number: episode for episode in log.episodes}
    episodes = [
        EpisodeSummary(
            number,
            episode.plan.block_name,
            episode.plan.world,
            episode.outcome_word,
            len(episode.actions),
            episode.return_,
        )
        for number, episode in sorted(last_attempts.items())
    ]
    answers = [
        GivenAnswer(event.part_name, event.item, event.kind, _format_answer(event), event.attempt, event.right)
        for segment in log.segments
        for event in segment.part_events
        if isinstance(event, Answered)
    ]
    return SessionDetails(episodes, answers)


def describe_episode(log: SessionLog, number: int) -> EpisodeReplay:
    """Return what happened in the last attempt at an episode, step by step; the first step is the reset.

    Raises:
        LogError: if the session has no such episode.
    """
    episode = _find_episode(log, number)
    steps = [ReplayStep(0.0, "", "", 0.0, None, *_get_pose(episode, 0))]
    reaction_times = response_ms(episode)
    for index in range(len(episode.actions)):
        action = episode.start.action_names[int(episode.actions[index])] if episode.action_vectors is None else ""
        reaction_ms = float(reaction_times[index])
        since_reset_ns = int(episode.t_ns[index + 1]) - int(episode.t_ns[0])
        steps.append(
            ReplayStep(
                since_reset_ns / _NS_PER_MS,
                episode.step_keys[index],
                action,
                float(episode.rewards[index]),
                None if np.isnan(reaction_ms) else reaction_ms,
                *_get_pose(episode, index + 1),
            )
        )
    return EpisodeReplay(number, episode.start.mission, episode.outcome_word, steps, _describe_floor(episode.start.map))


def draw_step(log: Path, number: int, step: int) -> bytes:
    """Draw what the participant saw after a step of an episode, as a PNG; step 0 is the reset.

    Raises:
        LogError: if there is no such episode or step, or the world no longer shows what the participant saw.
        WorldError: if the world cannot be run here, and the log has no pictures.
    """
    pictures = _draw_episode(log, log.stat().st_mtime_ns, number)
    if not 0 <= step < len(pictures):
        raise LogError(f"{log}: episode {number} has no step {step}; its steps are 0 to {len(pictures) - 1}")
    return pictures[step]


@lru_cache(maxsize=_KEPT_EPISODES)
def _draw_episode(log: Path, modified_ns: int, number: int) -> tuple[bytes, ...]:
    """Return every picture of an episode as PNG, that of the reset first.

    ``modified_ns``, the time of the log's last change, is only part of the cache's key, as the log may have grown.
    """
    return tuple(_encode_png(picture) for picture in render_frames(_find_episode(read_log(log), number), FRAME_PX))


def _encode_png(picture: np.ndarray) -> bytes:
    png = io.BytesIO()
    Image.fromarray(picture).save(png, "PNG", compress_level=1)
    return png.getvalue()


def _find_episode(log: SessionLog, number: int) -> EpisodeLog:
    """Return the last attempt at an episode.

    Raises:
        LogError: if the session has no such episode.
    """
    attempts = [episode for episode in log.episodes if episode.number == number]
    if not attempts:
        recorded_numbers = sorted({episode.number for episode in log.episodes})
        numbers = ", ".join(map(str, recorded_numbers)) or "none"
        raise LogError(f"{log.path} has no episode {number}; its episodes are {numbers}")
    return attempts[-1]


def _get_pose(episode: EpisodeLog, state: int) -> tuple[_Point | None, float | None]:
    """Return the position (x, z), in the floor plan's units, and the yaw in radians in a state of an episode.

    Both are None if no pose was recorded. State 0 is that after the reset.
    """
    x, _, z, yaw_rad = (float(number) for number in episode.poses[state])
    if np.isnan(x):
        return None, None
    return (round(x, _POINT_DIGITS), round(z, _POINT_DIGITS)), round(yaw_rad, _POINT_DIGITS)


def _describe_floor(floor: Map | None) -> ReplayMap | None:
    if floor is None:
        return None
    things = [ReplayThing(thing.name, thing.x, thing.z, thing.radius, thing.colour) for thing in floor.things]
    return ReplayMap(floor.unit, floor.bounds, list(floor.walls), things)


def _format_answer(event: Answered) -> str:
    """Return an answer in the words that the participant saw, else its value as text; "" for no answer."""
    if event.words:
        return event.words
    answer = json.loads(event.value)
    return "" if answer is None else str(answer)
