"""Plans of blocks: which episodes are played, what is shown around them, when a block ends, and the agent that plays
along.
"""

from collections.abc import Sequence
from typing import Literal

import msgspec

from minihuman.experiment.keys import KEY_NAMES, RESERVED_KEYS
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart
from minihuman.worlds.catalogue import is_compiled_grid


class CriterionSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Practice goes on until so many of the last episodes reached the goal; a block's ``episodes`` are the most."""

    successes: int
    of: int  # the last so many
    otherwise: Literal["go_on", "end"] = "go_on"  # what follows if it is never met

    def is_met(self, outcomes: Sequence[str]) -> bool:
        """Whether the last outcomes are good enough; fewer than ``of`` may be."""
        return sum(outcome == "goal" for outcome in outcomes[-self.of :]) >= self.successes


class PointsSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an episode is worth."""

    goal: float = 0.0
    timeout: float = 0.0
    failure: float = 0.0
    per_step: float = 0.0
    per_reward: float = 0.0

    def compute(self, outcome: str, steps: int, reward: float) -> float:
        """The points of an episode; none for an abandoned one."""
        if outcome == "abandoned":
            return 0.0
        by_outcome = {"goal": self.goal, "timeout": self.timeout, "failure": self.failure}[outcome]
        return by_outcome + self.per_step * steps + self.per_reward * reward


ComputedBy = Literal["page", "server"]


class PlayPlan(msgspec.Struct, frozen=True):
    """A block: which episodes, and what surrounds them. Empty texts and times of 0 show nothing."""

    block: int  # the place among the session's blocks
    blocks: int  # how many the session has
    first: int  # index of its first episode
    count: int
    title: str = ""
    instruction: tuple[str, ...] = ()  # pages
    feedback: dict[str, str] = {}  # by outcome
    rest: str = ""  # after the block
    rest_s: float = 0.0  # the shortest rest
    interval_ms: float = 0.0  # nothing on the screen before an episode
    fixation_ms: float = 0.0  # then a cross
    hold_ms: float = 0.0  # the last picture stays
    marks: bool = False  # with a mark for its outcome
    max_s: float = 0.0  # an episode's longest playing time; 0: none
    block_max_s: float = 0.0
    until: CriterionSpec | None = None
    points: PointsSpec | None = None
    show_points: bool = False  # the running total is on the screen
    mission: str = ""  # instead of the world's own words
    computed: ComputedBy | msgspec.UnsetType = msgspec.UNSET  # as the protocol says it; see `computed_by`


def computed_by(part: PlannedPart, episode: EpisodePlan) -> ComputedBy:
    """Who steps a block's episodes first and draws them, in a browser: what the protocol says, if it does.

    Otherwise the page, for turn-based play in a built-in grid world.
    """
    said: ComputedBy | msgspec.UnsetType = getattr(part.plan, "computed", msgspec.UNSET)
    if said is not msgspec.UNSET:
        return said
    ordinary = part.kind == "play" and episode.pace == "on_key"
    return "page" if ordinary and is_compiled_grid(episode.world, episode.options) else "server"


LATEST_POLICY = "latest"  # the policy that an earlier part of the session ended with


class AgentPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[blocks.agent]`` in the protocol."""

    policy: str = ""  # a policy file beside the protocol, an agent that is registered, LATEST; "": none yet
    step_ms: float = 600.0  # from the picture of one step to the next step
    acts: Literal["drawn", "likeliest"] = "drawn"  # which of the policy's actions is done
    learner: str = ""  # registered in minihuman.learners, settings behind a colon; "": nothing is learnt
    update_every: int = 1  # episodes
    budget_s: float = 60.0  # after which a learner is given up
    wait_s: float = 10.0  # how long the next episode waits for it at most
    hand_back: str = "space"  # takeover: the key by which the person gives the agent its control back
    good: str = "j"  # rating
    bad: str = "f"


class AgentPlayPlan(PlayPlan, frozen=True):
    """A block that an agent plays."""

    agent: AgentPlan = AgentPlan()


def check_agent(agent: AgentPlan, pool: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every (field, complaint) about values that make no agent; ``pool`` is the keys that may have an action."""
    found = []
    if not 20 <= agent.step_ms <= 60_000:
        found.append(("step_ms", f"is {agent.step_ms:g}; an agent steps every 20 to 60000 ms"))
    if not 1 <= agent.update_every <= 10_000:
        found.append(("update_every", f"is {agent.update_every}; use 1 to 10000 episodes"))
    for name in ("budget_s", "wait_s"):
        if not 0 <= getattr(agent, name) <= 86_400:
            found.append((name, f"is {getattr(agent, name):g}; use 0 to 86400 s"))
    for name in ("hand_back", "good", "bad"):
        key = getattr(agent, name)
        if key not in KEY_NAMES:
            found.append((name, f"is {key!r}, which is not a key"))
        elif key in RESERVED_KEYS or key in pool:
            whose = "the session itself uses" if key in RESERVED_KEYS else "may have an action ($.keys.pool)"
            found.append((name, f"is {key!r}, which {whose}; choose another"))
    return found
