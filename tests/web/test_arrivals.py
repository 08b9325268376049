"""Who comes to a study's page: links, platforms, one slot once, and what is kept of them."""

import stat
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.recruitment import IDS_FILE_NAME, PlatformId, Recruitment
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.errors import AllocationError
from minihuman.experiment.machine.events import SessionStarted
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.storage.study_journals import ARRIVALS_FILE_NAME
from minihuman.web.arrivals import (
    Admission,
    Arrival,
    Arrivals,
    Rejection,
    build_link,
    build_platform_link,
    identify_visitor,
    is_token,
)
from tests.study.sessions import corridor_plan

TOML = corridor_plan(consent="May we?").protocol_toml
PERSON = "5f2b8a1c9d3e4f5061728394"


def arrivals(data: Path, web: str = "", *, participants: int = 100) -> Arrivals:
    protocol = decode_protocol(TOML + f"\n[web]\n{web}\n".encode())
    study = msgspec.structs.replace(protocol.study, participants=participants)
    return Arrivals(msgspec.structs.replace(protocol, study=study), data)


def from_prolific(person: str = PERSON) -> Arrival:
    return Arrival(platform={"PROLIFIC_PID": person, "STUDY_ID": "x", "SESSION_ID": "y"})


def test_a_link_leads_to_one_slot_however_often_it_is_opened(tmp_path):
    door = arrivals(tmp_path)
    first, second = door.recruits.issue(2)
    seats = [door.arrive(Arrival(token)) for token in (first, first, second)]
    assert [seat.key for seat in seats] == ["sub-01/1", "sub-01/1", "sub-02/1"]
    assert all(seat.plan.participant.id == seat.participant for seat in seats)
    assert len(read_enrolled(tmp_path / "corridor")) == 2


def test_a_long_allocation_list_is_made_before_anybody_comes_and_not_while_the_journal_is_held(tmp_path):
    door, called = arrivals(tmp_path, participants=211), set()
    (token,) = door.recruits.issue(1)
    sys.setprofile(lambda frame, event, _: called.add(frame.f_code.co_name) if event == "call" else None)
    try:
        assert isinstance(door.arrive(Arrival(token)), Admission)
    finally:
        sys.setprofile(None)
    assert "build_allocation_list" in called
    assert "_build_list" not in called


def test_a_token_is_behind_the_hash_and_kept_nowhere(tmp_path):
    door = arrivals(tmp_path)
    (token,) = door.recruits.issue(1)
    assert is_token(token)
    assert build_link("https://lab.example/", token) == f"https://lab.example/#t={token}"
    door.arrive(Arrival(token))
    for path in tmp_path.rglob("*"):
        assert not path.is_file() or token.encode() not in path.read_bytes()
    assert token not in repr(Arrival(token))


@pytest.mark.parametrize("token", ["", "x", "A" * 22, "A" * 5000, "../../etc/passwd", "\x00" * 22])
def test_a_guess_gets_nothing(tmp_path, token):
    door = arrivals(tmp_path)
    door.recruits.issue(3)
    assert door.arrive(Arrival(token)) == Rejection("unknown")
    assert read_enrolled(tmp_path / "corridor") == ()


def test_somebody_from_prolific_has_one_slot_and_is_named_in_one_file_only(tmp_path):
    door = arrivals(tmp_path, 'recruitment_platforms = ["prolific"]')
    seat = door.arrive(from_prolific())
    assert isinstance(seat, Admission)
    assert door.arrive(from_prolific()).key == seat.key
    assert door.arrive(from_prolific("60a7b3c4d5e6f708192a3b4c")).key == "sub-02/1"
    assert door.find_platform_id(seat.participant) == PERSON
    holding = [path.name for path in (tmp_path / "corridor").rglob("*") if PERSON.encode() in path.read_bytes()]
    assert holding == [IDS_FILE_NAME]
    mode = stat.S_IMODE((tmp_path / "corridor" / IDS_FILE_NAME).stat().st_mode)
    assert mode == 0o600
    assert PERSON not in repr(identify_visitor({"PROLIFIC_PID": PERSON}, ("prolific",)))


def test_the_same_person_has_another_stand_in_in_another_study(tmp_path):
    keys = {Recruitment(tmp_path / name).hash_platform_id("prolific", PERSON) for name in ("one", "two")}
    assert len(keys) == 2
    assert Recruitment(tmp_path / "one").hash_platform_id("prolific", PERSON) in keys


@pytest.mark.parametrize(
    ("allowed", "parameters", "who"),
    [
        (("prolific",), {"PROLIFIC_PID": PERSON}, ("prolific", PERSON)),
        (("sona",), {"survey_code": "4711"}, ("sona", "4711")),
        (("mturk",), {"workerId": "A1B2", "assignmentId": "3X", "hitId": "2Y"}, ("mturk", "A1B2")),
        (("sona",), {"PROLIFIC_PID": PERSON}, None),
        (("prolific",), {"PROLIFIC_PID": "{{%PROLIFIC_PID%}}"}, None),
        (("prolific",), {"PROLIFIC_PID": "<script>"}, None),
        ((), {"PROLIFIC_PID": PERSON}, None),
    ],
)
def test_a_platform_says_who_somebody_is(allowed, parameters, who):
    found = identify_visitor(parameters, allowed)
    assert (found and (found.platform, found.id)) == who


def test_platforms_put_their_ids_behind_the_hash_where_they_can():
    assert build_platform_link("prolific", "https://a.example/") == "https://a.example/#PROLIFIC_PID={{%PROLIFIC_PID%}}"


def test_a_preview_takes_no_slot(tmp_path):
    door = arrivals(tmp_path, 'recruitment_platforms = ["mturk"]')
    looking = {"workerId": "A1B2", "assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE"}
    assert door.arrive(Arrival(platform=looking)) == Rejection("preview")
    assert read_enrolled(tmp_path / "corridor") == ()


def test_anyone_may_come_where_the_study_says_so_and_comes_back_by_the_link_they_were_given(tmp_path):
    assert arrivals(tmp_path).arrive(Arrival()) == Rejection("unknown")
    door = arrivals(tmp_path, "open_access = true")
    seat = door.arrive(Arrival())
    assert door.arrive(Arrival(seat.token)).key == seat.key
    assert door.arrive(Arrival()).key != seat.key


def test_anyone_may_bring_a_link_of_their_own_and_comes_back_by_it_wherever_they_arrive(tmp_path):
    here, there = arrivals(tmp_path, "open_access = true"), arrivals(tmp_path, "open_access = true")
    mine, other = "A" * 22, "B" * 22
    seat = here.arrive(Arrival(mine))
    assert isinstance(seat, Admission)
    assert there.arrive(Arrival(mine)).key == seat.key
    assert there.arrive(Arrival(other)).key != seat.key
    assert there.arrive(Arrival("too short")).key not in (seat.key, "sub-02/1")


def test_closed_recruitment_lets_nobody_new_in_and_everybody_else_go_on(tmp_path):
    door = arrivals(tmp_path)
    here, new = door.recruits.issue(2)
    seat = door.arrive(Arrival(here))
    Recruitment(tmp_path / "corridor").recruit(False)  # by another server
    assert door.arrive(Arrival(new)) == Rejection("closed")
    assert door.arrive(Arrival(here)).key == seat.key
    door.recruits.recruit(True)
    assert door.arrive(Arrival(new)).key == "sub-02/1"


def test_a_full_study_says_so(tmp_path):
    door = arrivals(tmp_path, participants=1)
    here, new = door.recruits.issue(2)
    assert isinstance(door.arrive(Arrival(here)), Admission)
    assert door.arrive(Arrival(new)) == Rejection("full")


def test_who_declines_is_forgotten_and_may_think_better_of_it(tmp_path):
    door = arrivals(tmp_path, 'recruitment_platforms = ["prolific"]')
    seat = door.arrive(from_prolific())
    door.decline(seat, "declined")
    assert read_enrolled(tmp_path / "corridor") == ()
    assert not any(
        seat.participant.encode() in line for line in (tmp_path / "corridor" / ARRIVALS_FILE_NAME).read_bytes().split()
    )
    assert door.find_platform_id(seat.participant) == ""
    assert door.arrive(from_prolific("60a7b3c4d5e6f708192a3b4c")).participant == seat.participant
    assert door.arrive(from_prolific()).participant == "sub-02"


def test_who_withdraws_is_forgotten_everywhere(tmp_path):
    door = arrivals(tmp_path, 'recruitment_platforms = ["prolific"]')
    seat, other = door.arrive(from_prolific()), door.arrive(from_prolific("60a7b3c4d5e6f708192a3b4c"))
    withdraw_participant(tmp_path / "corridor", seat.participant, seal=None)
    kept = [path.read_bytes() for path in (tmp_path / "corridor").rglob("*") if path.is_file()]
    stand_in = door.recruits.hash_platform_id("prolific", PERSON).encode()
    assert not any(PERSON.encode() in content or stand_in in content for content in kept)
    assert door.find_platform_id(other.participant)
    assert stat.S_IMODE((tmp_path / "corridor" / IDS_FILE_NAME).stat().st_mode) == 0o600
    with pytest.raises(AllocationError, match="has withdrawn"):
        door.plan(seat)


def test_a_session_that_runs_or_was_cut_off_is_named_by_its_live_log(tmp_path):
    door = arrivals(tmp_path)
    (token,) = door.recruits.issue(1)
    seat = door.arrive(Arrival(token))
    recorder = McapRecorder(tmp_path, seat.plan, started_ns=1)
    recorder.write([SessionStarted(0, seat.plan, {})])
    again = door.arrive(Arrival(token))
    assert (again.key, again.plan, again.part) == (seat.key, None, recorder.segment_path.part)
    recorder.close()
    assert door.arrive(Arrival(token)).plan.segment == 2


def test_an_id_said_twice_is_written_once(tmp_path):
    recruits = Recruitment(tmp_path)
    for _ in range(3):
        recruits.remember(PlatformId("sub-01", "sona", "4711"))
    assert (tmp_path / IDS_FILE_NAME).read_bytes().count(b"\n") == 1


SERVER = """
import sys
from pathlib import Path
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.web.arrivals import Arrival, Arrivals
door = Arrivals(decode_protocol(Path(sys.argv[1]).read_bytes()), Path(sys.argv[2]))
sys.stdin.readline()
for token in sys.argv[3:]:
    print(door.arrive(Arrival(token)).participant, flush=True)
"""


@pytest.mark.program
def test_servers_that_share_a_folder_give_a_link_one_slot(tmp_path):
    (tmp_path / "x.toml").write_bytes(TOML)
    tokens = Recruitment(tmp_path / "corridor").issue(4)
    servers = [
        subprocess.Popen(
            [sys.executable, "-c", SERVER, str(tmp_path / "x.toml"), str(tmp_path), *tokens],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    told = [server.communicate("go\n")[0].split() for server in servers]
    assert told[0] == told[1] == told[2]
    assert sorted(told[0]) == ["sub-01", "sub-02", "sub-03", "sub-04"]
