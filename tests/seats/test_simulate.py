from collections import Counter
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.status import list_problems
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.errors import SimulationError
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import SessionStarted
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.runtime import simulated_session
from minihuman.runtime.simulated_session import simulate
from minihuman.simulation.participant import KeyPress, SimulatedParticipant
from tests.counts import count
from tests.promises.sessions import TOML

pytestmark = pytest.mark.program

PROTOCOLS = Path(__file__).parents[2] / "protocols"
CORRIDOR = decode_protocol(
    TOML.format(episodes=1, steps=9)
    .replace("minihuman/MiniGrid-Empty-5x5-v0", "tests.worlds.corridor:tests/Corridor-v0")
    .replace('"left", "right", "forward"', '"back", "forward"')
    .encode()
)
GRID = decode_protocol(
    (PROTOCOLS / "fourrooms-transfer.toml")
    .read_bytes()
    .replace(b'blocks = ["grid", "first-person"]', b'blocks = ["grid"]')
    .replace(b'blocks = ["first-person"]', b'blocks = ["grid"]')
)


def test_simulated_participants_fill_the_next_slots_and_their_logs_verify(tmp_path):
    logs = [read_log(path) for path in simulate(GRID, tmp_path, participants=2, seed=1, player="human-like")]
    logs += [read_log(path) for path in simulate(GRID, tmp_path, participants=1, seed=1, player="optimal")]
    assert [log.plan.participant.id for log in logs] == ["sub-01", "sub-02", "sub-03"]
    assert [log.player for log in logs] == ["human-like", "human-like", "optimal"]
    assert {log.end_reason for log in logs} == {"complete"}
    assert all(log.clean for log in logs)
    assert [verify_episodes(log).difference for log in logs] == ["", "", ""]


def test_the_same_seed_gives_the_same_log_but_for_the_wall_clock(tmp_path):
    one, two = (
        [
            list(read_events(path))
            for path in simulate(GRID, tmp_path / name, participants=2, seed=9, player="human-like")
        ]
        for name in ("one", "two")
    )
    assert one == two
    assert all(find_violations(events) == [] for events in one)
    assert isinstance(one[0][0], SessionStarted)


@pytest.mark.parametrize(
    ("world", "actions"),
    [
        ("minigrid:MiniGrid-DoorKey-8x8-v0", ["left", "right", "forward", "pickup", "toggle"]),
        ("CartPole-v1", ["0", "1"]),
        ("tests.worlds.corridor:tests/LimitedCorridor-v0", ["back", "forward"]),
    ],
)
def test_a_third_partys_world_is_played_logged_and_verified(tmp_path, world, actions):
    study = decode_protocol(
        f"""
[study]
name = "theirs"
version = "1"
seed = 2
[[groups]]
name = "all"
blocks = ["only"]
[[blocks]]
name = "only"
world = "{world}"
episodes = 2
actions = {actions}
max_steps = 40
""".encode()
    )
    [log] = [read_log(path) for path in simulate(study, tmp_path, participants=1, seed=1, player="random")]
    assert log.end_reason == "complete"
    assert len(log.episodes) == 2
    assert all(len(played.actions) > 0 for played in log.episodes)
    assert verify_episodes(log).difference == ""


def test_an_unknown_player_costs_no_slot(tmp_path):
    with pytest.raises(SimulationError):
        next(simulate(GRID, tmp_path, participants=1, seed=1, player="nobody"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.nightly(sample=True)
def test_the_papers_whole_study_with_key_maps_balanced_as_promised(tmp_path):
    study = read_protocol(PROTOCOLS / "fourrooms-transfer.toml")
    people = count(1, 18)
    logs = [read_log(path) for path in simulate(study, tmp_path, participants=people, seed=3, player="human-like")]
    assert [verify_episodes(log).difference for log in logs] == [""] * people
    assert {log.end_reason for log in logs} == {"complete"}
    assert {len(log.episodes) for log in logs} <= {10, 20}
    for action in range(3):
        keys = Counter(
            next(key for key, name in first.key_map.keys.items() if name == first.actions[action])
            for first in (log.plan.episodes[0] for log in logs)
        )
        assert max(keys.values()) <= -(-people // 9)


def test_a_player_that_cannot_play_a_world_takes_no_slot(tmp_path):
    with pytest.raises(SimulationError, match="has no planner"):
        list(simulate(CORRIDOR, tmp_path, participants=1, seed=1, player="optimal"))
    assert not list(tmp_path.iterdir())


class _FailsLater(SimulatedParticipant):
    """Presses a key once in an episode, then knows no further."""

    def begin(self, plan, pool, world):
        self.key, self.pressed = next(iter(plan.key_map.keys)), 0

    def press(self, world):
        self.pressed += 1
        if self.pressed > 1:
            raise SimulationError("it knows no further")
        return KeyPress(self.key, 100.0)


def test_a_player_that_fails_in_a_session_leaves_it_recorded_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr(simulated_session, "make_participant", lambda name, rng: _FailsLater())
    with pytest.raises(SimulationError, match="knows no further"):
        list(simulate(CORRIDOR, tmp_path, participants=1, seed=1, player="any"))
    (log,) = tmp_path.rglob("*.mcap")
    assert read_log(log).end_reason == "player_failed"
    assert list_problems(log.parents[2]) == ()
