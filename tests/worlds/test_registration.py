"""Worlds are known to Gymnasium whoever imports what first, and minihuman alone does not bring Gymnasium in."""

import subprocess
import sys

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec

KNOWN = "assert 'minihuman/MiniGrid-FourRooms-v0' in gymnasium.registry"
ORDERS = {
    "ours first": f"import minihuman; import gymnasium; {KNOWN}",
    "Gymnasium first": f"import gymnasium; import minihuman; {KNOWN}",
    "a part of Gymnasium first": f"import minihuman; from gymnasium import spaces; import gymnasium; {KNOWN}",
    "by the catalogue": f"import minihuman.worlds.catalogue, gymnasium; {KNOWN}",
    "by the id's module": "import gymnasium; gymnasium.make('minihuman:minihuman/MiniGrid-Empty-5x5-v0')",
}


def python(code: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.program
@pytest.mark.parametrize("code", ORDERS.values(), ids=ORDERS)
def test_gymnasium_knows_our_worlds(code):
    python(code)


@pytest.mark.program
def test_nothing_but_its_worlds_is_to_be_seen_of_that_in_gymnasium():
    python(
        "import sys, minihuman, gymnasium; from importlib.machinery import SourceFileLoader; "
        "assert type(gymnasium.__spec__.loader) is type(gymnasium.__loader__) is SourceFileLoader; "
        "ours = [type(finder).__name__ for finder in sys.meta_path if 'minihuman' in type(finder).__module__]; "
        "assert ours == ['MovedModuleFinder'], ours"  # which finds old names of modules that moved, and nothing else
    )


@pytest.mark.program
@pytest.mark.parametrize("what", ["minihuman", "minihuman.cli", "minihuman.admin.status"])
def test_what_makes_no_world_brings_neither_gymnasium_nor_numpy_nor_pandas(what):
    python(f"import sys, {what}; assert not {{'gymnasium', 'numpy', 'pandas', 'mcap'}} & set(sys.modules)")


@pytest.mark.program
@pytest.mark.parametrize(
    "what", ["minihuman.log.read.session_reader", "minihuman.dataset.store", "minihuman.exporters.tables"]
)
def test_what_only_reads_logs_does_not_bring_gymnasium(what):
    python(f"import sys, {what}; assert 'gymnasium' not in sys.modules")


@pytest.mark.program
@pytest.mark.parametrize("what", ["minihuman.dataset.sessions", "minihuman.figures.gallery"])
def test_what_draws_from_logs_does_not_bring_arrow(what):
    python(f"import sys, {what}; assert 'pyarrow' not in sys.modules")


@pytest.mark.parametrize(
    ("entry_point", "kwargs"),
    [
        ("minihuman.worlds.inside.make:make", {"family": "empty", "size": 5}),
        ("minihuman.worlds.inside.make:make_go_to_obj", {}),
        ("minihuman.worlds.first_person.make:make", {"layout": "layouts.sidewalk:Sidewalk"}),
        ("minihuman.worlds.first_person.make:make", {"layout": "transfer:GoToObj"}),
    ],
)
def test_an_environment_is_recovered_from_the_spec_of_an_older_data_set(entry_point, kwargs):
    spec = EnvSpec("minihuman/Older-v0", entry_point=entry_point, kwargs=kwargs, disable_env_checker=True)
    env = gymnasium.make(EnvSpec.from_json(spec.to_json()))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
