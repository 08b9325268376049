"""Worlds in processes of their own: the same as in the session's, and what fails there fails alone."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from inspect import getattr_static
from pathlib import Path

import numpy as np
import pytest

from minihuman.errors import WorldError
from minihuman.experiment.machine.running_episode import WorldFailedError, catch_world_errors
from minihuman.worlds.adapters.foreign_code import WorldCodeError
from minihuman.worlds.adapters.spaces import VectorActions
from minihuman.worlds.adapters.world import World
from minihuman.worlds.isolation.isolated_world import IsolatedWorld, IsolatedWorlds, is_from_catalogue
from minihuman.worlds.isolation.process_pool import WorldLimits
from minihuman.worlds.outcomes import parse_outcome_rule
from tests.counts import PATIENCE_S
from tests.programs import find_descendants, running, wait_until_ended
from tests.worlds import corridor, faulty, odd_ends

FAULTY = f"{faulty.__name__}:tests/Faulty-v0"
CORRIDOR = f"{corridor.__name__}:tests/Corridor-v0"


@pytest.fixture(scope="module")
def worlds() -> Iterator[IsolatedWorlds]:
    with closing(IsolatedWorlds(World)) as made:
        yield made


@pytest.mark.parametrize(
    "world_id", ["CartPole-v1", "Pendulum-v1", "FrozenLake-v1", CORRIDOR, FAULTY, "tests/Corridor-v0"]
)
def test_a_world_in_its_own_process_gives_what_it_gives_in_the_sessions(worlds: IsolatedWorlds, world_id: str) -> None:
    with closing(worlds(world_id, {})) as apart, closing(World(world_id)) as here:
        assert isinstance(apart, IsolatedWorld)
        assert apart.action_names == here.action_names
        assert apart.action_space == here.action_space
        assert apart.reset(3) == here.reset(3)
        assert apart.step_limit == here.step_limit
        for number in range(5):
            action = here.actions.rest if isinstance(here.actions, VectorActions) else number % 2
            other, own = apart.step(action), here.step(action)
            assert (other.reward, other.terminated, other.truncated) == (own.reward, own.terminated, own.truncated)
            assert other.observation_hash == own.observation_hash
            rule = parse_outcome_rule("world")
            assert other.find_success(rule) == own.find_success(rule)
            assert other.encode_info(["coins", "large", "other", "absent"]) == own.encode_info(
                ["coins", "large", "other", "absent"]
            )
            assert (apart.state_hash(), apart.scene_hash()) == (here.state_hash(), here.scene_hash())
            np.testing.assert_array_equal(apart.observation, here.observation)
            assert np.array_equal(apart.frame(size_px=(96, 96)), here.frame(size_px=(96, 96)))
        assert (apart.pose(), apart.map(), apart.subgoals()) == (here.pose(), here.map(), here.subgoals())


def test_a_copy_is_restored_in_its_own_process(worlds: IsolatedWorlds) -> None:
    with closing(worlds(FAULTY, {})) as world:
        world.reset(1)
        saved = world.save()
        before = world.state_hash()
        world.advance(0)
        assert world.state_hash() != before
        world.restore(saved)
        assert world.state_hash() == before


@pytest.mark.parametrize("fault", faulty.ENDING_FAULTS)
def test_a_fault_is_a_sentence_and_ends_no_other_process(fault: str) -> None:
    limits = WorldLimits(step_s=2.0 if fault == "hang" else 60.0)
    with closing(IsolatedWorlds(World, limits)) as worlds, closing(worlds(FAULTY, {"fault": fault})) as world:
        world.reset(1)
        with pytest.raises(WorldError, match=r"Faulty-v0: (step|render)\(\) ") as raised:
            _play_to_fault(world)
        assert "\n" not in str(raised.value)


@pytest.mark.parametrize("fault", ["raise", "exit", "none", "shape"])
def test_a_log_has_the_same_words_wherever_a_world_failed(worlds: IsolatedWorlds, fault: str) -> None:
    said = []
    for make in (World, worlds):
        with closing(make(FAULTY, {"fault": fault})) as world:
            world.reset(1)
            with pytest.raises(WorldFailedError) as raised, catch_world_errors():
                _play_to_fault(world)
            said.append(str(raised.value))
    assert said[0] == said[1]


def _play_to_fault(world: World) -> None:
    for _ in range(faulty.FAULT_STEP):
        world.step(0)
        world.frame()


def test_a_construction_without_end_is_ended() -> None:
    with (
        closing(IsolatedWorlds(World, WorldLimits(construction_s=2.0))) as worlds,
        pytest.raises(WorldCodeError, match="its construction took more than 2 s"),
    ):
        worlds(FAULTY, {"fault": "loop_at_construction"})


def test_a_process_is_used_again_for_its_world_alone() -> None:
    with closing(IsolatedWorlds(World)) as worlds:
        pids = []
        for world_id in (CORRIDOR, CORRIDOR, FAULTY):
            with closing(worlds(world_id, {})) as world:
                assert isinstance(world, IsolatedWorld)
                pids.append(world.pid)
        assert pids[0] == pids[1] != pids[2]
        assert worlds.pool.use.worlds == 3
        assert "3, each with" in str(worlds.pool.use)


def test_an_untrusted_module_is_not_imported_in_any_process(
    worlds: IsolatedWorlds, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stranger.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(WorldError, match="'stranger' is not trusted"):
        worlds("stranger:x/World-v0", {})
    assert not (tmp_path / "ran").exists()


def test_catalogue_worlds_teams_and_worlds_that_pages_compute_stay_where_their_session_is(
    worlds: IsolatedWorlds,
) -> None:
    assert is_from_catalogue("minihuman/MiniGrid-Empty-5x5-v0")
    for world_id in ("minihuman/MiniGrid-Empty-5x5-v0", f"{odd_ends.__name__}:tests/OwnTeam-v0"):
        with closing(worlds(world_id, {})) as world:
            assert type(world) is World


def test_the_proxy_answers_to_all_that_a_world_does() -> None:
    own = {"save", "restore", "render", "name_actions", "is_built_in"}
    for name in vars(World):
        if name.startswith("_") or name in own:
            continue
        assert getattr_static(IsolatedWorld, name) is not getattr_static(World, name), name


_HOST = """
import sys
from minihuman.worlds.adapters.world import World
from minihuman.worlds.isolation.isolated_world import IsolatedWorlds
if __name__ == "__main__":
    world = IsolatedWorlds(World)("CartPole-v1", {})
    print(world.pid, flush=True)
    sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the system ends it at once only there")
def test_a_process_ends_with_a_host_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "host.py"
    script.write_text(_HOST)
    with running([sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as host:
        assert host.stdout is not None
        pid = int(host.stdout.readline())
        processes = {process for process in find_descendants(os.getpid()) if process.pid == pid}
        assert processes
        host.kill()
    assert not wait_until_ended(processes, PATIENCE_S)
