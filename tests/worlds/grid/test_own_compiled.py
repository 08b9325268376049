"""Grid worlds of one's own, translated and compiled: equal to plain Python, and errors that name the author's line."""

import copy
import inspect
import logging
import math
import platform
import struct
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

from minihuman.errors import WorldError
from minihuman.experiment.plan.dry_run import _describe_rules
from minihuman.experiment.protocol.model import BlockSpec
from minihuman.worlds.grid.core.state import NEW, PHASE
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import ball
from minihuman.worlds.grid.own import Bool, Float, Int, IntArray, IntTuple, library, programs
from minihuman.worlds.grid.own.batch import OwnBatch, make_batch
from minihuman.worlds.grid.own.source_names import TranslationError
from minihuman.worlds.grid.own.team_batch import OwnTeamBatch
from minihuman.worlds.team import TeamBatch
from tests.worlds.grid import own_world_examples as examples

RELOCATIONS = 4  # SHT_RELA
R_X86_64_64 = 1  # an address of 64 bits
SINGLE = ("Patrol", "Corridor", "Touch", "Bog", "Garden", "Sokoban", "Errand")


class Faulty(GridWorld):
    """Each action after the first three makes a mistake."""

    numbers = IntArray(4)
    large = Int()

    def __init__(self, divisor=0, **options):
        super().__init__(width=5, height=5, max_steps=50, **options)
        self.divisor = divisor

    def layout(self, grid):
        grid.wall_rect()
        grid.put(ball("red"), 1, 1)
        grid.place_agent()
        self.large = 2**62

    def reward_and_done(self, action, reward, terminated):
        if action == 3:
            self.numbers[action + 1] = 7
        if action == 4:
            self.large = self.large // self.divisor
        if action == 5:
            self.large = self.large * 2
        return reward, terminated


def plain_class(world_class):
    return type("Plain", (world_class,), {"is_translated": False, "__module__": world_class.__module__})


def count_differences(world_class, *, worlds, steps, seed=11):
    """Return how many steps of a compiled batch differ from those of plain worlds."""
    batch = make_batch(world_class, num_envs=worlds)
    assert isinstance(batch, OwnBatch)
    alone = [plain_class(world_class)() for _ in range(worlds)]
    batch.reset(seed=seed)
    for i, world in enumerate(alone):
        world.reset(seed=seed + i)
    over = [False] * worlds
    differences = 0
    generator = np.random.default_rng(seed)
    for _ in range(steps // worlds):
        actions = generator.choice(batch.single_action_space.n, worlds)
        observations, rewards, terminated, truncated, _ = batch.step(actions)
        for i, world in enumerate(alone):
            if over[i]:
                expected, outcome = world.reset()[0], (0.0, False, False)
            else:
                expected, *outcome, _ = world.step(int(actions[i]))
            over[i] = any(outcome[1:])
            same = tuple(outcome) == (rewards[i], terminated[i], truncated[i])
            differences += not (same and all(np.array_equal(observations[k][i], expected[k]) for k in expected))
    assert batch.call("state_hash") == tuple(world.state_hash() for world in alone)
    return differences


def test_a_compiled_batch_and_a_compiled_world_step_as_plain_python_does():
    assert count_differences(examples.Patrol, worlds=4, steps=4000) == 0
    compiled, plain = examples.Patrol(), plain_class(examples.Patrol)()
    for world in (compiled, plain):
        world.reset(seed=5)
    assert compiled._compiled_rules is not None
    for action in np.random.default_rng(2).choice([0, 1, 2, 2], 500).tolist():
        steps = [world.step(action) for world in (compiled, plain)]
        assert steps[0][1:] == steps[1][1:]
        assert np.array_equal(steps[0][0]["image"], steps[1][0]["image"])
        if steps[0][2] or steps[0][3]:
            for world in (compiled, plain):
                world.reset()
    assert compiled.state_hash() == plain.state_hash()


@pytest.mark.parametrize("name", ["Patrol", "Garden"])
def test_a_compiled_world_takes_refuses_and_resumes_as_plain_python_does(name):
    """Each act on the compiled world says the same as on the plain one, errors included."""
    world_class = getattr(examples, name)
    programs.compile_rules(world_class())
    pair = [world_class(), plain_class(world_class)()]
    acts = (0, "reset", 2, np.int64(1), np.array(2), True, 2.0, 9, -1, None, "advance", "copy", 2)
    for number, action in enumerate(acts):
        outcomes = []
        for place, world in enumerate(pair):
            outcome, pair[place] = act(world, action)
            outcomes.append(outcome.replace("Plain", name))
        assert outcomes[0] == outcomes[1], (number, action)
    assert pair[0]._compiled_rules is None  # a copy begins without, and finds them at its reset
    pair[0].reset()
    assert pair[0]._compiled_rules is not None


def act(world, action):
    """What a step, a reset or a copy gives, errors included, and the world with which to go on."""
    try:
        if action == "reset":
            outcome = world.reset(seed=3)
        elif action == "copy":
            world = copy.deepcopy(world)
            outcome = world.observation()
        elif action == "advance":
            outcome = world.advance(1), world.observation()
        else:
            outcome = world.step(action)
    except (WorldError, TypeError) as error:
        outcome = f"{type(error).__name__}: {error}"
    return f"{outcome!r} {world.state_hash() if world._row[PHASE] != NEW else ''}", world


@pytest.mark.nightly
@pytest.mark.parametrize("name", SINGLE)
@pytest.mark.parametrize("worlds", [1, 4, 1024])
def test_every_example_steps_as_plain_python_does(name, worlds):
    assert count_differences(getattr(examples, name), worlds=worlds, steps=100_000) == 0


@pytest.mark.nightly
def test_a_compiled_team_batch_steps_as_one_world_after_the_other_does():
    compiled = examples.Harvest().batch(8)
    plain = TeamBatch(plain_class(examples.Harvest)(), 8)
    assert isinstance(compiled, OwnTeamBatch)
    assert np.array_equal(compiled.reset(3), plain.reset(3))
    for actions in np.random.default_rng(0).integers(0, 7, (2000, 8, 4)):
        for mine, theirs in zip(compiled.step(actions), plain.step(actions), strict=True):
            assert np.array_equal(mine, theirs)


def test_errors_name_the_line_and_the_world_and_leave_the_process_alive():
    batch = make_batch(Faulty, num_envs=3)
    lines, first = inspect.getsourcelines(Faulty)
    cases = (3, IndexError, "numbers[action + 1] ="), (4, ZeroDivisionError, "//"), (5, OverflowError, "* 2")
    for action, error, text in cases:
        line = first + next(i for i, source in enumerate(lines) if text in source)
        batch.reset(seed=0)
        with pytest.raises(error, match=rf"test_own_compiled\.py:{line} \(world 1\)"):
            batch.step([0, action, 0])
        plain = plain_class(Faulty)()
        plain.reset(seed=0)
        with pytest.raises(error):
            plain.step(action)
    mixed = make_batch(Faulty, num_envs=2, options_per_world=[{"divisor": 2}, {"divisor": 4}])
    mixed.reset(seed=0)
    mixed.step([4, 4])
    assert mixed.get_attr("large") == (2**61, 2**60)


class Undeclared(GridWorld):
    def __init__(self, **options):
        super().__init__(width=5, height=5, max_steps=9, **options)

    def layout(self, grid):
        grid.place_agent()

    def reward_and_done(self, action, reward, terminated):
        self.score = action
        return reward, terminated


class UsesSine(Undeclared):
    def reward_and_done(self, action, reward, terminated):
        return math.sin(action), terminated


class UsesDictionary(Undeclared):
    def reward_and_done(self, action, reward, terminated):
        return {1: 1.0}[action], terminated


class CallsItself(Undeclared):
    def count(self, n):
        return 0 if n == 0 else self.count(n - 1)

    def reward_and_done(self, action, reward, terminated):
        return self.count(3), terminated


class OwnObservation(Undeclared):
    def observation(self):
        return super().observation()


def list_relocation_kinds(code):
    """The kinds of the addresses that a loader fills into an ELF object file."""
    (sections_at,) = struct.unpack_from("<Q", code, 0x28)
    section_size, n_sections = struct.unpack_from("<HH", code, 0x3A)
    kinds = set()
    for number in range(n_sections):
        header = sections_at + number * section_size
        (section_kind,) = struct.unpack_from("<I", code, header + 4)
        start, size = struct.unpack_from("<QQ", code, header + 0x18)
        if section_kind == RELOCATIONS:
            kinds |= {struct.unpack_from("<Q", code, at + 8)[0] & 0xFFFFFFFF for at in range(start, start + size, 24)}
    return kinds


@pytest.mark.skipif(platform.machine() != "x86_64" or sys.platform != "linux", reason="the kinds are of ELF on x86-64")
def test_compiled_rules_work_wherever_their_sections_lie_in_memory():
    """With addresses of 32 bits, a process whose memory was taken could not load them: LLVM ended it."""
    make_batch(examples.Patrol, num_envs=2)
    code = library._read_cached(library._name_entry(programs.translate_rules(examples.Patrol()).text))
    assert list_relocation_kinds(code) == {R_X86_64_64}


@pytest.mark.parametrize(
    ("world_class", "reason"),
    [
        (Undeclared, r"test_own_compiled\.py:\d+: an assignment to self\.score .* score = Int\(\)"),
        (UsesSine, r"math\.sin .*same on every machine"),
        (UsesDictionary, r"kind Dict"),
        (CallsItself, r"count, which calls itself,.* write a loop"),
        (OwnObservation, r"OwnObservation has its own observation"),
    ],
)
def test_what_cannot_be_translated_is_named_and_runs_as_plain_python(world_class, reason, caplog):
    with pytest.raises(TranslationError, match=reason):
        programs.translate_rules(world_class())
    with caplog.at_level(logging.WARNING, "minihuman"):
        batch = make_batch(world_class, num_envs=2)
    assert isinstance(batch, gymnasium.vector.SyncVectorEnv)
    assert len(caplog.records) == 1
    assert batch.reset(seed=1)[0]["image"].shape == (2, 7, 7, 3)


def test_check_says_of_each_block_why_its_rules_are_not_compiled():
    block = BlockSpec(name="own", world="lab/Undeclared-v0", episodes=1, actions=("left",), max_steps=9)
    gymnasium.register("lab/Undeclared-v0", entry_point=Undeclared, disable_env_checker=True, order_enforce=False)
    try:
        (line,) = _describe_rules(block)
    finally:
        gymnasium.registry.pop("lab/Undeclared-v0")
    assert line.startswith("block 'own': layout and rules of Undeclared: not compiled, because ")
    assert "declare it in the class: score = Int()" in line


def test_without_numba_worlds_run_as_plain_python_and_say_so_once(monkeypatch, tmp_path, caplog):
    monkeypatch.setenv("MINIHUMAN_WORLDS_CACHE", str(tmp_path))
    monkeypatch.setattr(library, "_LIBRARIES", {})
    monkeypatch.setattr(library, "find_spec", lambda name: None)
    with caplog.at_level(logging.WARNING, "minihuman"):
        batch = make_batch(examples.Touch, num_envs=2)
    assert isinstance(batch, gymnasium.vector.SyncVectorEnv)
    assert "pip install" in caplog.records[0].message


def test_importing_worlds_loads_neither_numba_nor_the_translation():
    code = (
        "import sys, minihuman.worlds, minihuman.worlds.grid.env, minihuman.worlds.grid.team_grid\n"
        "names = ('numba', 'llvmlite', 'minihuman.worlds.grid.own.translation', 'minihuman.worlds.grid.own.compiler')\n"
        "print([name for name in names if name in sys.modules])"
    )
    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert completed.stdout.strip() == "[]"


def test_worlds_of_ours_without_a_batch_are_stepped_in_turn_by_make_vec():
    batch = gymnasium.make_vec("minihuman/MiniGrid-GoToObj-Transfer-v0", 2, "vector_entry_point")
    observations, _ = batch.reset(seed=3)
    alone, _ = gymnasium.make("minihuman/MiniGrid-GoToObj-Transfer-v0").reset(seed=4)
    assert np.array_equal(observations["image"][1], alone["image"])


class Fields(GridWorld):
    observed = ("count", "near", "energy", "place", "grid_of")
    count = Int()
    near = Bool()
    energy = Float()
    place = IntTuple(2)
    grid_of = IntArray(2, 2)

    def __init__(self):
        super().__init__(width=5, height=5, max_steps=9)

    def layout(self, grid):
        grid.place_agent()
        self.energy = 0.5
        self.place = 1, 2

    def reward_and_done(self, action, reward, terminated):
        self.count += 1
        self.grid_of[1, 0] = self.count
        return reward, terminated


def test_declared_fields_are_observed_saved_hashed_and_0_in_a_new_episode():
    world = Fields()
    observation, _ = world.reset(seed=1)
    assert world.observation_space.contains(observation)
    before = world.state_hash()
    saved = world.save()
    observation = world.step(0)[0]
    assert world.observation_space.contains(observation)
    assert (observation["count"], observation["energy"], observation["place"].tolist()) == (1, 0.5, [1, 2])
    assert world.state_hash() != before
    world.restore(saved)
    assert (world.count, world.grid_of.tolist(), world.state_hash()) == (0, [[0, 0], [0, 0]], before)
    world.step(0)
    world.reset()
    assert world.count == 0
    with pytest.raises(TypeError):
        world.count = 0.5
