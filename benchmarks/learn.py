"""How fast an agent trains here, and with upstream's worlds and Stable-Baselines3 as they come, in one run.

    xvfb-run -a python -m benchmarks.learn [--steps 8192] [--threads 1]

Prints, for grid and 3D: steps per CPU-second and per second end to end, per second without the learning and of the
world alone; the ratios; and where an end-to-end step's time goes.
"""

import argparse
import platform
import time
from dataclasses import dataclass

import gymnasium
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.vec_env import DummyVecEnv

from analysis.transfer_study.training import ResumableEnv, TrainingHistory, train_resumably
from benchmarks import upstream_first_person, upstream_grid
from minihuman.learn.policy.file import get_versions
from minihuman.learn.policy.network import EncoderName, get_policy_settings
from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.learn.ppo import PpoSettings, make_ppo

GRID_WORLD, FIRST_PERSON_WORLD = "minihuman/MiniGrid-GoToObj-Transfer-v0", "minihuman/MiniWorld-GoToObj-Transfer-v0"


@dataclass
class Side:
    name: str
    world: ResumableEnv
    eyes: EncoderName
    history: TrainingHistory
    cpu_s: float

    @property
    def rates(self) -> tuple[float, float, float, float]:
        """Steps per CPU-second end to end; per second end to end, without learning, of the world alone."""
        steps, spent = self.history.points[-1].steps, self.history
        return (
            steps / self.cpu_s,
            steps / (spent.world_s + spent.acting_s + spent.learning_s),
            steps / (spent.world_s + spent.acting_s),
            steps / spent.world_s,
        )

    @property
    def shares(self) -> str:
        """What a step's time goes to."""
        spent = self.history
        parts = {"world": spent.world_s, "acting": spent.acting_s, "learning": spent.learning_s}
        whole = sum(parts.values())
        return ", ".join(f"{name} {value / whole:.0%}" for name, value in parts.items())


def as_it_comes(world: ResumableEnv, eyes: EncoderName) -> PPO:
    """The published network in Stable-Baselines3's own policy, optimiser and loops."""
    settings = {name: value for name, value in get_policy_settings(eyes).items() if name != "optimizer_kwargs"}
    return PPO(MultiInputActorCriticPolicy, DummyVecEnv([lambda: world]), policy_kwargs=settings, seed=1, device="cpu")


def measure(name: str, world_id: str, eyes: EncoderName, steps: int) -> Side:
    world = ResumableEnv(world_id, {}, seed=1, eyesight=ObservationEncoder(missions=True))
    if name == "ours":
        agent: PPO = make_ppo(world, settings=PpoSettings(), eyes=eyes, seed=1, device="cpu")
    else:
        agent = as_it_comes(world, eyes)
    world.reset()
    world.step(0)  # compiled before the clock starts
    started_s = time.process_time()
    history = train_resumably(agent, world, steps=steps)
    return Side(name, world, eyes, history, time.process_time() - started_s)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=8192)
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    gymnasium.register(upstream_grid.WORLD_ID, entry_point=upstream_grid.UpstreamGrid)
    gymnasium.register(upstream_first_person.WORLD_ID, entry_point=upstream_first_person.UpstreamFirstPerson)
    print(f"{arguments.steps} steps, {arguments.threads} thread(s), {platform.machine()}, {get_versions()}")
    pairs: tuple[tuple[EncoderName, str, str], ...] = (
        ("grid", GRID_WORLD, upstream_grid.WORLD_ID),
        ("atari", FIRST_PERSON_WORLD, upstream_first_person.WORLD_ID),
    )
    for eyes, ours_id, theirs_id in pairs:
        ours = measure("ours", ours_id, eyes, arguments.steps)
        theirs = measure("upstream", theirs_id, eyes, arguments.steps)
        print(f"\n{'grid' if eyes == 'grid' else '3D'}: steps a  CPU-second     second, without learning, world alone")
        for side in (ours, theirs):
            print(f"{side.name:>14}" + "".join(f"{rate:12.0f}" for rate in side.rates) + f"   {side.shares}")
        ratios = [a / b for a, b in zip(ours.rates, theirs.rates, strict=True)]
        print(f"{'ratio':>14}" + "".join(f"{ratio:12.2f}" for ratio in ratios), flush=True)


if __name__ == "__main__":
    main()
