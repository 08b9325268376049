"""Plans of blocks that a team plays: who sits where."""

from collections import Counter
from typing import Literal

import msgspec

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.keys import BUTTON_NAMES, RESERVED_KEYS

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
