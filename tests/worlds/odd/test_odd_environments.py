"""Every odd environment is refused in one sentence that names the cause, or plays, is proven and is exported."""

import random
from dataclasses import replace
from pathlib import Path

import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.errors import WorldError
from minihuman.experiment.machine.events import SessionEnded
from minihuman.experiment.replay import is_same_event
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.worlds.odd.contract import build_odd_study, export_everything, hold_to_contract
from tests.worlds.odd.table import ODD

SAMPLE = sorted(random.Random(count(47, 0)).sample(sorted(ODD), count(5, len(ODD))))


@pytest.fixture(autouse=True)
def trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINIHUMAN_TRUST", "tests.worlds.odd.table")


@pytest.mark.filterwarnings("ignore::UserWarning")  # Gymnasium's own, of what is odd
@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("name", SAMPLE)
def test_an_odd_environment_is_refused_in_a_sentence_or_plays_and_is_proven(name: str, tmp_path: Path) -> None:
    hold_to_contract(ODD[name], tmp_path)


def test_there_are_odd_environments_of_every_kind() -> None:
    assert len(ODD) >= 100
    assert {bool(environment.refused) for environment in ODD.values()} == {True, False}


def test_a_reward_that_is_nan_is_proven_and_exported(tmp_path: Path) -> None:
    (log,) = simulate(build_odd_study(ODD["RewardNaN"]), tmp_path, participants=1, seed=1, player="random")
    assert [line for line, right in verify_session(log) if not right] == []
    export_everything(tmp_path / "odd", tmp_path)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("StepRaises", "ValueError: no such cell"),
        ("StepExits", "step() tried to end the program"),
        ("RewardNone", "the reward must be one number and is nothing (None)"),
        ("InfoList", "step() returned a list of 1 values as info"),
    ],
)
def test_a_world_that_fails_in_a_session_ends_it_with_what_was_recorded(name: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"the world failed .*; what was recorded up to then is in") as failed:
        list(simulate(build_odd_study(ODD[name]), tmp_path, participants=1, seed=1, player="random"))
    assert said in str(failed.value)
    log = read_log(tmp_path / "odd" / "sub-01" / "ses-01" / "sub-01_ses-01.mcap")
    assert (log.clean, log.end_reason) == (True, "world_error")
    assert [line for line, right in verify_session(log.path) if not right] == []


@pytest.mark.parametrize("name", ["PictureFloat01", "PictureGrey", "PictureNone", "PictureSigned"])
def test_a_picture_that_would_be_wrong_on_the_screen_is_not_shown(name: str) -> None:
    world = World(ODD[name].id)
    world.reset(0)
    with pytest.raises(WorldError, match=ODD[name].refused):
        world.frame()


def test_what_is_left_of_an_attribute_that_came_later_is_gone_after_a_restore() -> None:
    world = World(ODD["AttributeAppears"].id)
    world.reset(0)
    saved = world.save()
    for _ in range(8):
        world.step(1)
    assert hasattr(world.unwrapped, "bonus")
    world.restore(saved)
    assert not hasattr(world.unwrapped, "bonus")


def test_a_world_that_fails_in_other_words_fails_the_same() -> None:
    failed = SessionEnded(5, "world_error", "TypeError: float() argument must be a string", 0)
    assert is_same_event(failed, replace(failed, detail="the reward must be one number"))
    assert not is_same_event(failed, replace(failed, t_ns=6))
    left = replace(failed, reason="quit")
    assert not is_same_event(left, replace(left, detail="another"))
