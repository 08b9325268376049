"""The actions of Gymnasium's own environments have names; protocols and logs of before go on to use their numbers."""

from contextlib import closing

import gymnasium
import pytest

from minihuman.admin.protocol_file import ProtocolDraft
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.experiment.keys import assign_usual_keys, find_period_ms
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World

CLIFF_WALKING = "CliffWalking-v1" if "CliffWalking-v1" in gymnasium.registry else "CliffWalking-v0"  # before 1.2


@pytest.mark.parametrize(
    ("world_id", "keys", "period_ms"),
    [
        ("FrozenLake-v1", {"left": "left", "down": "down", "right": "right", "up": "up"}, None),
        (CLIFF_WALKING, {"up": "up", "right": "right", "down": "down", "left": "left"}, None),
        ("CartPole-v1", {"left": "left", "right": "right"}, None),
        ("MountainCar-v0", {"left": "left", "right": "right"}, 1000 / 30),
        ("Acrobot-v1", {"left": "left", "right": "right"}, 1000 / 15),
    ],
)
def test_the_classics_are_played_with_the_arrows_in_real_time_where_an_action_does_nothing(world_id, keys, period_ms):
    with closing(World(world_id)) as world:
        assert assign_usual_keys(world) == keys
        assert find_period_ms(world) == pytest.approx(period_ms) if period_ms else find_period_ms(world) is None


def test_a_protocol_of_before_the_names_uses_numbers_and_its_log_too(tmp_path):
    toml = ProtocolDraft(name="one", world="FrozenLake-v1", episodes=1, participants=1).toml()
    numbered = toml
    for number, name in enumerate(("left", "down", "right", "up")):
        numbered = numbered.replace(f'"{name}"', f'"{number}"')
    assert numbered != toml
    for folder, text, names in (
        ("old", numbered, ("0", "1", "2", "3")),
        ("new", toml, ("left", "down", "right", "up")),
    ):
        (path,) = simulate(decode_protocol(text.encode()), tmp_path / folder, participants=1, seed=1, player="random")
        log = read_log(path)
        assert log.episodes[0].start.action_names == names
        assert verify_episodes(log).difference == ""
