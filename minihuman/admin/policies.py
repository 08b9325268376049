"""The policy files of a study, and the check that an agent's logged advice follows from its policy.

Every file that ever played in a study is kept under its SHA-256 beside the participants' folders. The check recomputes
the advice for every state from the file; that the actions were drawn from the advice is verified without it.
"""

import hashlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from minihuman.agents.agent import BaseAgent, is_registered_agent, make_agent, make_policy_agent
from minihuman.errors import LogError, MinihumanError
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.log.model.teaching_events import NO_ADVICE, TeachingRecord
from minihuman.log.paths import study_folder
from minihuman.log.read.session_reader import list_session_files
from minihuman.storage.durable_files import replace_durably, sync_folder
from minihuman.worlds.adapters.world import World

POLICIES_FOLDER = "policies"
POLICY_SUFFIX = ".pt"


class PolicyStore:
    """The policy files in one study's folder; an existing file is never written again."""

    def __init__(self, study_dir: Path) -> None:
        self.folder = study_dir / POLICIES_FOLDER

    def keep(self, content: bytes) -> str:
        """Store a policy file and return its SHA-256, under which it can be found.

        Raises:
            OSError: if it cannot be written.
        """
        sha256 = hashlib.sha256(content).hexdigest()
        path = self.path(sha256)
        if not path.exists():
            with replace_durably(path, new_folders=1) as file:
                file.write(content)
        else:  # the process that wrote it may have been killed before its name was durable
            sync_folder(self.folder)
            sync_folder(self.folder.parent)
        return sha256

    def path(self, sha256: str) -> Path:
        """Return the path of the file with a SHA-256, whether or not the file exists."""
        return self.folder / f"{sha256}{POLICY_SUFFIX}"

    def checked(self, sha256: str) -> Path:
        """Return the path of the file with a SHA-256 after checking its contents.

        Raises:
            LogError: if the file is missing, or its contents do not match the SHA-256.
        """
        path = self.path(sha256)
        if not path.is_file():
            raise LogError(f"policy {sha256[:16]} is missing from {self.folder}; copy the study's whole folder")
        if hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
            raise LogError(f"{path} was changed: it does not match the digest in its name; restore the original")
        return path


PROBABILITY_TOLERANCE = 1e-5  # of a probability, since processors may sum in different orders


def verify_advice(log: SessionLog, make_world: WorldFactory) -> Iterator[tuple[str, bool]]:
    """Recompute a session's policy advice, up to the first step that differs, and yield lines about it.

    Each line comes with whether it reports success. There are none for a session without advice.

    Raises:
        LogError: if a policy's file is missing from the study's folder, or was changed.
        MinihumanError: if a policy cannot be loaded.
        WorldError: if a world in the log cannot be created here.
    """
    policies = PolicyStore(study_folder(list_session_files(log.path)[0]))
    agents: dict[str, BaseAgent] = {}
    n_states = 0
    largest_deviation = 0.0
    for episode in log.episodes:
        teaching = episode.taught
        if teaching is None or not teaching.policy:
            continue
        policy = teaching.policy
        if policy not in agents:
            agents[policy] = _load_agent(policy, policies)
        with closing(make_world(episode.plan.world, episode.plan.options)) as world:
            for step, deviation in _compute_advice_deviations(episode, teaching, agents[policy], world):
                n_states += 1
                largest_deviation = max(largest_deviation, deviation)
                if deviation > PROBABILITY_TOLERANCE:
                    difference = f"policy {policy[:16]} now says otherwise, by {deviation:.3g} of a probability"
                    yield f"{episode.name} step {step}: {difference}", False
                    return
    if n_states:
        agreement = "equal" if not largest_deviation else f"within {largest_deviation:.1g}"
        yield f"{len(agents)} policies, what they said of {n_states} states: {agreement}", True


def _load_agent(policy: str, policies: PolicyStore) -> BaseAgent:
    """Create an agent.

    Args:
        policy: the name of a registered agent, or the SHA-256 of a policy file.
        policies: the policy files of the study.

    Raises:
        LogError: if the file is missing from the study's folder, or was changed.
        MinihumanError: if no agent can be made from it.
    """
    if is_registered_agent(policy):
        return make_agent(policy)
    return make_policy_agent(policies.checked(policy))


def _compute_advice_deviations(
    episode: EpisodeLog, teaching: TeachingRecord, agent: BaseAgent, world: World
) -> Iterator[tuple[int, float]]:
    """Yield the index of each step with advice, and the largest difference of its recomputed and logged probabilities.

    Nothing is yielded if the policy cannot play in the world and gave no advice.

    Args:
        episode: the episode, whose actions are played again.
        teaching: the logged advice of its steps.
        agent: the agent of the episode's policy.
        world: a world of the episode's id and options.

    Raises:
        MinihumanError: if the policy cannot play in the world although it gave advice.
    """
    world.reset(episode.plan.seed)
    try:
        agent.begin(episode.plan, world)
    except MinihumanError:
        if (teaching.policy_actions != NO_ADVICE).any():
            raise
        return
    for step, action in enumerate(episode.actions):
        probabilities = agent.action_probabilities(world)  # in every state, since an agent may have a memory
        if teaching.policy_actions[step] != NO_ADVICE:
            yield step, float(np.abs(probabilities - teaching.probabilities[step]).max())
        world.step(int(action))
