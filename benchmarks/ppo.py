"""`minihuman learn ppo` beside Stable-Baselines3's PPO and sb3-contrib's RecurrentPPO: steps per CPU-second and curves.

    python -m benchmarks.ppo --worlds DoorKey-5x5 Hallway --steps 300000 --seeds 5 --out analysis/ppo

Each gets the same network, batch, worlds and settings, and trains in a process of its own, in turn. The peers' network
multiplies one-hot codes, as a network of theirs would; `ours, one-hot` does so too, and `sb3, lookup` looks weights up
as ours does. A curve is a line a training and update in `curves.csv`; `python analysis/ppo_curves.py` compares them.
Short: --steps 4096 --seeds 1.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

WORLDS = {
    "DoorKey-5x5": "minihuman/MiniGrid-DoorKey-5x5-v0",
    "Hallway": "minihuman/MiniWorld-Hallway-v0",
    "KeyCorridorS3R1": "minihuman/MiniGrid-KeyCorridorS3R1-v0",
    "GoToLocal": "minihuman/BabyAI-GoToLocal-v0",
}
TRAINERS = ("ours", "ours, one-hot", "ours with memory", "sb3", "sb3, lookup", "sb3 recurrent")
FIELDS = ("world", "trainer", "seed", "steps", "episodes", "return_mean", "success", "cpu_s")


def use_one_hot_codes() -> None:
    """Have networks multiply one-hot codes from here on, as they did before weights were looked up."""
    import torch

    from minihuman.learn.policy import network

    class OneHotEncoder(network.CodeEncoder):
        def forward(self, image: torch.Tensor) -> torch.Tensor:
            if image.dtype == torch.uint8:
                image = image.float().div_(255)
            codes = (image * 255 / self.spread).round_().long()
            hot = [torch.nn.functional.one_hot(codes[:, part], size) for part, size in enumerate(self.sizes)]
            return self.layers(torch.cat([part.flatten(1) for part in hot], dim=1).float())

    network._ENCODERS["codes"] = OneHotEncoder


def train_ours(world: str, steps: int, seed: int, *, memory: bool) -> list[dict[str, Any]]:
    from minihuman.learn.training import train
    from minihuman.learn.training_settings import TrainingJob, TrainingSettings, WorldChoice

    settings = TrainingSettings(
        steps=steps, seed=seed, memory=memory, missions="GoTo" in world, evaluation=0, checkpoint_every=0
    )
    with tempfile.TemporaryDirectory() as folder:
        report = train(TrainingJob((WorldChoice(world),), settings), Path(folder, "policy.pt"))
    names = ("steps", "episodes", "return_mean", "success", "cpu_s")
    return [{name: getattr(point, name) for name in names} for point in report.points]


def train_theirs(world: str, steps: int, seed: int, *, memory: bool) -> list[dict[str, Any]]:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv

    from minihuman.learn.batch_ppo import RECENT
    from minihuman.learn.policy.network import get_policy_settings
    from minihuman.learn.policy.observation import SPREAD, ObservationEncoder, encode_mission, get_image_shape
    from minihuman.learn.training_settings import TrainingSettings

    torch.set_num_threads(1)
    settings, missions, points = TrainingSettings(steps=steps), "GoTo" in world, []
    space = ObservationEncoder(missions).space(gymnasium.make(world).unwrapped)
    eyes = "atari" if get_image_shape(space)[1] > 20 else "codes"
    spread = np.array(SPREAD if eyes == "codes" else (1, 1, 1), np.uint8)

    class Worlds(VecEnv):
        """Our batch as Stable-Baselines3 takes one."""

        def __init__(self) -> None:
            self.batch = gymnasium.make_vec(
                world,
                num_envs=settings.worlds,
                vectorization_mode="vector_entry_point",
                autoreset_mode=AutoresetMode.SAME_STEP,
            )
            self.returns, self.recent, self.episodes = np.zeros(settings.worlds), [], 0
            super().__init__(settings.worlds, space, self.batch.single_action_space)

        def _encode(self, raw: Any) -> dict[str, np.ndarray]:
            image = np.asarray(raw["image"] if isinstance(raw, dict) else raw) * spread
            seen = {"image": np.ascontiguousarray(np.moveaxis(image, -1, -3))}
            if missions:
                texts = raw["mission"]
                seen["mission"] = (
                    encode_mission(texts) if isinstance(texts, str) else np.stack([encode_mission(t) for t in texts])
                )
            return seen

        def reset(self) -> dict[str, np.ndarray]:
            return self._encode(self.batch.reset(seed=seed)[0])

        def step_async(self, actions: np.ndarray) -> None:
            self.actions = actions

        def step_wait(self) -> Any:
            raw, rewards, terminated, truncated, infos = self.batch.step(self.actions)
            over, told = terminated | truncated, [{} for _ in range(self.num_envs)]
            self.returns += rewards
            for i in np.flatnonzero(over):
                told[i]["terminal_observation"] = self._encode(infos["final_obs"][i])
                told[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
                self.recent.append((self.returns[i], bool(terminated[i] and rewards[i] > 0)))
            self.returns[over] = 0
            self.episodes += int(over.sum())
            del self.recent[:-RECENT]
            return self._encode(raw), np.asarray(rewards, np.float32), over, told

        def close(self) -> None:
            self.batch.close()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [None] * self.num_envs

        # abstract in the base class; the peer's trainer calls neither of these two
        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise NotImplementedError

        def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
            raise NotImplementedError

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
            return [False] * self.num_envs

    class Curve(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_start(self) -> None:  # after each update, and before the first rollout
            if self.num_timesteps:
                points.append(point(self.num_timesteps))

    worlds, began = Worlds(), time.process_time()

    def point(done: int) -> dict[str, Any]:
        returns, good = zip(*worlds.recent, strict=True) if worlds.recent else ([float("nan")], [float("nan")])
        measured = {"return_mean": float(np.mean(returns)), "success": float(np.mean(good))}
        return {"steps": done, "episodes": worlds.episodes, **measured, "cpu_s": time.process_time() - began}

    make: Any = PPO
    if memory:
        import sb3_contrib

        make = sb3_contrib.RecurrentPPO
    their_network = get_policy_settings(eyes) | ({"lstm_hidden_size": 64 + 32 * missions} if memory else {})
    trainer = make(
        "MultiInputLstmPolicy" if memory else "MultiInputPolicy",
        worlds,
        learning_rate=lambda left: settings.learning_rate * left,
        n_steps=settings.rollout,
        batch_size=settings.worlds * settings.rollout // settings.minibatches,
        n_epochs=settings.epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip,
        ent_coef=settings.entropy,
        vf_coef=settings.value,
        max_grad_norm=settings.max_gradient_norm,
        policy_kwargs=their_network,
        seed=seed,
        device="cpu",
    )
    trainer.learn(steps, callback=Curve())
    return [*points, point(trainer.num_timesteps)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=["DoorKey-5x5"])
    parser.add_argument("--trainers", nargs="+", choices=TRAINERS, default=list(TRAINERS))
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="the folder of curves.csv, which is added to")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    read = parser.parse_args()
    if read.one:
        world, trainer, seed = read.one
        if trainer in ("ours, one-hot", "sb3", "sb3 recurrent"):
            use_one_hot_codes()
        train = train_ours if trainer.startswith("ours") else train_theirs
        rows = train(WORLDS[world], read.steps, int(seed), memory="memory" in trainer or "recurrent" in trainer)
        writer = csv.DictWriter(sys.stdout, FIELDS)
        writer.writerows({"world": world, "trainer": trainer, "seed": seed} | row for row in rows)
        return
    names = ["torch", "stable-baselines3", "gymnasium", "numpy"]
    names += ["sb3-contrib"] if "sb3 recurrent" in read.trainers else []
    print(", ".join(f"{name} {version(name)}" for name in names) + f"; {read.steps} steps, 16 worlds, one thread")
    print(f"{'world':16}{'trainer':20}{'seed':>5}{'steps/CPU-s':>13}{'CPU-s':>8}{'success':>9}")
    for seed in range(read.first_seed, read.first_seed + read.seeds):
        for world in read.worlds:
            for trainer in read.trainers:  # in turn, so that what else the machine does meets all of them
                command = [sys.executable, "-m", "benchmarks.ppo", "--one", world, trainer, str(seed)]
                ran = subprocess.run(
                    [*command, "--steps", str(read.steps)], check=True, stdout=subprocess.PIPE, text=True
                )
                last = list(csv.DictReader(ran.stdout.splitlines(), FIELDS))[-1]
                cpu_s = float(last["cpu_s"])
                rate = int(last["steps"]) / cpu_s
                print(
                    f"{world:16}{trainer:20}{seed:5}{rate:13.0f}{cpu_s:8.0f}{float(last['success']):9.2f}", flush=True
                )
                if read.out:
                    read.out.mkdir(parents=True, exist_ok=True)
                    curves = read.out / "curves.csv"
                    head = "" if curves.exists() else ",".join(FIELDS) + "\n"
                    with curves.open("a", encoding="utf-8") as file:
                        file.write(head + ran.stdout)


if __name__ == "__main__":
    main()
