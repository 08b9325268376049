"""Do once whatever worlds, batches, wrappers, planners and players do; every kernel must be in the library."""

import inspect
import os
import random
import sys
import warnings
from contextlib import suppress
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium

from minihuman.admin.protocol_file import find_shipped_protocol, read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.dataset.measures import layout_path_bounds, world_options_json
from minihuman.errors import WorldError
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import WORLDS
from minihuman.worlds.grid import wrappers
from minihuman.worlds.grid.babyai.exploring_expert import Explorer
from minihuman.worlds.kernels import KERNELS

STEPS = 40


def play(world_id: str, **options: object) -> None:
    """Everything that a session does with a world, and what its study asks afterwards."""
    world, chance = World(world_id, options), random.Random(0)
    for seed in range(3):
        world.reset(seed)
        with suppress(WorldError):  # some would take too long to tell
            world.way(), world.bounds()
        for _ in range(STEPS):
            made = world.step(chance.randrange(len(world.action_names)))
            world.state_hash(), world.scene_hash(), world.pose(), world.map(), world.clauses()
            if made.terminated or made.truncated:
                break
        world.restore(world.save())
        for view, palette, size_px in product(("partial", "full"), ("classic", "colour-safe"), ((640, 480), (81, 64))):
            world.frame(view, size_px, palette)
    world.close()


def every_kind() -> list[str]:
    """An id of each family, level and 3D world."""
    found: dict[str, str] = {}
    for entry in WORLDS:
        found.setdefault(str(entry.kwargs.get("family", entry.kwargs.get("layout", entry.id))), entry.id)
    return list(found.values())


def batches() -> None:
    """Batches, in each way of beginning anew."""
    for name, mode in product(("MiniGrid-DoorKey-5x5", "BabyAI-GoTo", "MiniWorld-OneRoom"), ("NextStep", "SameStep")):
        batch = gymnasium.make_vec(f"minihuman/{name}-v0", num_envs=2, autoreset_mode=mode)
        batch.reset(seed=0)
        for _ in range(STEPS):
            batch.step(batch.action_space.sample())
        batch.close()


def wrapped() -> None:
    """What other views of a grid and of a room compute."""
    for wrap in (
        wrappers.PictureObservation,
        wrappers.OneHot,
        wrappers.FullyObserved,
        wrappers.Symbolic,
        wrappers.ViewSize,
    ):
        env = wrap(gymnasium.make("minihuman/MiniGrid-DoorKey-5x5-v0"))
        env.reset(seed=0)
        env.step(0)
    env = gymnasium.make("minihuman/MiniWorld-FourRooms-v0", domain_rand=True, view="top", render_mode="rgb_array")
    env.reset(seed=0)
    env.step(0)
    env.render(), env.unwrapped.depth(), env.unwrapped.visible_entities()
    env = gymnasium.make("minihuman/BabyAI-BossLevel-v1").unwrapped
    for seed in range(3):
        env.reset(seed=seed)
        explorer = Explorer(env.state, env.image_shape[0])
        for _ in range(STEPS):
            if not (way := explorer.way(env.state)) or any(env.advance(way[0])[1:]):
                break


def studies() -> None:
    """The studies that come with the package, simulated, proved and measured."""
    with TemporaryDirectory() as data:
        for name in ("demo", "fourrooms-transfer", "instructions"):
            protocol = read_protocol(find_shipped_protocol(name))
            check_worlds(protocol)
            for log in simulate(protocol, Path(data), participants=1, seed=0, player="human-like"):
                read = read_log(log)
                assert not verify_episodes(read).difference
                for episode in read.episodes:
                    layout_path_bounds(episode.plan.world, world_options_json(episode.plan), episode.plan.seed)


def main() -> None:
    """Do it all."""
    warnings.simplefilter("ignore", DeprecationWarning)  # Gymnasium's, of every -v0 that has a -v1
    for world_id in every_kind():
        play(world_id)
    for size in (5, 9):
        play("minihuman/MiniGrid-Empty-5x5-v0", agent_view_size=size, see_through_walls=True)
    for name in ("Empty-5x5", "DoorKey-8x8", "ObstructedMaze-2Dlhb", "FourRooms"):
        play(f"minihuman/MiniGrid-{name}-v0", view="first_person")
    batches()
    wrapped()
    studies()
    late = [name for name, (found, _) in KERNELS.items() if not inspect.isbuiltin(found)]
    assert KERNELS, "the worlds have kernels"
    assert not late, f"in no library: {late}"
    assert not {"numba", "llvmlite"} & sys.modules.keys()


if __name__ == "__main__":
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    main()
