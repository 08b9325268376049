"""Validation rules of ``[blocks.team]``: each is a function that yields the errors it finds."""

from collections import Counter
from collections.abc import Iterator
from typing import Protocol

import msgspec

from minihuman.activities.team.plan import PERSON, REPORT_KEY, SEAT_GRAMMAR, SIMULATED, TeamPlan
from minihuman.experiment.keys import BUTTON_NAMES, RESERVED_KEYS

RuleErrors = Iterator[tuple[str, str]]  # a field, and what is wrong with it
_AGENT_KINDS = ("policy", "scripted", SIMULATED)
_LIMITS = (  # of a time: its field, the lowest and the highest number
    ("late_ms", 10, 10_000),
    ("lobby_s", 1, 86_400),
    ("partner_wait_s", 1, 86_400),
    ("thinking_wait_s", 1, 86_400),
)


class TeamBlock(Protocol):
    """The fields of a protocol's block that the rules read."""

    team: TeamPlan | None
    actions: tuple[str, ...]

    @property
    def design(self) -> object:
        """Return the design that resolves each episode."""


_FIELDS_OF_ONE_SEAT = ("max_episode_s", "max_block_s", "stop_criterion", "noop_action")  # not for joint play


def check_block(block: TeamBlock, pool: tuple[str, ...]) -> RuleErrors:
    """Yield the errors of a team block in a protocol, each as a field's name and what is wrong with it.

    Args:
        block: the block, as the protocol has it.
        pool: the keys that may have an action.
    """
    for field, error in check_team(block.team, pool):
        yield f"team.{field}", error
    seat_keys = () if block.team is None else block.team.seat_keys or ()
    for keys in seat_keys:
        if sorted(keys.values()) != sorted(block.actions):
            actions = ", ".join(keys.values())
            yield "team.seat_keys", f"has keys for {actions}; give each seat one for each action"
    for field in _FIELDS_OF_ONE_SEAT:
        if getattr(block, field):
            yield field, "would end or step each seat by its own clock; leave it out of a team block"
    if block.design is not None:
        yield "design", "would decide for each seat by itself; leave it out of a team block"


def check_team(team: TeamPlan | None, pool: tuple[str, ...]) -> RuleErrors:
    """Yield the errors of a team's settings, each as a field's name and what is wrong with it.

    Args:
        team: the settings; None if the protocol has none.
        pool: the keys that may have an action.
    """
    n_seats = len(team.seats) if team else 0
    if team is None or n_seats < 2:
        yield "seats", f"has {n_seats} seats; give one for each body, {SEAT_GRAMMAR}"
        return
    yield from _check_seats(team)
    yield from _check_seat_keys(team, pool)
    yield from _check_roles(team)
    yield from _check_limits(team)
    yield from _check_messages(team, pool)
    yield from _check_disclosure(team)


def _check_seats(team: TeamPlan) -> RuleErrors:
    """Yield an error for each seat of an unknown kind, for a stand-in that is a person, and for no person at all."""
    for seat in (*team.seats, team.stand_in):
        kind, _, name = seat.partition(":")
        is_named_agent = kind in _AGENT_KINDS and bool(name)
        if seat not in (PERSON, "planner") and not is_named_agent:
            yield "seats", f"has {seat!r}; a seat is {SEAT_GRAMMAR}"
    if team.stand_in == PERSON:
        yield "stand_in", "is 'person'; name an agent, such as 'scripted:random'"
    if not team.persons:
        yield "seats", "has no 'person'; a session needs one"


def _check_seat_keys(team: TeamPlan, pool: tuple[str, ...]) -> RuleErrors:
    """Yield the errors of the keys by seat: not one table per seat, a key of several seats, or outside the pool."""
    if not team.seat_keys:
        return
    if len(team.seat_keys) != len(team.seats):
        yield "seat_keys", f"has {len(team.seat_keys)} for {len(team.seats)} seats; give each seat its own"
    n_seats_of_key = Counter(key for keys in team.seat_keys for key in keys)
    for key, n_seats in n_seats_of_key.items():
        if n_seats > 1:
            yield "seat_keys", f"gives {key!r} to {n_seats} seats; a key belongs to one"
    for key in n_seats_of_key:
        if key not in pool:
            yield "seat_keys", f"names {key!r}, which is not in $.keys.pool"


def _check_roles(team: TeamPlan) -> RuleErrors:
    """Yield an error if there are roles, but not one for each seat."""
    if team.roles and len(team.roles) != len(team.seats):
        yield "roles", f"has {len(team.roles)} for {len(team.seats)} seats; give one each, or none"


def _check_limits(team: TeamPlan) -> RuleErrors:
    """Yield an error for each time that is outside its limits; a time that is not given has no error."""
    for name, lowest, highest in _LIMITS:
        number = getattr(team, name)
        if number is msgspec.UNSET:
            continue
        if not lowest <= number <= highest:
            yield name, f"is {number:g}; use {lowest} to {highest}"


def _check_messages(team: TeamPlan, pool: tuple[str, ...]) -> RuleErrors:
    """Yield the errors of chat and marks: no partner to send them to, or a key that is not free."""
    keys: dict[str, str] = {}  # by field, the key that it uses
    if team.chat:
        keys["chat"] = REPORT_KEY
    if team.ping:
        keys["ping"] = team.ping
    has_remote_partners = len(team.persons) > 1 and not team.seat_keys
    if not has_remote_partners:
        for name in keys:
            yield name, "is for two or more people in browsers of their own, without seat_keys"
    for name, key in keys.items():
        if key in (*pool, *RESERVED_KEYS) or key not in BUTTON_NAMES:
            yield name, f"needs the key {key!r}, but that is in $.keys.pool, the session's own, or unknown"
    if team.ping == REPORT_KEY:
        yield "ping", f"is {REPORT_KEY!r}, which reports words; name another key"


def _check_disclosure(team: TeamPlan) -> RuleErrors:
    """Yield an error if an agent can hold a seat, but the protocol does not say when people learn of it."""
    if team.agents and not team.partner_disclosure:
        yield "partner_disclosure", "is missing, but an agent can hold a seat; use 'always' or 'debrief'"
