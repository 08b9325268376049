"""The proof of an agent's part: what its policy says of every state, worked out again from the policy's file.

That the actions were drawn from what it said is proven without it; see ``prove``.
"""

from collections.abc import Iterator
from contextlib import closing

import numpy as np

from minihuman.errors import MinihumanError
from minihuman.lab.policies import Policies
from minihuman.log.paths import study_folder
from minihuman.log.read.open_log import files_of
from minihuman.players.agent import Agent, agent_of_file, is_agent, make_agent
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.recorded.taught import NO_ADVICE, Taught
from minihuman.study.stage import MakeWorld
from minihuman.worlds.adapt.world import World

CLOSE = 1e-5  # of a probability: sums may come in another order on another processor


def advice(log: SessionLog, make_world: MakeWorld) -> Iterator[tuple[str, bool]]:
    """Yield lines on what the policies of a session said, each with whether it is good news.

    Raises:
        LogError: if a policy's file is not in the study's folder, or was changed.
        MinihumanError: if it cannot be loaded.
        WorldError: if a world of the log cannot be made here.
    """
    policies = Policies(study_folder(files_of(log.path)[0]))
    agents: dict[str, Agent] = {}
    states, furthest = 0, 0.0
    for episode in log.episodes:
        taught = episode.taught
        if taught is None or not taught.policy:
            continue
        name = taught.policy
        if name not in agents:
            agents[name] = make_agent(name) if is_agent(name) else agent_of_file(policies.checked(name))
        with closing(make_world(episode.plan.world, episode.plan.options)) as world:
            for step, off in _off(episode, taught, agents[name], world):
                states += 1
                furthest = max(furthest, off)
                if off > CLOSE:
                    where = f"{episode.name} step {step}"
                    yield f"{where}: policy {name[:16]} now says otherwise, by {off:.3g} of a probability", False
                    return
    if states:
        how = "equal" if not furthest else f"within {furthest:.1g}"
        yield f"{len(agents)} policies, what they said of {states} states: {how}", True


def _off(episode: Episode, taught: Taught, agent: Agent, world: World) -> Iterator[tuple[int, float]]:
    """For each state of which the policy said something, by how much a probability is another now."""
    world.reset(episode.plan.seed)
    try:
        agent.begin(episode.plan, world)
    except MinihumanError:
        if (taught.policy_actions != NO_ADVICE).any():
            raise
        return
    for step, action in enumerate(episode.actions):
        said = agent.advise(world)  # also where nothing was said: an agent may remember
        if taught.policy_actions[step] != NO_ADVICE:
            yield step, float(np.abs(said - taught.probabilities[step]).max())
        world.step(int(action))
