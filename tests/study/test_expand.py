import subprocess
import sys
from collections import Counter
from pathlib import Path

import msgspec
import pytest

from minihuman.errors import AllocationError, ProtocolError
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.participant_codes import parse_participant_code
from minihuman.experiment.protocol.protocol import decode_protocol

PATH = Path(__file__).parents[2] / "protocols" / "fourrooms-transfer.toml"
PROTOCOL = decode_protocol(PATH.read_bytes())


def with_block(number: int, **changes):
    blocks = list(PROTOCOL.blocks)
    blocks[number] = msgspec.structs.replace(blocks[number], **changes)
    return msgspec.structs.replace(PROTOCOL, blocks=tuple(blocks))


def first_in(group: str, protocol=PROTOCOL) -> int:
    return next(slot.index for slot in build_allocation_list(protocol) if slot.group == group)


@pytest.mark.program
def test_the_plan_is_the_same_in_another_process():
    plan = expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, 3))
    program = (
        "import sys, msgspec; from minihuman.experiment.protocol.protocol import decode_protocol;"
        "from minihuman.experiment.plan.expansion import *;"
        "p = decode_protocol(open(sys.argv[1], 'rb').read()); plan = expand_protocol(p, enrol_participant(p, 3));"
        "sys.stdout.buffer.write(msgspec.json.encode(plan))"
    )
    other = subprocess.run([sys.executable, "-c", program, str(PATH)], capture_output=True, check=True).stdout
    assert other == msgspec.json.encode(plan)


def test_the_plan_of_this_version_is_pinned():
    """A change here changes what running studies resolve to: it must be meant."""
    episode = expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, 1)).episodes[0]
    assert episode.seed == 925308356
    assert episode.key_map.keys == {"8": "left", "1": "right", "6": "forward"}
    assert allocation_sha256(build_allocation_list(PROTOCOL))[:16] == "0606e3a7200c96a1"


def test_grid_first_carries_its_keys_by_position_into_first_person():
    plan = expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, first_in("grid-first")))
    grid, rooms = plan.episodes[0], plan.episodes[10]
    assert (len(plan.episodes), grid.block_name, rooms.block_name) == (20, "grid", "first-person")
    by_action = {action: key for key, action in grid.key_map.keys.items()}
    carried = {action: key for key, action in rooms.key_map.keys.items()}
    assert [by_action[name] for name in grid.actions] == [carried[name] for name in rooms.actions]


def test_direct_draws_keys_for_the_block_that_carries_elsewhere():
    plan = expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, first_in("direct")))
    assert len(plan.episodes) == 10
    assert set(plan.episodes[0].key_map.keys.values()) == {"turn_left", "turn_right", "move_forward"}


def test_every_action_falls_once_on_every_key_over_nine_participants():
    slots = build_allocation_list(PROTOCOL)
    for first in range(0, 54, 9):
        for draw in range(2):
            rows = [slot.positions[draw] for slot in slots[first : first + 9]]
            assert all(len(set(row)) == 3 for row in rows)
            for action in range(3):
                assert sorted(row[action] for row in rows) == list(range(9))


def test_within_a_group_no_key_position_runs_ahead():
    slots = build_allocation_list(PROTOCOL)
    for group in ("grid-first", "direct"):
        rows = [slot.positions[0] for slot in slots if slot.group == group]
        for action in range(3):
            counts = Counter(row[action] for row in rows)
            assert max(counts.values()) - min(counts.values()) <= 3


def test_groups_stay_level_and_cannot_be_guessed():
    groups = [slot.group for slot in build_allocation_list(PROTOCOL)]
    ahead = 0
    for group in groups:
        ahead += 1 if group == "direct" else -1
        assert abs(ahead) <= 3
    assert len({tuple(groups[at : at + 4]) for at in range(0, 56, 4)}) > 3


def test_a_longer_list_begins_with_the_shorter():
    study = msgspec.structs.replace(PROTOCOL.study, participants=200)
    assert build_allocation_list(msgspec.structs.replace(PROTOCOL, study=study))[:60] == build_allocation_list(PROTOCOL)


def test_new_layouts_differ_by_episode_and_participant():
    one, two = (expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, index, "direct")) for index in (0, 1))
    assert len({episode.seed for episode in one.episodes + two.episodes}) == 20


def test_same_layout_is_one_seed_a_participant():
    protocol = with_block(1, seeds="same")
    plans = [expand_protocol(protocol, enrol_participant(protocol, index, "direct")) for index in (0, 1)]
    assert [len({episode.seed for episode in plan.episodes}) for plan in plans] == [1, 1]
    assert plans[0].episodes[0].seed != plans[1].episodes[0].seed


def test_listed_layouts_are_shared_by_all():
    protocol = with_block(1, seeds=tuple(range(100, 110)))
    for index in (0, 1):
        plan = expand_protocol(protocol, enrol_participant(protocol, index, "direct"))
        assert [episode.seed for episode in plan.episodes] == list(range(100, 110))


def test_changing_one_block_shifts_no_seed_elsewhere():
    index = first_in("grid-first")
    before = expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, index)).episodes[10:]
    after = expand_protocol(with_block(0, episodes=3), enrol_participant(PROTOCOL, index)).episodes[3:]
    assert [episode.seed for episode in before] == [episode.seed for episode in after]
    assert [episode.key_map for episode in before] == [episode.key_map for episode in after]


def test_distractors_take_every_spare_key():
    keys = msgspec.structs.replace(PROTOCOL.keys, spare_keys="distractor")
    blocks = tuple(
        msgspec.structs.replace(block, distractors=("pickup", "drop", "toggle")) for block in PROTOCOL.blocks
    )
    protocol = msgspec.structs.replace(PROTOCOL, keys=keys, blocks=blocks)
    key_map = expand_protocol(protocol, enrol_participant(protocol, 0)).episodes[0].key_map
    assert set(key_map.keys) == set(keys.pool)
    assert Counter(key_map.keys.values())["pickup"] == 2
    assert key_map.spare_keys == ()


def test_a_second_session_has_other_keys_and_layouts():
    first, second = (expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, 0), session=number) for number in (1, 2))
    assert first.episodes[0].seed != second.episodes[0].seed
    assert first.episodes[0].key_map != second.episodes[0].key_map


def test_resuming_changes_nothing_but_where_it_goes_on():
    whole = expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, 0))
    resumed = expand_protocol(PROTOCOL, enrol_participant(PROTOCOL, 0), first_episode=4, segment=2)
    assert resumed.episodes == whole.episodes
    assert (resumed.first_episode, resumed.segment) == (4, 2)


@pytest.mark.parametrize("code", ["Anna", "sub-", "sub-00", "sub-7", "07", "sub-07b"])
def test_a_name_is_no_code(code):
    with pytest.raises(AllocationError, match="is not a participant code"):
        parse_participant_code(code)


def test_an_unknown_group_lists_the_known():
    with pytest.raises(ProtocolError, match=r"no group 'control'; its groups are grid-first, direct"):
        enrol_participant(PROTOCOL, 0, "control")


def test_a_participant_beyond_the_list_is_refused():
    with pytest.raises(AllocationError, match=r"60 slots and none for participant 61; raise \$\.study\.participants"):
        enrol_participant(PROTOCOL, 60)


@pytest.mark.parametrize(
    ("world", "more", "computed"),
    [
        ("minihuman/MiniGrid-FourRooms-v0", "", "page"),
        ("minihuman/MiniGrid-FourRooms-v0", 'computed = "server"', "server"),
        ("minihuman/MiniGrid-FourRooms-v0", 'view = "text"', "server"),
        ("minihuman/MiniGrid-FourRooms-v0", 'pace = "real_time"\nstep_period_ms = 300.0', "page"),
        (
            "minihuman/MiniGrid-FourRooms-v0",
            'pace = "real_time"\nstep_period_ms = 300.0\nhold = "repeat"',
            "server",
        ),
        ("minihuman/MiniGrid-FourRooms-v0", 'options = { view = "first_person" }', "server"),
        ("minihuman/MiniGrid-GoToObj-Transfer-v0", "", "server"),
        ("minihuman/MiniWorld-FourRooms-v0", "", "page"),
        (
            "minihuman/MiniWorld-FourRooms-v0",
            'pace = "real_time"\nstep_period_ms = 300.0\nhold = "repeat"',
            "page",
        ),
        ("lab_worlds:lab/Maze-v0", "", "server"),
        ("lab_worlds:lab/Maze-v0", 'computed = "page"', "page"),
    ],
)
def test_worlds_of_ours_are_computed_by_the_page_unless_the_protocol_says_otherwise(world, more, computed):
    toml = f"""
    [study]
    name = "tried"
    version = "1"
    seed = 1
    [[groups]]
    name = "all"
    blocks = ["one"]
    [[blocks]]
    name = "one"
    world = "{world}"
    episodes = 1
    actions = ["left", "right"]
    max_steps = 9
    {more}
    """
    study = decode_protocol(toml.encode())
    plan = expand_protocol(study, enrol_participant(study, 0))
    assert [part.plan.computed for part in plan.parts if part.kind == "play"] == [computed]
