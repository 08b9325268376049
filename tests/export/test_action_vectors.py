"""Actions that are vectors go into the tables and every export that a learner reads, and lead to the same states."""

import json

import gymnasium
import numpy as np
import pyarrow.parquet as pq
import pytest

from minihuman import export
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from tests.study.test_held_keys import levers_plan

pytestmark = pytest.mark.program


@pytest.mark.parametrize("kind", ["box", "buttons", "choices", "board", "pair"])
def test_a_data_set_of_vectors_steps_its_world_to_what_was_observed(kind, tmp_path, monkeypatch):
    import minari

    protocol = decode_protocol(levers_plan(kind, max_steps=40).protocol_toml)
    (log,) = simulate(protocol, tmp_path / "data", participants=1, seed=4, player="random")
    assert list(find_log_differences(log, World)) == []
    (episode,) = read_log(log).episodes
    assert len({tuple(row) for row in episode.action_vectors.tolist()}) > 2
    study = tmp_path / "data" / "levers"

    export("minari", study, tmp_path / "minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    dataset = minari.load_dataset(next(iter(minari.list_local_datasets())))
    (stored,) = dataset.iterate_episodes()
    env = gymnasium.make("tests.worlds.levers:tests/Levers-v0", kind=kind).unwrapped
    assert dataset.action_space == env.action_space
    actions = [take_row(stored.actions, row) for row in range(len(stored.rewards))]
    seen = [env.reset(seed=0)[0], *(env.step(action)[0] for action in actions)]
    assert np.array_equal(np.array(seen), stored.observations)

    export("lerobot", study, tmp_path / "lerobot")
    (table,) = (pq.read_table(path) for path in (tmp_path / "lerobot").rglob("data/**/*.parquet"))
    assert np.array_equal(np.array(table["action"].to_pylist(), np.float32), np.float32(episode.action_vectors))

    export("csv", study, tmp_path / "csv")
    lines = (tmp_path / "csv" / "steps.csv").read_text().splitlines()
    assert "action_vector" in lines[0]
    assert json.dumps(episode.action_vectors[0].tolist()).split(",")[0] in lines[1]


def take_row(actions, row):
    """One action of what Minari keeps: a dict or tuple of columns where the space is one."""
    if isinstance(actions, dict):
        return {name: take_row(column, row) for name, column in actions.items()}
    if isinstance(actions, tuple):
        return tuple(take_row(column, row) for column in actions)
    return actions[row]
