"""Policies for the baseline sets: a clone of simulated people, and a PPO agent; each a folder of four files.

    python analysis/baseline_policies.py clone OUT [--people 10] [--levels 20] [--quick]
    python analysis/baseline_policies.py ppo OUT [--steps 400000] [--only grid first-person] [--quick]

Neither sees a level of the committed sets: the clone's people play another seed's (those of `baseline_difficulty.py`,
kept in OUT/people), PPO's episodes have seeds of their own. Families that look alike share one file: seven grid worlds,
two where the mission names what to go to, the door and its key (a smaller picture), and two in first person. Only the
second reads the mission. What is there is kept, and PPO resumes after a break: the same command with fewer steps than
were made writes what there is. Needs the extra `learn`.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

from baseline_difficulty import simulate_people
from minihuman.dataset.selection import Selection
from minihuman.learn.behaviour_cloning import CloningSettings, clone_policy, split_by_participant
from minihuman.learn.demonstrations import read_demonstrations
from minihuman.learn.policy.file import PolicyCard, save_policy
from minihuman.learn.policy.network import EncoderName
from minihuman.learn.policy.observation import Observation, ObservationEncoder
from minihuman.learn.ppo import PpoSettings, make_ppo
from minihuman.planning.benchmark import FAMILIES, HANDS, TURNS, Family
from transfer_study.training import ResumableEnv, train_resumably

TRAINING_LIMIT = {"max_steps": 150}  # steps of an episode of PPO
ENTROPY = 0.01  # weight in PPO's loss: rewards are rare
SETTINGS = PpoSettings(batch_size=128, n_epochs=4, learning_rate=5e-4)  # more episodes for the time, fewer passes


@dataclass(frozen=True, slots=True)
class PolicyFile:
    """Families whose pictures are of one size and whose actions are the same, and how a policy sees them."""

    name: str
    kind: str  # of the set
    families: tuple[Family, ...]
    eyesight: ObservationEncoder
    eyes: EncoderName
    actions: int
    share: float  # of PPO's steps

    @property
    def worlds(self) -> list[str]:
        """Their ids."""
        return [f"minihuman/{family.world}" for family in self.families]


def list_policy_files() -> list[PolicyFile]:
    """The four files of a folder."""
    grid = {family.name: family for family in FAMILIES["grid"]}
    go_to, door = (grid.pop("go-to-local"), grid.pop("go-to")), (grid.pop("door-key"),)
    near = ObservationEncoder(missions=False, sight="remembered")
    return [
        PolicyFile("grid", "grid", tuple(grid.values()), near, "near", len(HANDS), 1.0),
        PolicyFile("go-to", "grid", go_to, replace(near, missions=True), "near", len(HANDS), 0.5),
        PolicyFile("door-key", "grid", door, near, "near", len(HANDS), 0.5),
        PolicyFile(
            "first-person",
            "first-person",
            FAMILIES["first-person"],
            replace(near, sight="view"),
            "atari",
            len(TURNS),
            0.25,
        ),
    ]


class AlternatingEnv(ResumableEnv):
    """One world after the other, an episode each."""

    def __init__(self, worlds: list[str], options: dict[str, Any], **settings: Any) -> None:
        super().__init__(worlds[0], options, **settings)
        others = (gymnasium.make(one, disable_env_checker=True, **options).unwrapped for one in worlds[1:])
        self._worlds = [self.world, *others]

    def reset(self, **_: Any) -> tuple[Observation, dict[str, Any]]:
        """Begin the next world's episode."""
        self.world = self._worlds[(self._episode + 1) % len(self._worlds)]
        return super().reset()


def train_clone(file: PolicyFile, people: Path, path: Path, *, most: int) -> str:
    """Clone at most so many episodes of each world that reached the goal; return how well it agrees with others."""
    selection = Selection(outcome=("goal",))
    found = [read_demonstrations(people, world, file.eyesight, selection).first(most) for world in file.worlds]
    names = max((one.action_names for one in found), key=len)
    together = replace(found[0], action_names=names, episodes=tuple(one for its in found for one in its.episodes))
    training, validation = split_by_participant(together, share=0.2, seed=1)
    settings = CloningSettings(batch_size=256, most_epochs=12, patience=3)
    policy, result = clone_policy(training, validation, eyes=file.eyes, settings=settings)
    world, *others = file.worlds
    shape = together.space["image"].shape
    assert shape is not None
    notes = {"demonstrations": len(together.episodes)}
    card = PolicyCard(
        world, found[0].options, names, shape, file.eyesight, file.eyes, "cloning", 0, 1, notes, tuple(others)
    )
    save_policy(policy, card, path)
    return f"{len(together.episodes)} episodes, agreement {result.agreement:.2f}"


def train_agent(file: PolicyFile, steps: int, path: Path, checkpoint: Path) -> str:
    """Train an agent from nothing; return its success over the last 100 episodes."""
    world = AlternatingEnv(file.worlds, TRAINING_LIMIT, seed=1, eyesight=file.eyesight, actions=file.actions)
    agent = make_ppo(world, settings=SETTINGS, eyes=file.eyes, seed=1, device="cpu")
    agent.ent_coef = ENTROPY
    history = train_resumably(agent, world, steps=steps, checkpoint=checkpoint)
    first, *others = file.worlds
    names, done = world.action_names[: file.actions], agent.num_timesteps
    card = PolicyCard(
        first,
        TRAINING_LIMIT,
        names,
        world.image_shape,
        file.eyesight,
        file.eyes,
        "ppo",
        done,
        1,
        {},
        tuple(others),
    )
    save_policy(agent.policy, card, path)
    success = history.points[-1].success if history.points else np.nan
    return f"{done:,} steps, success {success:.2f} at the end"


def main(what: str, out: Path, *, people: int, levels: int, steps: int, most: int, only: list[str]) -> None:
    """Train the files that are not there."""
    torch.set_num_threads(1)
    (out / what).mkdir(parents=True, exist_ok=True)
    for file in list_policy_files():
        path = out / what / f"{file.name}.pt"
        if path.exists() or (only and file.name not in only):
            continue
        if what == "clone":
            logs = simulate_people(file.kind, out, people=people, levels=levels)
            result = train_clone(file, logs, path, most=most)
        else:
            checkpoint = out / f"{what}-{file.name}.checkpoint"
            result = train_agent(file, int(steps * file.share), path, checkpoint)
            checkpoint.unlink()
        print(f"{path}: {result}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("clone", "ppo"))
    parser.add_argument("out", type=Path)
    parser.add_argument("--people", type=int, default=10)
    parser.add_argument("--levels", type=int, default=20, help="of each family, for people")
    parser.add_argument("--steps", type=int, default=400_000, help="of PPO for the seven grid worlds; others get less")
    parser.add_argument("--most", type=int, default=200, help="episodes of each world that the clone learns from")
    parser.add_argument("--only", nargs="*", default=[], help="files by name, so that several run side by side")
    parser.add_argument("--quick", action="store_true", help="tiny, to see that it runs")
    given = parser.parse_args()
    if given.quick:
        given.people, given.levels, given.steps = 2, 1, 4_096
    main(
        given.what,
        given.out,
        people=given.people,
        levels=given.levels,
        steps=given.steps,
        most=given.most,
        only=given.only,
    )
