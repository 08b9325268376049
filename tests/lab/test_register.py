import itertools
import random
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pytest

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.enrolment_log import _holders_of, free_slot, take_slot
from minihuman.admin.status import format_status
from minihuman.admin.withdrawal import replace_participant, withdraw_participant
from minihuman.errors import AllocationError
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from tests.counts import count
from tests.programs import running

PATH = Path(__file__).parents[2] / "protocols" / "fourrooms-transfer.toml"
PROTOCOL = decode_protocol(PATH.read_bytes())

STATION = """
import sys
from pathlib import Path
from minihuman.admin.enrolment_log import take_slot
from minihuman.experiment.protocol.protocol import decode_protocol
protocol = decode_protocol(Path(sys.argv[1]).read_bytes())
sys.stdin.readline()
for _ in range(int(sys.argv[3])):
    print(take_slot(protocol, Path(sys.argv[2]))[0].index, flush=True)
"""


def test_slots_follow_the_list(tmp_path):
    taken = [take_slot(PROTOCOL, tmp_path)[0] for _ in range(4)]
    assert [(who.index, who.group) for who in taken] == [
        (slot.index, slot.group) for slot in build_allocation_list(PROTOCOL)[:4]
    ]
    assert [line.participant for line in read_enrolled(tmp_path)] == ["sub-01", "sub-02", "sub-03", "sub-04"]


def test_who_joins_gets_the_first_free_slot_whatever_was_read_before(tmp_path):
    """What a process knows of earlier lines is kept; another that reads them all at once knows the same."""
    rng = random.Random(5)
    held, codes = {}, set()  # by index; and the codes that were somebody's
    for _ in range(120):
        what = rng.choice(("take", "take", "take", "free", "replace", "withdraw"))
        if what == "take":
            code = take_slot(PROTOCOL, tmp_path)[0].id
            index = next(index for index in itertools.count() if index not in held)
            assert code not in codes
            assert read_enrolled(tmp_path)[-1].index == index
            held[index] = code
            codes.add(code)
        elif held:
            index = rng.choice(sorted(held))
            code = held.pop(index)
            if what == "free":
                free_slot(tmp_path, code, "declined")
                codes.remove(code)
            elif what == "replace":
                replace_participant(tmp_path, code)
            else:
                withdraw_participant(tmp_path, code, seal=None)
        if rng.random() < 0.2:
            _holders_of.cache_clear()  # as in a process that begins


@pytest.mark.program
def test_many_stations_at_once_never_share_a_slot(tmp_path):
    stations = [
        subprocess.Popen(
            [sys.executable, "-c", STATION, str(PATH), str(tmp_path), "5"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(6)
    ]
    indices = [int(line) for station in stations for line in station.communicate("go\n")[0].split()]
    assert sorted(indices) == list(range(30))


@pytest.mark.program
@pytest.mark.nightly(sample=True)
def test_stations_that_are_killed_lose_no_slot_and_share_none(tmp_path):
    stations, each = count(3, 8), count(8, 200)
    protocol = tmp_path / "many.toml"
    protocol.write_text(PATH.read_text().replace("participants = 60", "participants = 2000"))
    told: list[list[int]] = [[] for _ in range(stations)]
    killed = [0] * stations

    def station(number: int) -> None:
        """Take slots until there are enough, killed and started again a quarter and half of the way."""
        while len(told[number]) < each:
            left = each - len(told[number])
            command = [sys.executable, "-c", STATION, str(protocol), str(tmp_path / "study"), str(left)]
            with running(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
                process.stdin.write("go\n")
                process.stdin.flush()
                for line in process.stdout:
                    told[number].append(int(line))
                    if killed[number] < 2 and len(told[number]) >= each * (killed[number] + 1) // 4:
                        killed[number] += 1
                        process.kill()

    with ThreadPoolExecutor(stations) as desks:
        list(desks.map(station, range(stations)))
    acknowledged = sorted(index for indices in told for index in indices)
    taken = [line.index for line in read_enrolled(tmp_path / "study")]
    print(f"\n{stations} stations, {sum(killed)} kills, {len(acknowledged)} slots told of, {len(taken)} taken")
    assert len(set(acknowledged)) == len(acknowledged)
    assert set(acknowledged) <= set(taken)
    assert sorted(taken) == list(range(len(taken)))
    assert len(taken) >= stations * each


def test_a_participant_named_by_hand_is_passed_over_by_the_list(tmp_path):
    who, line = take_slot(PROTOCOL, tmp_path, participant="sub-02", group="direct")
    assert (who.index, who.group, line.overridden) == (1, "direct", True)
    assert [take_slot(PROTOCOL, tmp_path)[0].id for _ in range(2)] == ["sub-01", "sub-03"]


def test_a_known_participant_keeps_the_slot(tmp_path):
    first, _ = take_slot(PROTOCOL, tmp_path)
    again, line = take_slot(PROTOCOL, tmp_path, participant=first.id)
    assert again == first
    assert not line.overridden
    assert len(read_enrolled(tmp_path)) == 1


def test_a_known_participant_cannot_change_group(tmp_path):
    who, _ = take_slot(PROTOCOL, tmp_path)
    other = next(group.name for group in PROTOCOL.groups if group.name != who.group)
    with pytest.raises(AllocationError, match="remove --group"):
        take_slot(PROTOCOL, tmp_path, participant=who.id, group=other)


def test_another_seed_under_the_same_name_is_refused(tmp_path):
    take_slot(PROTOCOL, tmp_path)
    changed = msgspec.structs.replace(PROTOCOL, study=msgspec.structs.replace(PROTOCOL.study, seed=1))
    with pytest.raises(AllocationError, match="began with allocation list"):
        take_slot(changed, tmp_path)


def test_a_study_may_make_its_list_longer(tmp_path):
    short = msgspec.structs.replace(PROTOCOL, study=msgspec.structs.replace(PROTOCOL.study, participants=1))
    take_slot(short, tmp_path)
    with pytest.raises(AllocationError, match="all 1 slots"):
        take_slot(short, tmp_path)
    assert take_slot(PROTOCOL, tmp_path)[0].index == 1


def test_a_line_cut_off_by_a_crash_gives_its_slot_back(tmp_path):
    for _ in range(2):
        take_slot(PROTOCOL, tmp_path)
    path = tmp_path / ENROLMENT_FILE_NAME
    path.write_bytes(path.read_bytes()[:-10])
    assert take_slot(PROTOCOL, tmp_path)[0].index == 1
    assert [line.index for line in read_enrolled(tmp_path)] == [0, 1]


def test_a_damaged_line_stops_the_station(tmp_path):
    (tmp_path / ENROLMENT_FILE_NAME).write_bytes(b'{"participant": 3}\n')
    with pytest.raises(AllocationError, match=r"register\.jsonl:1: .* cannot be read"):
        take_slot(PROTOCOL, tmp_path)


def test_the_slot_of_who_was_replaced_came_back_and_declined_is_one_person_s(tmp_path):
    take_slot(PROTOCOL, tmp_path)
    replace_participant(tmp_path, "sub-01")
    free_slot(tmp_path, "sub-01", "declined")
    assert [take_slot(PROTOCOL, tmp_path)[0].id for _ in range(2)] == ["sub-01", "sub-02"]
    assert not any("does not come back" in line for line in format_status(tmp_path))
    replace_participant(tmp_path, "sub-01")
    replace_participant(tmp_path, "sub-01")
    assert [take_slot(PROTOCOL, tmp_path)[0].id for _ in range(2)] == ["sub-100001", "sub-03"]


def test_nobody_gets_the_code_of_who_withdrew_though_another_of_that_slot_left_no_data(tmp_path):
    take_slot(PROTOCOL, tmp_path)
    replace_participant(tmp_path, "sub-01")
    assert take_slot(PROTOCOL, tmp_path)[0].id == "sub-100001"
    free_slot(tmp_path, "sub-01", "declined")
    withdraw_participant(tmp_path, "sub-100001", seal=None)
    taken = [take_slot(PROTOCOL, tmp_path)[0] for _ in range(2)]
    assert [who.index for who in taken] == [0, 1]
    assert [line.participant for line in read_enrolled(tmp_path)] == [who.id for who in taken]
