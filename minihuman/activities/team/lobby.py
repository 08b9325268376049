"""The lobby of a block: the sessions that wait for partners, their pairing, and the drawing of seats. No I/O."""

from bisect import bisect_left
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from minihuman.activities.team.plan import TeamPlan
from minihuman.activities.team.requests import Team
from minihuman.experiment.plan.random_streams import draw_permutation, draw_words
from minihuman.experiment.plan.session_plan import Participant

Member = TypeVar("Member", bound=Hashable)


def name_team(seed: int, index: int, *, is_solo: bool) -> str:
    """Draw a team's id of 8 hexadecimal digits from the study's seed and the team's index.

    A repeated simulation of the study draws the same id. ``is_solo`` says that the team has only one person.
    """
    purpose = "solo-team-id" if is_solo else "team-id"
    word = int(draw_words(1, seed=seed, purpose=purpose, index=index)[0])
    return f"{word:016x}"[:8]


@dataclass(slots=True, eq=False)
class LobbyEntry(Generic[Member]):
    """A session that waits in the lobby."""

    member: Member
    participant: Participant
    rules: TeamPlan
    earlier_teams: tuple[str, ...]  # the session's teams in earlier blocks, the latest last
    since_s: float
    asked_s: float  # the time of its last request; a session that stopped asking is not paired
    team: Team | None = None

    @property
    def index(self) -> int:
        """Return the participant's index in the study."""
        return self.participant.index


@dataclass(frozen=True, slots=True)
class RecordedTeam:
    """A team of several people that was formed earlier in the study."""

    name: str
    index: int


@dataclass(frozen=True, slots=True)
class SeatedTeam(Generic[Member]):
    """A complete team with the session in each seat."""

    name: str
    index: int
    kinds: tuple[str, ...]  # by seat, "person" or an agent
    entries: dict[int, LobbyEntry[Member]]  # by seat

    @property
    def members(self) -> dict[int, Member]:
        """Return the team's members by seat."""
        return {seat: entry.member for seat, entry in self.entries.items()}

    def admit(self) -> None:
        """Assign the team to each of its lobby entries."""
        for seat, entry in self.entries.items():
            entry.team = Team(self.name, self.index, seat, self.kinds)


class Lobby(Generic[Member]):
    """The sessions that wait for partners in one block.

    Args:
        block: the block's name.
        seed: the study's seed.
        list_places: returns a group's places in the allocation list, in order.
    """

    def __init__(self, block: str, seed: int, list_places: Callable[[str], list[int]]) -> None:
        self._block = block
        self._seed = seed
        self._list_places = list_places
        self._entries: list[LobbyEntry[Member]] = []

    def find(self, member: Member) -> LobbyEntry[Member] | None:
        """Return a member's entry; None if the member is not in the lobby."""
        return next((entry for entry in self._entries if entry.member == member), None)

    def enter(self, entry: LobbyEntry[Member]) -> None:
        """Add a member's entry."""
        self._entries.append(entry)

    def leave(self, member: Member) -> None:
        """Remove a member, if it is in the lobby."""
        self._entries = [entry for entry in self._entries if entry.member != member]

    @property
    def unpaired(self) -> list[LobbyEntry[Member]]:
        """Return the entries without a team, in the order of their participants."""
        return sorted((entry for entry in self._entries if entry.team is None), key=lambda entry: entry.index)

    def match(self, entry: LobbyEntry[Member], present_since_s: float) -> list[LobbyEntry[Member]] | None:
        """Return the entries of a complete team, the given entry among them; None if too few partners are present.

        Args:
            entry: the session that looks for partners.
            present_since_s: a session whose last request is earlier than this time is absent.
        """
        candidates = self._list_candidates(entry, present_since_s)
        n_partners = len(entry.rules.persons) - 1
        if len(candidates) < n_partners:
            return None
        if entry.rules.pairing in ("drawn", "round_robin"):
            candidates = self._shuffle(candidates, entry)
        return sorted([entry, *candidates[:n_partners]], key=lambda partner: partner.index)

    def _list_candidates(self, entry: LobbyEntry[Member], present_since_s: float) -> list[LobbyEntry[Member]]:
        """Return the entries that may be paired with an entry, in the order of arrival.

        They have no team, sent a request since ``present_since_s``, and belong to the same group.
        """
        candidates = []
        for candidate in self._entries:
            is_free = candidate is not entry and candidate.team is None
            is_present = candidate.asked_s >= present_since_s
            if not is_free or not is_present or candidate.participant.group != entry.participant.group:
                continue
            if self._may_pair(entry, candidate):
                candidates.append(candidate)
        return candidates

    def _may_pair(self, entry: LobbyEntry[Member], candidate: LobbyEntry[Member]) -> bool:
        """Return whether the block's pairing rule allows two entries in one team."""
        match entry.rules.pairing:
            case "fixed":
                return self._number_pair(candidate) == self._number_pair(entry)
            case "same" if entry.earlier_teams:
                return candidate.earlier_teams[-1:] == entry.earlier_teams[-1:]
            case "round_robin":
                return not set(candidate.earlier_teams) & set(entry.earlier_teams)
        return True

    def _number_pair(self, entry: LobbyEntry[Member]) -> int:
        """Return the number of a participant's fixed team, which follows from their rank among the group's places."""
        rank = bisect_left(self._list_places(entry.participant.group), entry.participant.place)
        return rank // len(entry.rules.persons)

    def _shuffle(self, candidates: list[LobbyEntry[Member]], entry: LobbyEntry[Member]) -> list[LobbyEntry[Member]]:
        """Return candidates in a random order, drawn from the study's seed for the entry that looks for partners."""
        by_index = sorted(candidates, key=lambda candidate: candidate.index)  # arrival must not change the draw
        purpose = f"pairing-{len(self._entries)}"
        order = draw_permutation(len(by_index), seed=self._seed, purpose=purpose, index=entry.index)
        return [by_index[position] for position in order]

    def seat(self, partners: Sequence[LobbyEntry[Member]], recorded: Iterable[RecordedTeam]) -> SeatedTeam[Member]:
        """Draw the partners' seats and return the complete team; the stand-in gets each person's seat left empty.

        Under the pairing "same", partners who were in one team before keep its index and so their seats.

        Args:
            partners: the entries that play together.
            recorded: the study's teams of several people so far.
        """
        rules = partners[0].rules
        teams = list(recorded)
        index = _find_same_team(partners, teams) if rules.pairing == "same" else None
        if index is None:
            index = 1 + max((team.index for team in teams), default=-1)
        persons = rules.persons
        order = draw_permutation(len(persons), seed=self._seed, purpose=f"seats-{self._block}", index=index)
        entries = {persons[order[position]]: partner for position, partner in enumerate(partners)}
        kinds = list(rules.seats)
        for seat in persons:
            if seat not in entries:
                kinds[seat] = rules.stand_in
        return SeatedTeam(name_team(self._seed, index, is_solo=False), index, tuple(kinds), entries)


def _find_same_team(partners: Sequence[LobbyEntry[Member]], teams: list[RecordedTeam]) -> int | None:
    """Return the index of the team in which all partners were last; None if they were not in the same team."""
    last_teams = {partner.earlier_teams[-1:] for partner in partners}
    for team in teams:
        if last_teams == {(team.name,)}:
            return team.index
    return None
