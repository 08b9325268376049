"""Plans of blocks: which episodes are played, what is shown around them, when a block ends, and the agent or the team
that plays along.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Literal

import msgspec

from minihuman.experiment.keys import BUTTON_NAMES, RESERVED_KEYS
from minihuman.experiment.plan.designs import DesignSpec


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
        """The points of an episode; none for one that was abandoned or whose agent failed."""
        if outcome in ("abandoned", "agent_failed"):
            return 0.0
        by_outcome = {"goal": self.goal, "timeout": self.timeout, "failure": self.failure}[outcome]
        return by_outcome + self.per_step * steps + self.per_reward * reward


ComputedBy = Literal["page", "server"]


class AxisBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an axis of a gamepad moves."""

    component: int  # of the action's vector, from 0
    scale: float = 1.0  # sensitivity; below 0 the axis is inverted


class SpotBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a click in the world's picture does: an action with its place."""

    x: int  # the component that gets the place from left to right
    y: int  # and from top to bottom
    action: str = ""  # an element that is done with it: "choice_0_6"


class Bindings(msgspec.Struct, frozen=True):
    """What moves an action's vector beside keys. In a plan where a block says so alone."""

    axes: dict[str, AxisBinding] = {}  # of the gamepad
    spot: SpotBinding | None = None


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
    computed: ComputedBy | msgspec.UnsetType = msgspec.UNSET  # who steps and draws first in a browser; unset before
    trial: "TrialRules | msgspec.UnsetType" = msgspec.UNSET  # unset where episodes are no trials
    bindings: Bindings | msgspec.UnsetType = msgspec.UNSET  # unset where keys alone act
    motion_ms: float | msgspec.UnsetType = msgspec.UNSET  # from a step's picture to the next; unset: at once
    design: DesignSpec | msgspec.UnsetType = msgspec.UNSET  # that resolves each episode; unset where none does


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
    own = [(name, getattr(agent, name)) for name in ("hand_back", "good", "bad")]
    waits = [(name, getattr(agent, name)) for name in ("budget_s", "wait_s")]
    updates, choose = agent.update_every, "which {}; choose another"
    checks = [
        (20 <= agent.step_ms <= 60_000, "step_ms", f"is {agent.step_ms:g}; an agent steps every 20 to 60000 ms"),
        (1 <= updates <= 10_000, "update_every", f"is {updates}; use 1 to 10000 episodes"),
        *((0 <= wait_s <= 86_400, name, f"is {wait_s:g}; use 0 to 86400 s") for name, wait_s in waits),
        *((key in BUTTON_NAMES, name, f"is {key!r}, which is not a key") for name, key in own),
        *(
            (key not in RESERVED_KEYS, name, f"is {key!r}, {choose.format('the session itself uses')}")
            for name, key in own
        ),
        *(
            (key not in pool, name, f"is {key!r}, {choose.format('may have an action ($.keys.pool)')}")
            for name, key in own
        ),
    ]
    return [(name, complaint) for is_valid, name, complaint in checks if not is_valid]


PERSON = "person"
SIMULATED = "simulated"  # a seat that a simulated participant has, by the keys that it presses
REPORT_KEY = "f2"  # where people write to each other: reports the latest words of another
SEAT_GRAMMAR = "'person', 'policy:FILE', 'scripted:NAME', 'simulated:NAME' or 'planner'"


class TeamPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[blocks.team]`` in the protocol: who sits where in a world with several bodies."""

    seats: tuple[str, ...] = ()  # by body: "person", "policy:FILE", "scripted:NAME", "simulated:NAME" or "planner"
    roles: tuple[str, ...] = ()  # what each seat is called on its screen; none: no word
    pairing: Literal["drawn", "fixed", "same", "round_robin"] = "drawn"  # who plays with whom
    seat_keys: tuple[dict[str, str], ...] | msgspec.UnsetType = msgspec.UNSET  # key -> action, at one machine
    late_ms: float = 100.0  # real_time: how long a tick waits for a seat's input
    lobby_s: float = 300.0  # the longest wait for partners
    partner_wait_s: float = 60.0  # the longest wait for a partner's input before partner_leaves
    partner_leaves: Literal["agent", "end"] = "agent"  # an agent takes the seat, or the block ends
    stand_in: str = "scripted:random"  # the agent that takes a seat
    partner_return: Literal["seat", "watch", "end"] | msgspec.UnsetType = msgspec.UNSET  # unset: "seat", at once
    partner_disclosure: Literal["", "always", "debrief"] = ""  # when people learn which partners are agents
    chat: bool | msgspec.UnsetType = msgspec.UNSET  # people write to each other while they play
    ping: str | msgspec.UnsetType = msgspec.UNSET  # the key that marks the cell in front on all screens

    @property
    def persons(self) -> tuple[int, ...]:
        """The seats of people."""
        return tuple(seat for seat, kind in enumerate(self.seats) if kind == PERSON)

    @property
    def agents(self) -> tuple[str, ...]:
        """The names of the agents that may hold a seat, as the agent registry and the protocol's files have them."""
        kinds = [*self.seats, *([self.stand_in] if len(self.persons) > 1 and self.partner_leaves == "agent" else [])]
        return tuple(dict.fromkeys(find_seat_agent(kind) for kind in kinds if kind != PERSON))


def find_seat_agent(kind: str) -> str:
    """The agent of a seat: a registered agent with its settings, a policy file's name, or a simulated participant."""
    what, _, name = kind.partition(":")
    if what == SIMULATED:
        return kind
    return "optimal" if what == "planner" and not name else name


class TeamPlayPlan(PlayPlan, frozen=True):
    """A block that a team plays."""

    team: TeamPlan = TeamPlan()
    seeds: Literal["new", "same", "listed"] = "new"  # of a team's episodes: drawn for it, one for all, or the plan's


def check_team(team: TeamPlan | None, pool: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every (field, complaint) about values that make no team; ``pool`` is the keys that may have an action."""
    if team is None or len(team.seats) < 2:
        return [("seats", f"has {len(team.seats) if team else 0} seats; give one for each body, {SEAT_GRAMMAR}")]
    kinds = [(kind, *kind.partition(":")[::2]) for kind in (*team.seats, team.stand_in)]
    agents, keys = ("policy", "scripted", SIMULATED), Counter(key for keys in team.seat_keys or () for key in keys)
    own = [(name, key) for name, key in (("chat", team.chat and REPORT_KEY), ("ping", team.ping)) if key]
    limits = (("late_ms", 10, 10_000), ("lobby_s", 1, 86_400), ("partner_wait_s", 1, 86_400))
    n_seats, taken, may_meet = len(team.seats), (*pool, *RESERVED_KEYS), len(team.persons) > 1 and not team.seat_keys
    checks = [
        *(
            (
                kind not in (PERSON, "planner") and not (what in agents and name),
                "seats",
                f"has {kind!r}; a seat is {SEAT_GRAMMAR}",
            )
            for kind, what, name in kinds
        ),
        (team.stand_in == PERSON, "stand_in", "is 'person'; name an agent, such as 'scripted:random'"),
        (not team.persons, "seats", "has no 'person'; a session needs one"),
        (
            bool(team.seat_keys) and len(team.seat_keys or ()) != n_seats,
            "seat_keys",
            f"has {len(team.seat_keys or ())} for {n_seats} seats; give each seat its own",
        ),
        *(
            (seats > 1, "seat_keys", f"gives {key!r} to {seats} seats; a key belongs to one")
            for key, seats in keys.items()
        ),
        *((key not in pool, "seat_keys", f"names {key!r}, which is not in $.keys.pool") for key in keys),
        (
            bool(team.roles) and len(team.roles) != n_seats,
            "roles",
            f"has {len(team.roles)} for {n_seats} seats; give one each, or none",
        ),
        *(
            (not least <= getattr(team, name) <= most, name, f"is {getattr(team, name):g}; use {least} to {most}")
            for name, least, most in limits
        ),
        *(
            (not may_meet, name, "is for two or more people in browsers of their own, without seat_keys")
            for name, _ in own
        ),
        *(
            (
                key in taken or key not in BUTTON_NAMES,
                name,
                f"needs the key {key!r}, but that is in $.keys.pool, the session's own, or unknown",
            )
            for name, key in own
        ),
        (team.ping == REPORT_KEY, "ping", f"is {REPORT_KEY!r}, which reports words; name another key"),
        (
            bool(team.agents) and not team.partner_disclosure,
            "partner_disclosure",
            "is missing, but an agent can hold a seat; use 'always' or 'debrief'",
        ),
    ]
    return [(name, complaint) for is_wrong, name, complaint in checks if is_wrong]


ReadyPolicy = Literal["each", "first", "none"]


class TrialRules(msgspec.Struct, frozen=True):
    """What makes episodes into trials: they follow each other by the clock. In a plan where a block says so alone."""

    ready: ReadyPolicy = "each"  # which episodes wait for Enter
    feedback_ms: float = 0.0  # the feedback goes by itself; 0: by Enter
    intervals_ms: tuple[float, ...] = ()  # before each episode, where they were drawn


class StimuliSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[blocks.stimuli]`` in the protocol: a table with the options that each trial has for its world."""

    file: str = ""  # CSV beside the protocol, columns by name
    rows: tuple[dict[str, str | int | float | bool], ...] = ()  # or the rows themselves
    order: Literal["shuffled", "fixed"] = "shuffled"
