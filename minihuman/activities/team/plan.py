"""Plans of team blocks: the person or agent in each seat."""

from typing import ClassVar, Literal

import msgspec

from minihuman.activities.play.plan import PlayPlan

PERSON = "person"
SIMULATED = "simulated"  # the kind of a seat in which a simulated participant acts by pressing keys
REPORT_KEY = "f2"  # with chat: reports the latest words of another person
PINGS_PER_WAIT = 3  # the least number of signs of life that an open page sends in `partner_wait_s`
THINKING_WAIT_S = 120.0  # the default of `thinking_wait_s`, unless `partner_wait_s` is longer
SEAT_GRAMMAR = "'person', 'policy:FILE', 'scripted:NAME', 'simulated:NAME' or 'planner'"


class TeamPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of ``[blocks.team]`` in the protocol: the seats of a world with several bodies."""

    seats: tuple[str, ...] = ()  # by body: "person", "policy:FILE", "scripted:NAME", "simulated:NAME" or "planner"
    roles: tuple[str, ...] = ()  # what each seat is called on its screen; none: no word
    pairing: Literal["drawn", "fixed", "same", "round_robin"] = "drawn"  # who plays with whom
    seat_keys: tuple[dict[str, str], ...] | msgspec.UnsetType = msgspec.UNSET  # key -> action, at one machine
    late_ms: float = 100.0  # real_time: how long a tick waits for a seat's input
    lobby_s: float = 300.0  # the longest wait for partners
    partner_wait_s: float = 60.0  # how long a partner may give no sign of life before partner_leaves applies
    partner_leaves: Literal["agent", "end"] = "agent"  # an agent takes the seat, or the block ends
    stand_in: str = "scripted:random"  # the agent that takes a seat
    partner_return: Literal["seat", "watch", "end"] | msgspec.UnsetType = msgspec.UNSET  # unset: "seat", at once
    partner_disclosure: Literal["", "always", "debrief"] = ""  # when people learn which partners are agents
    chat: bool | msgspec.UnsetType = msgspec.UNSET  # people write to each other while they play
    ping: str | msgspec.UnsetType = msgspec.UNSET  # the key that marks the cell in front on all screens
    thinking_wait_s: float | msgspec.UnsetType = msgspec.UNSET  # turns: the longest wait for a partner who is here

    @property
    def persons(self) -> tuple[int, ...]:
        """Return the indices of the seats that people take."""
        return tuple(seat for seat, kind in enumerate(self.seats) if kind == PERSON)

    @property
    def thinking_limit_s(self) -> float:
        """Return the longest wait in seconds for a present person's input, in turns and before an episode."""
        if self.thinking_wait_s is msgspec.UNSET:
            return max(THINKING_WAIT_S, self.partner_wait_s)
        return self.thinking_wait_s

    @property
    def agents(self) -> tuple[str, ...]:
        """Return the names of the agents that may hold a seat, as in the agent registry and the protocol's files."""
        kinds = list(self.seats)
        if len(self.persons) > 1 and self.partner_leaves == "agent":
            kinds.append(self.stand_in)
        return tuple(dict.fromkeys(find_seat_agent(kind) for kind in kinds if kind != PERSON))


def find_seat_agent(kind: str) -> str:
    """Return the name of the agent in a seat of a kind such as "scripted:random", "policy:FILE" or "planner".

    Returns:
        The registered agent with its settings, or the policy file, without the prefix of its kind; the whole kind of a
        simulated participant; "optimal" for a planner without a name.
    """
    seat_kind, _, name = kind.partition(":")
    if seat_kind == SIMULATED:
        return kind
    if seat_kind == "planner" and not name:
        return "optimal"
    return name


class TeamPlayPlan(PlayPlan, frozen=True):
    """The plan of a block that a team plays."""

    host: ClassVar[str] = "minihuman.runtime.team_member:make_team_member"
    team: TeamPlan = TeamPlan()
    seeds: Literal["new", "same", "listed"] = "new"  # of a team's episodes: drawn for it, one for all, or the plan's

    @property
    def sign_interval_s(self) -> float:
        """Return the seconds between two signs of life of a page, a fraction of the time that partners wait for it."""
        return self.team.partner_wait_s / PINGS_PER_WAIT

    @property
    def has_text_entry(self) -> bool:
        """Return whether people can write to each other."""
        return bool(self.team.chat)
