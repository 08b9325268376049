"""Who plays with whom and who sits where, by the lobby alone."""

from typing import Any

from minihuman.activities.team.lobby import Lobby, LobbyEntry, RecordedTeam
from minihuman.activities.team.plan import TeamPlan
from minihuman.experiment.plan.session_plan import Participant

KINDS = ("person", "person")


def lobby(n: int = 4, *, teams: dict[int, tuple[str, ...]] | None = None, groups: Any = None, **rules: Any):
    """A lobby with participants 0 to n - 1, the last of whom came first."""
    plan = TeamPlan(seats=KINDS, **rules)
    room: Lobby[str] = Lobby("kitchen", 7, lambda group: list(range(n)))
    for index in reversed(range(n)):
        group = groups[index] if groups else "all"
        participant = Participant(f"sub-{index + 1:02d}", index, group)
        room.enter(LobbyEntry(f"member {index}", participant, plan, (teams or {}).get(index, ()), 0.0, float(index)))
    return room


def partners_of(room: Lobby[str], index: int, present_since_s: float = 0.0) -> list[int] | None:
    entry = room.find(f"member {index}")
    assert entry is not None
    partners = room.match(entry, present_since_s)
    return None if partners is None else [partner.index for partner in partners]


def test_fixed_pairs_are_neighbours_in_the_allocation_list_whoever_came_first():
    room = lobby(pairing="fixed")
    assert [partners_of(room, index) for index in range(4)] == [[0, 1], [0, 1], [2, 3], [2, 3]]


def test_drawn_pairs_are_the_same_in_every_run_and_hold_who_asks():
    pairs = [partners_of(lobby(), index) for index in range(4)]
    assert pairs == [partners_of(lobby(), index) for index in range(4)]
    assert all(index in pair for index, pair in enumerate(pairs) if pair is not None)


def test_the_same_team_plays_on_and_a_round_robin_never_repeats_one():
    teams = {0: ("a",), 1: ("b",), 2: ("a",), 3: ("b",)}
    assert partners_of(lobby(teams=teams, pairing="same"), 0) == [0, 2]
    partners = partners_of(lobby(teams=teams, pairing="round_robin"), 0)
    assert partners in ([0, 1], [0, 3])


def test_who_stopped_asking_and_who_is_in_another_group_is_paired_with_nobody():
    assert partners_of(lobby(2), 1, present_since_s=0.5) is None
    assert partners_of(lobby(2, groups=("north", "south")), 0) is None


def test_a_team_has_the_next_number_and_its_people_all_seats():
    room = lobby(2)
    entries = room.unpaired
    assert [entry.index for entry in entries] == [0, 1]
    seated = room.seat(entries, [RecordedTeam("ab", 0), RecordedTeam("cd", 4)])
    assert seated.index == 5
    assert seated.kinds == KINDS
    assert sorted(seated.members) == [0, 1]
    assert [entry.team for entry in entries] == [None, None]  # until it is recorded
    seated.admit()
    assert room.unpaired == []


def test_partners_of_the_same_team_keep_its_number_and_name():
    room = lobby(2, teams={0: ("x", "ab"), 1: ("ab",)}, pairing="same")
    assert room.seat(room.unpaired, [RecordedTeam("zz", 0), RecordedTeam("ab", 3)]).index == 3


def test_a_seat_that_nobody_came_for_has_the_stand_in():
    room = lobby(1, stand_in="scripted:still")
    seated = room.seat(room.unpaired, [])
    assert sorted(seated.kinds) == ["person", "scripted:still"]
    assert [seated.kinds[seat] for seat in seated.members] == ["person"]
