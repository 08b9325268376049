"""Every player of ours keeps what players promise; what a lab may get wrong is named."""

import random

import pytest

from minihuman.errors import SimulationError
from minihuman.simulation.participant import KeyPress, SimulatedParticipant
from minihuman.testing.checks import ContractError
from minihuman.testing.participant_contract import check_participant


@pytest.mark.parametrize("player", ["optimal", "random", "human-like", "human-like:lapse=0.2"])
@pytest.mark.parametrize("world", ["minihuman/MiniGrid-Empty-5x5-v0", "minihuman/MiniWorld-OneRoomS6Fast-v0"])
def test_every_player_keeps_what_players_promise(player, world):
    check_participant(player, world)


class Sleepy(SimulatedParticipant):
    """Presses its first key, now and then; each of the wrong ones changes one thing."""

    def __init__(self, rng):
        self.rng = rng

    def begin(self, plan, pool, world):
        self.keys = pool

    def press(self, world):
        return KeyPress(self.keys[0], float(self.rng.integers(200, 900)))


class Steps(Sleepy):
    def press(self, world):
        world.step(0)
        return super().press(world)


class DrawsFromElsewhere(Sleepy):
    def press(self, world):
        return KeyPress(random.choice(self.keys), 300.0)


class NoSuchKey(Sleepy):
    def press(self, world):
        return KeyPress("banana", 300.0)


class Backwards(Sleepy):
    def press(self, world):
        return KeyPress("1", -5.0)


class HasNoAnswer(Sleepy):
    def press(self, world):
        return None


class Crashes(Sleepy):
    def press(self, world):
        return {}["key"]


def test_a_labs_player_keeps_them():
    check_participant(Sleepy)


@pytest.mark.parametrize(
    ("player", "said"),
    [
        (Steps, "changed the world"),
        (DrawsFromElsewhere, "other keys"),
        (NoSuchKey, "'banana', which no keyboard has"),
        (Backwards, "waits -5.0 ms"),
        (HasNoAnswer, "gave no answer; in a study its session would end as player_failed"),
        (Crashes, r"the player failed \(KeyError at test_player\.py:\d+: 'key'\)"),
        (lambda rng: object(), r"object is not a minihuman\.simulation\.participant\.SimulatedParticipant"),
    ],
)
def test_a_promise_that_is_not_kept_is_named(player, said):
    with pytest.raises(ContractError, match=said):
        check_participant(player)


def test_a_world_that_it_cannot_play_is_said_as_anywhere():
    with pytest.raises(SimulationError):
        check_participant("optimal", "minihuman/MiniGrid-Playground-v0")
