"""The lobby of a block: who waits for partners, whom the pairing puts together, and who sits where. No I/O."""

from bisect import bisect_left
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from minihuman.activities.team.plan import PERSON, TeamPlan
from minihuman.activities.team.requests import Team
from minihuman.experiment.plan.random_streams import draw_permutation, draw_words
from minihuman.experiment.plan.session_plan import Participant

Member = TypeVar("Member", bound=Hashable)


def name_team(seed: int, index: int, *, is_solo: bool) -> str:
    """Draw a team's id: random, and the same where the study is simulated again."""
    word = int(draw_words(1, seed=seed, purpose="solo-team-id" if is_solo else "team-id", index=index)[0])
    return f"{word:016x}"[:8]


@dataclass(slots=True, eq=False)
class LobbyEntry(Generic[Member]):
    """A session in the lobby."""

    member: Member
    participant: Participant
    rules: TeamPlan
    earlier_teams: tuple[str, ...]  # that the session was in, the latest last
    since_s: float
    asked_s: float  # when it asked last: who is gone is not paired
    team: Team | None = None

    @property
    def index(self) -> int:
        """The participant's index."""
        return self.participant.index


@dataclass(frozen=True, slots=True)
class RecordedTeam:
    """A team of several people that was formed before."""

    name: str
    index: int


@dataclass(frozen=True, slots=True)
class SeatedTeam(Generic[Member]):
    """A team that is formed: who sits where."""

    name: str
    index: int
    kinds: tuple[str, ...]  # by seat, "person" or an agent
    entries: dict[int, LobbyEntry[Member]]  # by seat

    @property
    def members(self) -> dict[int, Member]:
        """The members by seat."""
        return {seat: entry.member for seat, entry in self.entries.items()}

    def admit(self) -> None:
        """Tell each entry its team."""
        for seat, entry in self.entries.items():
            entry.team = Team(self.name, self.index, seat, self.kinds)


class Lobby(Generic[Member]):
    """Those who wait for partners in one block.

    Args:
        block: its name.
        seed: the study's.
        list_places: lists the places of the allocation list that a group has, in order.
    """

    def __init__(self, block: str, seed: int, list_places: Callable[[str], list[int]]) -> None:
        self._block = block
        self._seed = seed
        self._list_places = list_places
        self._entries: list[LobbyEntry[Member]] = []

    def find(self, member: Member) -> LobbyEntry[Member] | None:
        """Find a member's entry."""
        return next((entry for entry in self._entries if entry.member == member), None)

    def enter(self, entry: LobbyEntry[Member]) -> None:
        """Let a member in."""
        self._entries.append(entry)

    def leave(self, member: Member) -> None:
        """Let a member out, if it is in."""
        self._entries = [entry for entry in self._entries if entry.member != member]

    @property
    def unpaired(self) -> list[LobbyEntry[Member]]:
        """Those without a team, in the order of their participants."""
        return sorted((entry for entry in self._entries if entry.team is None), key=lambda entry: entry.index)

    def match(self, entry: LobbyEntry[Member], present_since_s: float) -> list[LobbyEntry[Member]] | None:
        """Return who plays with whom: all seats of people filled, the entry among them; None as long as not.

        Args:
            entry: who looks for partners.
            present_since_s: who asked last before then is gone.
        """
        candidates = self._list_candidates(entry, present_since_s)
        n_partners = len(entry.rules.persons) - 1
        if len(candidates) < n_partners:
            return None
        if entry.rules.pairing in ("drawn", "round_robin"):
            candidates = self._shuffle(candidates, entry)
        return sorted([entry, *candidates[:n_partners]], key=lambda partner: partner.index)

    def _list_candidates(self, entry: LobbyEntry[Member], present_since_s: float) -> list[LobbyEntry[Member]]:
        """Return who may play with an entry, in the order in which they came."""
        present = [
            other
            for other in self._entries
            if other is not entry
            and other.team is None
            and other.asked_s >= present_since_s
            and other.participant.group == entry.participant.group
        ]
        return [other for other in present if self._may_pair(entry, other)]

    def _may_pair(self, entry: LobbyEntry[Member], other: LobbyEntry[Member]) -> bool:
        match entry.rules.pairing:
            case "fixed":
                return self._number_pair(other) == self._number_pair(entry)
            case "same" if entry.earlier_teams:
                return other.earlier_teams[-1:] == entry.earlier_teams[-1:]
            case "round_robin":
                return not set(other.earlier_teams) & set(entry.earlier_teams)
        return True

    def _number_pair(self, entry: LobbyEntry[Member]) -> int:
        """Return the number of a participant's fixed team: its rank among its group's places decides it."""
        rank = bisect_left(self._list_places(entry.participant.group), entry.participant.place)
        return rank // len(entry.rules.persons)

    def _shuffle(self, candidates: list[LobbyEntry[Member]], entry: LobbyEntry[Member]) -> list[LobbyEntry[Member]]:
        in_order = sorted(candidates, key=lambda candidate: candidate.index)
        purpose = f"pairing-{len(self._entries)}"
        order = draw_permutation(len(in_order), seed=self._seed, purpose=purpose, index=entry.index)
        return [in_order[place] for place in order]

    def seat(self, partners: Sequence[LobbyEntry[Member]], recorded: Iterable[RecordedTeam]) -> SeatedTeam[Member]:
        """Draw who of the partners sits where; a seat of a person without one has the stand-in.

        Args:
            partners: who plays with whom.
            recorded: the study's teams of several people so far.
        """
        rules = partners[0].rules
        teams = list(recorded)
        index = _find_same_team(partners, teams) if rules.pairing == "same" else None
        if index is None:
            index = 1 + max((team.index for team in teams), default=-1)
        persons = rules.persons
        order = draw_permutation(len(persons), seed=self._seed, purpose=f"seats-{self._block}", index=index)
        entries = {persons[order[place]]: partner for place, partner in enumerate(partners)}
        kinds = tuple(
            rules.stand_in if kind == PERSON and seat not in entries else kind for seat, kind in enumerate(rules.seats)
        )
        return SeatedTeam(name_team(self._seed, index, is_solo=False), index, kinds, entries)


def _find_same_team(partners: Sequence[LobbyEntry[Member]], teams: list[RecordedTeam]) -> int | None:
    """Find the index of the team that all partners were in last."""
    latest = {partner.earlier_teams[-1:] for partner in partners}
    return next((team.index for team in teams if {(team.name,)} == latest), None)
