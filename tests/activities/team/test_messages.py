"""What people of a team write and mark: who sees it, which log holds it, and what is left when its author withdraws."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from click.testing import CliRunner

from minihuman.activities.team.message_events import MessageEdited, MessageShown
from minihuman.activities.team.messages import MESSAGE_LETTERS
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.api import export
from minihuman.cli.command_line import make_command_line
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.machine.inputs import MESSAGE_RULES, TextEdited, TextInput
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.replay import compare_replay
from minihuman.runtime.team_host import TeamTable
from minihuman.worlds.adapters.world import World
from tests.activities.team.machines import Clock, Seat, sit_down
from tests.activities.team.study import FOUR_ROOMS, PEOPLE, team_study
from tests.activities.team.test_partners import proven
from tests.activities.team.test_return import step

TALK = f'{PEOPLE}\nchat = true\nping = "m"'
SECRET = "onions first, Zebrafink"


def talking(folder: Path, **more: Any) -> tuple[list[Seat], Clock, TeamTable]:
    """Two people in an episode whose messages keys edit, in the order of their seats."""
    return begin_talk(folder, MappingProxyType({}), **more)


def talking_in_fields(folder: Path, **more: Any) -> tuple[list[Seat], Clock, TeamTable]:
    """The same with messages that a field of the window edits."""
    return begin_talk(folder, {"message_rules": MESSAGE_RULES}, **more)


def begin_talk(folder: Path, facts: Mapping[str, str], **more: Any) -> tuple[list[Seat], Clock, TeamTable]:
    seats, clock, table = sit_down(talk_study(folder, **more), folder, facts=facts)
    seats[0].to_play(seats[1])
    for seat in seats:
        if seat.part._messages.draft is not None:  # an Enter that came with the episode's start
            seat.press("enter")
    return sorted(seats, key=lambda seat: seat.part.formed.seat), clock, table


def talk_study(folder: Path, team: str = TALK, view: str = "full") -> Path:
    return team_study(folder, team=team, world=FOUR_ROOMS, episodes=1, max_steps=3, block=f'view = "{view}"')


def write(seat: Seat, text: str, *, sends: bool = True) -> None:
    seat.press("enter")
    seat.take(TextInput(seat._now_ns, text))
    seat.press(*["enter"] * sends)


def write_in_field(seat: Seat, text: str, *changes: str) -> None:
    """Open a field, and let its whole text settle."""
    seat.press("enter")
    name = entry(seat).name
    seat.take(TextEdited(seat._now_ns, text, changes, len(text), seat._now_ns - 5, name))  # type: ignore[arg-type]


def entry(seat: Seat) -> Any:
    return seat.machine.screen.page_fields["messages"]["entry"]


def lines(seat: Seat) -> list[tuple[str, str]]:
    return seat.machine.screen.page_fields["messages"]["lines"]


def end(*seats: Seat) -> None:
    """Play to the end, and write both logs."""
    for _ in range(3):
        step(*seats, action="left")
    for seat in seats:
        seat.wait(600)
        seat.press("enter", "enter", "enter")
        seat.stop("connection_lost")
        seat.save()


def test_words_reach_the_other_screen_and_stay_in_their_authors_log_alone(tmp_path: Path) -> None:
    (one, two), _, _ = talking(tmp_path)
    write(one, SECRET)
    two.wait(1)
    assert lines(one) == [("You", SECRET)]
    assert lines(two) == [("Person 1", SECRET)]
    two.wait(3000)
    write(two, "yes")
    one.wait(3000)
    assert lines(one) == [("You", SECRET), ("Person 2", "yes")]
    assert [[event.text for event in seat.of(MessageShown)] for seat in (one, two)] == [[SECRET, ""], ["", "yes"]]
    digests = [[event.digest for event in seat.of(MessageShown)] for seat in (one, two)]
    assert digests[0] == digests[1]
    end(one, two)
    assert proven(one, two)
    assert [good for _, good in verify_teams(tmp_path / "duet")] == [True]
    withdraw_participant(tmp_path / "duet", one.plan.participant.id, seal=None)
    assert [("withdrawn" in line, good) for line, good in verify_teams(tmp_path / "duet")] == [
        (True, True),
        (False, True),
    ]
    assert list(compare_replay(two.events, World)) == []
    held = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert SECRET.encode() not in held
    assert SECRET not in repr(two.events)


def test_the_same_words_have_another_digest_each_time_and_in_each_session(tmp_path: Path) -> None:
    digests = set()
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (one, _), _, _ = talking(tmp_path / name)
        for _ in range(2):
            write(one, "yes")
            one.wait(3000)
        digests |= {event.digest for event in one.of(MessageShown)}
    assert len(digests) == 4


def test_words_that_nobody_wrote_are_not_believed(tmp_path: Path) -> None:
    (one, two), _, _ = talking(tmp_path)
    write(one, SECRET)
    two.wait(1)
    two.events = [replace(event, digest="0" * 32) if isinstance(event, MessageShown) else event for event in two.events]
    end(one, two)
    (line, good), *_ = verify_teams(tmp_path / "duet")
    assert not good
    assert line.endswith("episode 1: seat 1 was shown a message that seat 0 did not send")


def test_a_text_that_was_changed_in_its_authors_log_contradicts_what_was_typed(tmp_path: Path) -> None:
    (one, _), _, _ = talking(tmp_path)
    write(one, SECRET)
    assert list(compare_replay(one.events, World)) == []
    forged = [replace(event, text="no") if isinstance(event, MessageShown) else event for event in one.events]
    assert list(compare_replay(forged, World)) != []


def test_after_a_kill_words_stand_on_both_screens_again_and_in_each_log_once(tmp_path: Path) -> None:
    (one, two), clock, _ = talking(tmp_path)
    write(one, SECRET)
    two.wait(1)
    table = TeamTable(read_protocol(tmp_path / "duet.toml"), tmp_path, clock)
    for seat in (two, one):
        seat.resume(table)
    assert lines(two) == [("Person 1", "…")]
    one.wait(1)
    two.wait(1)
    assert lines(two) == [("Person 1", SECRET)]
    assert [len(seat.of(MessageShown)) for seat in (one, two)] == [1, 1]
    end(one, two)
    assert proven(one, two)


def test_a_message_has_a_bound_and_a_second_one_waits_in_its_line(tmp_path: Path) -> None:
    (one, _), _, _ = talking(tmp_path)
    write(one, "x" * 3 * MESSAGE_LETTERS)
    write(one, "again")
    assert [event.text for event in one.of(MessageShown)] == ["x" * MESSAGE_LETTERS]
    assert one.machine.screen.page_fields["messages"]["entry"].text == "again"
    one.wait(2000)
    one.press("enter")
    assert one.of(MessageShown)[-1].text == "again"
    assert one.machine.screen.page_fields["messages"]["entry"] is None
    write(one, "   ")
    assert len(one.of(MessageShown)) == 2
    assert list(compare_replay(one.events, World)) == []


def test_a_message_in_a_field_is_logged_and_sent_code_point_for_code_point(tmp_path: Path) -> None:
    (one, two), _, _ = talking_in_fields(tmp_path)
    text = " \u0645\u06cc\u200c\u062e\u00a0? "
    write_in_field(one, text, "pasted", "composed")
    assert entry(one).native
    one.press("enter")
    two.wait(1)
    assert lines(one) == [("You", text)]
    assert lines(two) == [("Person 1", text)]
    [edited] = one.of(MessageEdited)
    assert (edited.text, edited.changes, edited.keys, edited.waited_ns) == (text, ("pasted", "composed"), len(text), 5)
    end(one, two)
    assert proven(one, two)
    assert [good for _, good in verify_teams(tmp_path / "duet")] == [True]
    assert text not in repr(two.events)


def test_a_field_takes_no_keys_and_no_letters_from_elsewhere(tmp_path: Path) -> None:
    (one, _), _, _ = talking_in_fields(tmp_path)
    write_in_field(one, "look")
    one.press("1", "backspace", "left")
    one.take(TextInput(one._now_ns, "x"))
    assert entry(one).text == "look"
    assert one.joint == []
    assert list(compare_replay(one.events, World)) == []


def test_a_message_that_is_too_long_or_too_soon_stays_in_its_field(tmp_path: Path) -> None:
    (one, _), _, _ = talking_in_fields(tmp_path)
    long = "x" * (MESSAGE_LETTERS + 1)
    write_in_field(one, long)
    assert str(MESSAGE_LETTERS) in entry(one).limit_note
    one.press("enter")
    assert one.of(MessageShown) == []
    assert entry(one).text == long
    one.take(TextEdited(one._now_ns, "short"))
    one.press("enter")
    write_in_field(one, "again")
    one.press("enter")
    assert entry(one).text == "again"
    one.wait(2000)
    one.press("enter")
    assert [event.text for event in one.of(MessageShown)] == ["short", "again"]
    assert list(compare_replay(one.events, World)) == []


def test_what_settles_after_its_message_was_sent_is_in_no_later_message(tmp_path: Path) -> None:
    (one, _), _, _ = talking_in_fields(tmp_path)
    write_in_field(one, "first")
    name = entry(one).name
    one.press("enter", "enter")
    assert entry(one).name != name
    one.take(TextEdited(one._now_ns, "first, late", ("typed",), 6, 0, name))
    assert entry(one).text == ""
    assert [event.text for event in one.of(MessageEdited)] == ["first"]


def test_after_a_kill_a_half_written_message_stands_in_its_field(tmp_path: Path) -> None:
    (one, _), clock, _ = talking_in_fields(tmp_path)
    write_in_field(one, "half")
    one.resume(TeamTable(read_protocol(tmp_path / "duet.toml"), tmp_path, clock))
    assert (entry(one).text, entry(one).native) == ("half", True)


def test_what_is_typed_moves_no_body(tmp_path: Path) -> None:
    (one, two), _, _ = talking(tmp_path)
    write(one, "", sends=False)
    one.press("1", "2", "backspace")
    two.press("1")
    assert one.joint == []
    one.press("enter", "1")
    assert len(one.joint) == 1
    assert list(compare_replay(one.events, World)) == []


def test_the_latest_words_of_another_are_reported(tmp_path: Path) -> None:
    (one, two), _, _ = talking(tmp_path)
    two.press("f2")
    write(one, SECRET)
    two.wait(1)
    two.press("f2")
    [note] = [event for event in two.of(Noted) if event.kind == "report"]
    assert note.text == f"message {one.of(MessageShown)[0].digest} of seat 0"
    assert lines(two) == [("Person 1", f"{SECRET} (reported)")]
    assert list(compare_replay(two.events, World)) == []


def test_a_mark_is_on_the_cell_in_front_on_both_screens_for_two_seconds(tmp_path: Path) -> None:
    (one, two), _, _ = talking(tmp_path)
    one.press("m")
    two.wait(1)
    pose = one.machine.play.world.pose()
    [cell] = {event.cell for seat in (one, two) for event in seat.of(MessageShown)}
    assert abs(cell[0] - pose.x) + abs(cell[1] - pose.z) == 1
    assert one.machine.screen.page_fields["messages"]["cells"] == [(*cell, True)]
    assert two.machine.screen.page_fields["messages"]["cells"] == [(*cell, False)]
    assert two.machine.screen.page_fields["messages"]["bounds"] == two.machine.play.world.map().bounds
    for seat in (one, two):
        assert seat.machine.next_tick_ns <= seat.of(MessageShown)[0].t_ns + 2_000_000_000
        seat.wait(1990)
        assert len(seat.machine.screen.page_fields["messages"]["cells"]) == 1
        seat.wait(20)
        assert seat.machine.screen.page_fields["messages"]["cells"] == []
    end(one, two)
    assert proven(one, two)
    assert [good for _, good in verify_teams(tmp_path / "duet")] == [True]


def test_a_mark_that_comes_too_late_is_not_shown(tmp_path: Path) -> None:
    (one, two), clock, _ = talking(tmp_path)
    two.is_connected = False
    one.press("m")
    write(one, "look")
    clock.s += 3
    one.wait(3000)
    one.press("enter")
    two.is_connected = True
    two.wait(3000)
    assert [event.cell for event in two.of(MessageShown)] == [()]


def test_marks_of_two_people_on_one_cell_are_two_messages(tmp_path: Path) -> None:
    seats, _, _ = talking(tmp_path, team=f'{PEOPLE}\nping = "m"')
    for seat in seats:
        seat.part._messages._send(seat.machine.play, "", (3, 4))
    for seat in (*seats, *seats):
        seat.wait(1)
    assert [len(seat.part._messages.marks) for seat in seats] == [2, 2]


def test_no_export_holds_what_was_written(tmp_path: Path) -> None:
    seats, _, _ = talking(tmp_path)
    for seat in seats:
        write(seat, SECRET)
    end(*seats)
    for kind in ("csv", "parquet", "pettingzoo", "bids"):
        words = ["export", kind, str(tmp_path / "duet"), str(tmp_path / kind)]
        exported = CliRunner().invoke(make_command_line(), words)
        assert exported.exit_code == 0, exported.output
        files = [path for path in (tmp_path / kind).rglob("*") if path.is_file()]
        assert files
        assert not [path for path in files if SECRET.encode() in path.read_bytes()]


@pytest.mark.parametrize(
    ("team", "view", "complaint"),
    [
        (
            TALK.replace('"m"', '"1"'),
            "full",
            "needs the key '1', but that is in $.keys.pool, the session's own, or unknown",
        ),
        (TALK.replace('"m"', '"enter"'), "full", "needs the key 'enter'"),
        (TALK.replace('"m"', '"f2"'), "full", "is 'f2', which reports words"),
        (
            'seats = ["person", "scripted:random"]\npartner_disclosure = "always"\nchat = true',
            "full",
            "is for two or more people in browsers of their own, without seat_keys",
        ),
    ],
)
def test_where_nobody_could_answer_or_no_key_is_free_a_protocol_is_refused(
    tmp_path: Path, team: str, view: str, complaint: str
) -> None:
    with pytest.raises(ProtocolError) as refused:
        read_protocol(talk_study(tmp_path, team, view))
    assert complaint in str(refused.value)


@pytest.mark.parametrize(("world", "view"), [(FOUR_ROOMS, "partial"), ("minihuman/Team-FourRooms3D-v0", "full")])
def test_a_mark_needs_a_picture_of_the_whole_grid(tmp_path: Path, world: str, view: str) -> None:
    actions = "turn_left" if "3D" in world else "left"
    text = talk_study(tmp_path, view=view).read_text(encoding="utf-8").replace(FOUR_ROOMS, world)
    (tmp_path / "duet.toml").write_text(text.replace('"left", "right", "forward"', f'"{actions}"'), encoding="utf-8")
    with pytest.raises(ProtocolError, match="marks a cell of the whole picture; use it in a grid with view = 'full'"):
        check_worlds(read_protocol(tmp_path / "duet.toml"))


def test_without_either_nothing_is_written_or_shown(tmp_path: Path) -> None:
    (one, two), _, _ = talking(tmp_path, team=PEOPLE)
    write(one, SECRET)
    one.press("m", "f2")
    two.wait(1)
    assert one.of(MessageShown) == []
    assert one.machine.screen.page_fields == {}


def test_messages_of_a_page_that_moves_its_clock_reach_the_partner_at_the_servers_interval(tmp_path: Path) -> None:
    (one, two), clock, _ = talking(tmp_path)
    for number in range(3):
        one.wait(2001)  # by its own clock
        write(one, f"word{number}")
    two.wait(1)
    assert len(two.of(MessageShown)) == 1
    clock.s += 2.1
    two.wait(1)
    assert len(two.of(MessageShown)) == 2


def test_a_bids_export_has_no_log_with_what_people_wrote_to_each_other_unless_asked(tmp_path: Path) -> None:
    (one, two), _, _ = talking(tmp_path)
    write(one, SECRET)
    two.wait(1)
    end(one, two)
    exported = export("bids", tmp_path / "duet", tmp_path / "bids")
    copied = [path.name for path in (tmp_path / "bids" / "sourcedata").rglob("*.mcap")]
    assert len(copied) == 1  # the other's, which holds digests alone
    assert any("1 logs with messages between participants are not in sourcedata" in note for note in exported.notes)
    assert "--with-messages" in (tmp_path / "bids" / "README.md").read_text()
    export("bids", tmp_path / "duet", tmp_path / "all", with_messages=True)
    assert len(list((tmp_path / "all" / "sourcedata").rglob("*.mcap"))) == 2
