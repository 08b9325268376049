"""Whether a clone is a head start: PPO from its weights against PPO from nothing, by steps to a success rate."""

import copy
from dataclasses import dataclass, replace

from minihuman.learn.agent.network import Policy
from minihuman.learn.agent.policy_file import PolicyCard
from minihuman.learn.agent.training import History, new_ppo, train
from minihuman.learn.agent.training_world import TrainingWorld
from minihuman.learn.transfer.plan import Ppo
from minihuman.worlds.hashing import hash64


@dataclass(frozen=True, slots=True)
class Start:
    """One run of PPO from one start."""

    start: str  # "clone" or "nothing"
    seed: int
    history: History

    def steps_to(self, success: float) -> int | None:
        """Steps until so many of the last 100 episodes succeeded; None where they never did."""
        return next((point.steps for point in self.history.points if point.success >= success), None)


def compare_starts(
    policy: Policy, card: PolicyCard, *, steps: int, runs: int, seed: int, device: str = "auto", ppo: Ppo | None = None
) -> tuple[list[Start], Policy, PolicyCard]:
    """Train from the clone and from nothing, ``runs`` times each, with the same seeds; and the last fine-tuned policy.

    Only the actor and what it sees come from the clone: a clone's critic has learnt nothing.
    """
    starts = []
    tuned = policy
    for run in range(runs):
        for start in ("nothing", "clone"):
            run_seed = hash64((seed, "finetune", run)) % 2**31
            world = TrainingWorld(
                card.world, card.world_options, seed=run_seed, eyesight=card.eyesight, actions=len(card.action_names)
            )
            agent = new_ppo(world, settings=ppo or Ppo(), eyes=card.eyes, seed=run_seed, device=device)
            if start == "clone":
                fresh = copy.deepcopy(agent.policy.state_dict())
                critic = {name: value for name, value in fresh.items() if "value_net" in name}
                agent.policy.load_state_dict(policy.state_dict() | critic)
            starts.append(Start(start, run_seed, train(agent, world, steps=steps)))
            if start == "clone":
                assert isinstance(agent.policy, Policy)
                tuned = agent.policy
    return starts, tuned, replace(card, trained_by="cloning, then ppo", steps=steps, seed=seed)
