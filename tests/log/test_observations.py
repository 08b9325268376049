"""Observations in a log: where a protocol asks for them, every one, exactly, and provably the one that was made."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given

from minihuman.admin.verify.episodes import verify_episodes
from minihuman.errors import LogError
from minihuman.experiment.machine.events import ObservationStored
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.observations import decode_observation, encode_observation, verify_observations
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import recover_log
from minihuman.worlds.hashing import hash64
from tests.log.played import played_events, record
from tests.log.samples import session_plan
from tests.log.strategies import OBSERVATIONS

WORLDS = ("minihuman/MiniGrid-FourRooms-v0", "minihuman/MiniWorld-FourRooms-v0")


def plan(world: str) -> SessionPlan:
    actions = {"left": "turn_left", "right": "turn_right", "forward": "move_forward"}
    base = session_plan(episodes=2, record=True)
    renamed = [
        msgspec.structs.replace(
            episode,
            world=world,
            options={},
            key_map=msgspec.structs.replace(
                episode.key_map,
                keys={
                    key: actions[name] if "MiniWorld" in world else name for key, name in episode.key_map.keys.items()
                },
            ),
        )
        for episode in base.episodes
    ]
    return msgspec.structs.replace(base, episodes=tuple(renamed))


@pytest.fixture(scope="module", params=WORLDS)
def log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    its = plan(request.param)
    return record(tmp_path_factory.mktemp("data"), its, played_events(its, steps=8))


def all_checked(episode: EpisodeLog) -> list[Any]:
    assert episode.observations is not None
    return list(verify_observations(episode.observations, episode.observation_hashes, episode.plan.episode))


@given(OBSERVATIONS)
def test_what_comes_out_is_what_went_in_type_and_all(observation: Any) -> None:
    again = decode_observation(
        v1.Observation.FromString(v1.Observation(**encode_observation(observation)).SerializeToString())
    )
    assert hash64(again) == hash64(observation)
    assert_alike(again, observation)


def assert_alike(again: Any, given: Any) -> None:
    assert type(again) is type(given) or (isinstance(given, float) and isinstance(again, float))
    match given:
        case np.ndarray():
            assert (again.dtype, again.shape) == (given.dtype, given.shape)
        case dict():
            for key, part in given.items():
                assert_alike(again[key], part)
        case tuple():
            for one, other in zip(again, given, strict=True):
                assert_alike(one, other)


def test_every_observation_of_a_session_is_in_its_log_and_is_the_one_that_was_hashed(log: Path) -> None:
    session = read_log(log)
    for episode in session.episodes:
        assert len(all_checked(episode)) == len(episode.actions) + 1 > 1
    assert verify_episodes(session).difference == ""


def test_another_observation_than_was_made_is_named(log: Path) -> None:
    episode = read_log(log).episodes[1]
    episode.observation_hashes[3] += 1
    with pytest.raises(LogError, match="episode 2 step 3: the stored observation does not match its recorded hash"):
        all_checked(episode)


def test_a_message_that_is_no_observation_is_named(log: Path) -> None:
    episode = read_log(log).episodes[0]
    assert episode.observations is not None
    messages = episode.observations._messages
    broken = type(episode.observations)(0, [messages[0], b"\x22\x03abc", messages[1]])
    with pytest.raises(LogError, match="episode 1 step 1: the stored observation cannot be read"):
        broken[1]
    with pytest.raises(LogError, match="episode 1 step 2: the log has the observation of episode 1 step 1"):
        broken[2]


def test_a_log_cut_off_anywhere_keeps_the_observation_of_every_step_it_keeps(tmp_path: Path) -> None:
    its = plan(WORLDS[0])
    part = record(tmp_path / "whole", its, played_events(its, steps=8))
    data = part.read_bytes()
    for cut in np.linspace(len(data) * 3 // 4, len(data) - 1, 12, dtype=int).tolist():
        (tmp_path / f"cut-{cut}").mkdir()
        again = tmp_path / f"cut-{cut}" / f"{part.name}.part"
        again.write_bytes(data[:cut])
        for episode in read_log(again).episodes:
            assert len(all_checked(episode)) == len(episode.actions) + 1
    for episode in read_log(recover_log(again).path).episodes:
        assert len(all_checked(episode)) == len(episode.actions) + 1


def test_without_being_asked_a_log_holds_none(tmp_path: Path) -> None:
    its = session_plan(episodes=1)
    log = record(tmp_path, its, played_events(its, steps=3))
    assert not any(isinstance(event, ObservationStored) for event in read_events(log))
    assert [episode.observations for episode in read_log(log).episodes] == [None]
