"""PPO from a clone's weights beside PPO from fresh ones: how many steps each takes to a rate of success.

    python analysis/fine_tuning.py CLONE.pt OUT.pt [--steps 50000] [--runs 1] [--success 0.9] [--seed 1]

Writes the last fine-tuned policy, and a table beside it (OUT.pt.md).
"""

import argparse
import copy
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from minihuman.learn.policy.file import PolicyCard, get_versions, load_policy, save_policy
from minihuman.learn.policy.network import Policy
from minihuman.learn.ppo import PpoSettings, TrainingEnv, make_ppo
from minihuman.worlds.hashing import hash64
from transfer_study.training import LearningCurve, TrainingPoint


@dataclass(frozen=True, slots=True)
class TrainingStart:
    """One run of PPO from one start."""

    start: str  # "clone" or "nothing"
    seed: int
    points: list[TrainingPoint]

    def steps_to(self, success: float) -> int | None:
        """Steps until the success rate of the last 100 episodes reached ``success``; None if it never did."""
        return next((point.steps for point in self.points if point.success >= success), None)


def compare_starts(
    policy: Policy,
    card: PolicyCard,
    *,
    steps: int,
    runs: int,
    seed: int,
) -> tuple[list[TrainingStart], Policy, PolicyCard]:
    """Train from the clone and from nothing, ``runs`` times each, with the same seeds; and the last fine-tuned policy.

    Only the actor and what it sees come from the clone: a clone's critic has learnt nothing.
    """
    starts = []
    tuned = policy
    for run in range(runs):
        for start in ("nothing", "clone"):
            run_seed = hash64((seed, "finetune", run)) % 2**31
            world = TrainingEnv(
                card.world, card.world_options, seed=run_seed, eyesight=card.eyesight, actions=len(card.action_names)
            )
            agent = make_ppo(world, settings=PpoSettings(), eyes=card.eyes, seed=run_seed, device="cpu")
            if start == "clone":
                fresh = copy.deepcopy(agent.policy.state_dict())
                critic = {name: value for name, value in fresh.items() if "value_net" in name}
                agent.policy.load_state_dict(policy.state_dict() | critic)
            agent.learn(steps, callback=(curve := LearningCurve()), log_interval=None)
            starts.append(TrainingStart(start, run_seed, curve.points))
            if start == "clone":
                assert isinstance(agent.policy, Policy)
                tuned = agent.policy
    return starts, tuned, replace(card, trained_by="cloning, then ppo", steps=steps, seed=seed)


def describe(starts: list[TrainingStart], *, steps: int, success: float) -> str:
    """The table in Markdown."""
    lines = [
        f"PPO for {steps:,} steps; steps until {success:g} of the last 100 episodes succeeded:",
        "",
        "| start | seed | steps | success at the end |",
        "| --- | --- | --- | --- |",
    ]
    for run in starts:
        reached = run.steps_to(success)
        at_end = f"{run.points[-1].success:.2f}" if run.points else "-"  # where no episode ended
        lines.append(
            f"| {run.start} | {run.seed} | {'not reached' if reached is None else f'{reached:,}'} | {at_end} |"
        )
    return "\n".join([*lines, "", "Versions: " + ", ".join(f"{k} {v}" for k, v in get_versions().items()), ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clone", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, default=50_000)
    parser.add_argument("--runs", type=int, default=1, help="both from the clone and from nothing")
    parser.add_argument("--success", type=float, default=0.9)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    starts, policy, card = compare_starts(
        *load_policy(asked.clone), steps=asked.steps, runs=asked.runs, seed=asked.seed
    )
    save_policy(policy, card, asked.out)
    text = describe(starts, steps=asked.steps, success=asked.success)
    asked.out.with_name(f"{asked.out.name}.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
