"""Films and contact sheets: what they show is what the log says."""

import os
import sys
from dataclasses import replace

import av
import numpy as np
import pytest
from PIL import Image, ImageColor

from minihuman.display.video import ENCODINGS, VideoWriter
from minihuman.errors import LogError
from minihuman.log.read.session_reader import read_log
from minihuman.replay.film import BLUE, SIZE_PX, compose_frames, write_film
from tests.export.study import recorded


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return read_log(next(recorded(tmp_path_factory.mktemp("film"), participants=1).rglob("*.mcap")))


def lit(image, keys):
    """The keys whose caps are blue."""
    pixels = np.asarray(image)
    caps = {key: pixels[78, 444 + 62 * place] for place, key in enumerate(sorted(keys))}
    return [key for key, colour in caps.items() if tuple(colour) == ImageColor.getrgb(BLUE)]


def test_each_picture_lights_the_key_of_its_step(log):
    episode = log.episodes[0]
    images = list(compose_frames(log, episode))
    n = len(episode.actions)
    assert len(images) >= n + 1
    assert lit(images[0], episode.plan.key_map.keys) == []
    assert [lit(image, episode.plan.key_map.keys) for image in images[1 : n + 1]] == [
        [key] for key in episode.step_keys
    ]


@pytest.mark.parametrize("kind", ["mp4", "webm"])
def test_a_film_has_a_picture_for_the_beginning_and_every_step(log, tmp_path, kind):
    film = write_film(log, tmp_path / f"film.{kind}", episode=2)
    with av.open(str(film)) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    shown = [np.asarray(image) for image in compose_frames(log, log.episodes[1])]
    assert len(frames) == len(shown)
    assert frames[0].shape[1::-1] == SIZE_PX
    assert max(np.abs(a.astype(int) - b).mean() for a, b in zip(frames, shown, strict=True)) < 8
    assert [path.name for path in tmp_path.iterdir()] == [film.name]


def test_a_gif_and_a_contact_sheet_are_pictures(log, tmp_path):
    with Image.open(write_film(log, tmp_path / "film.gif", episode=1)) as film:
        assert film.n_frames > 1
    with Image.open(write_film(log, tmp_path / "sheet.png")) as sheet:
        assert sheet.height > 2 * 150


@pytest.mark.parametrize(
    ("name", "episode", "said"),
    [
        ("film.avi", None, r"one of \.mp4, \.webm, \.gif, \.png"),
        ("film.mp4", 9, "has no episode 9; its episodes are 1, 2, 3, 4"),
    ],
)
def test_what_cannot_be_filmed_is_said_in_one_sentence(log, tmp_path, name, episode, said):
    with pytest.raises(LogError, match=said):
        write_film(log, tmp_path / name, episode=episode)
    assert not list(tmp_path.iterdir())


def test_a_world_that_shows_something_else_leaves_no_film(log, tmp_path):
    episode = log.episodes[0]
    hashes = episode.observation_hashes.copy()
    hashes[1] += 1
    changed = replace(log, episodes=(replace(episode, observation_hashes=hashes),))
    with pytest.raises(LogError, match="no longer shows what the participant saw"):
        write_film(changed, tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="threads have scheduling policies of their own on Linux alone")
@pytest.mark.parametrize("encoding", sorted(ENCODINGS))
def test_no_encoder_leaves_a_thread_at_real_time_priority(encoding, tmp_path):
    with VideoWriter(tmp_path / "film", encoding, fps=10) as video:
        video.write([np.zeros((64, 64, 3), np.uint8)])
        during = {os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task")}
    assert not (during | {os.sched_getscheduler(0)}) & {os.SCHED_FIFO, os.SCHED_RR}
