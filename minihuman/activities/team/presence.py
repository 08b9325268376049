"""Presence: who holds each person's seat, and when its person showed the last sign of life. No clock, no step, no log.

An agent that stands in for a person holds the seat until the person may take it back; whether they may, and whether the
block goes on without them at all, the protocol says.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from minihuman.activities.team.events import SeatHolder
from minihuman.activities.team.plan import PERSON, TeamPlan


@dataclass(slots=True)
class SeatPresence:
    """What is known of the person of one seat."""

    holder: SeatHolder = "person"  # who acts in it
    last_key_s: float | None = None  # None: neither a key of theirs nor a tick without one has come yet


class TeamPresence:
    """The seats of a team's people.

    Args:
        kinds: by seat, "person" or an agent.
        rules: the protocol's ``[blocks.team]``.
    """

    def __init__(self, kinds: tuple[str, ...], rules: TeamPlan) -> None:
        self._rules = rules
        self._seats = {seat: SeatPresence() for seat, kind in enumerate(kinds) if kind == PERSON}
        self.has_ended = False  # a partner left, and the block ends for it

    @property
    def persons(self) -> frozenset[int]:
        """The seats of people, whoever acts in them now."""
        return frozenset(self._seats)

    @property
    def absent(self) -> frozenset[int]:
        """The seats of people in which the stand-in acts."""
        return frozenset(seat for seat, presence in self._seats.items() if presence.holder == "agent")

    @property
    def present(self) -> frozenset[int]:
        """The seats in which their people act."""
        return self.persons - self.absent

    def may_act(self, seat: int) -> bool:
        """Tell whether a seat is its person's, or theirs to take back.

        Who watches has the seat back if no other person acts.
        """
        match self._rules.partner_return or "seat":
            case "seat":
                return True
            case "watch" if not self.present:
                return True
        return seat not in self.absent

    def is_shut_out(self, seat: int) -> bool:
        """Tell whether the block is over for a seat's person, as an agent has the seat for good."""
        return self._rules.partner_return == "end" and not self.may_act(seat)

    def note_key(self, seat: int, now_s: float) -> None:
        """Take note that the person of a seat acts."""
        self._seats[seat].last_key_s = now_s

    def note_silence(self, seat: int, now_s: float) -> None:
        """Take note of a tick without a key: the first one begins the time that a person may be silent."""
        presence = self._seats[seat]
        if presence.last_key_s is None:
            presence.last_key_s = now_s

    def is_silent(self, seat: int, now_s: float) -> bool:
        """Tell whether a person has pressed no key for as long as partners wait, while another person acts."""
        last_key_s = self._seats[seat].last_key_s
        if not self.present - {seat}:
            return False
        return seat in self.absent or (last_key_s is not None and now_s - last_key_s >= self._rules.partner_wait_s)

    def take_back(self, seat: int) -> None:
        """Give a seat back to its person."""
        self._seats[seat].holder = "person"

    def hand_over(self, seats: Iterable[int]) -> bool:
        """Give seats to the stand-in; False where the block ends instead."""
        if self._rules.partner_leaves == "end":
            self.has_ended = True
            return False
        for seat in seats:
            self._seats[seat].holder = "agent"
        return True

    def restore(self, absent: Iterable[int]) -> None:
        """Go on from where the stand-in had these seats."""
        for seat in absent:
            self._seats[seat].holder = "agent"
