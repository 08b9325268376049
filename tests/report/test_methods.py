"""The methods paragraph tells how people came to their groups."""

import re
from collections import Counter
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from minihuman.admin.protocol_file import find_shipped_protocol
from minihuman.dataset.recording_quality import PlanOutline, measure_recording_quality
from minihuman.experiment.machine.events import Paused, Resumed
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.reporting.known_keys import find_blocks_without_discovery, find_known_keys
from minihuman.reporting.methods import build_methods
from minihuman.reporting.sections import quality_section
from tests.builders import session
from tests.report.pages import page
from tests.seats.test_drawn_group import STUDY
from tests.study.sessions import corridor_plan


def test_strata_are_named_with_their_question_and_who_is_in_them():
    plans = [
        expand_protocol(STUDY, enrol_participant(STUDY, index, stratum=name))
        for index in range(3)
        for name in ("left", "right")
    ]
    plans = [plan for number, plan in enumerate(plans) if number != 5]
    codes = [PlanOutline.of(plan) for plan in plans]
    outlines = [
        PlanOutline(
            *(getattr(one, name) if name != "participant" else f"sub-{number}" for name in one.__struct_fields__)
        )
        for number, one in enumerate(codes)
    ]
    many = Counter((plan.participant.stratum, plan.participant.group) for plan in plans)
    told = "; ".join(f"{name}: a {many[name, 'a']}, b {many[name, 'b']}" for name in ("left", "right"))
    text = build_methods(outlines, [])[0]
    assert text.endswith(
        f" Groups were stratified by the answer to you.hand, with one allocation list per stratum ({told})."
    )


def test_what_each_group_had_is_said_where_they_differ():
    study = decode_protocol(find_shipped_protocol("fourrooms-transfer").read_bytes())
    plans = [PlanOutline.of(expand_protocol(study, enrol_participant(study, index))) for index in range(4)]
    assert "Parts by group: grid-first had grid, first-person; direct had first-person." in build_methods(
        plans, [], protocols=[study]
    )


def test_who_came_with_the_keys_of_the_block_before_is_named():
    protocol = find_shipped_protocol("fourrooms-transfer").read_bytes()
    study = decode_protocol(protocol)
    plans = [PlanOutline.of(expand_protocol(study, enrol_participant(study, index))) for index in range(4)]
    assert {plan.group for plan in plans} == {"grid-first", "direct"}
    assert find_known_keys(plans) == {"first-person": ["grid-first"]}
    assert find_blocks_without_discovery(plans) == frozenset()
    grid, rooms = build_methods(plans, [])[1:3]  # in the order of play, whoever came first
    assert grid.startswith("Block grid")
    assert "except by grid-first, who kept the keys that they had before" in rooms
    (kept,) = build_methods([plan for plan in plans if plan.group == "grid-first"], [], block_order=["grid"])[2:3]
    assert kept.endswith("; the keys were those of an earlier block.")


def test_where_blocks_are_in_random_order_who_played_another_before_is_said_to_know_the_keys():
    block = 'world = "minihuman/MiniGrid-Empty-5x5-v0"\nepisodes = 1\nactions = ["left", "forward"]\nmax_steps = 9'
    blocks = "".join(f'[[blocks]]\nname = "{name}"\nkey_map = "constant"\n{block}\n' for name in "xyz")
    text = '[study]\nname = "random"\nversion = "1"\nseed = 3\nparticipants = 12\n[keys]\npool = ["1", "2", "3"]\n'
    groups = "".join(f'[[groups]]\nname = "{name}"\nparts = ["all"]\n' for name in "ab")
    order = '[[orders]]\nname = "all"\nparts = ["x", "y", "z"]\norder = "shuffled"\n'
    study = decode_protocol(f"{text}{groups}{order}{blocks}".encode())
    plans = [PlanOutline.of(expand_protocol(study, enrol_participant(study, index))) for index in range(12)]
    texts = [paragraph for paragraph in build_methods(plans, [], protocols=[study]) if paragraph.startswith("Block ")]
    exception = "(except by those who had played another block, who kept the keys that they had before)."
    assert [text.endswith(exception) for text in texts] == [True] * 3


def test_blocks_are_in_the_order_of_the_page_and_only_its_measures_are_defined():
    study = decode_protocol(find_shipped_protocol("fourrooms-transfer").read_bytes())
    plans = [PlanOutline.of(expand_protocol(study, enrol_participant(study, index))) for index in range(4)]
    text = build_methods(plans, [], block_order=["first-person", "grid"], measures={"reward_mean"})
    assert [paragraph[:11] for paragraph in text[1:3]] == ["Block first", "Block grid:"]
    assert text[3].endswith("The measures: reward = the rewards of the world, summed over the episode.")


def test_a_session_that_went_on_elsewhere_names_both_stations():
    log = session(episodes=1, blocks=("grid",))
    segments = tuple(
        replace(log.segments[0], number=number, facts={"python": python, "refresh_hz_reported": hz})
        for number, (python, hz) in enumerate((("3.11", "60.0"), ("3.13", "144.0"), ("3.13", "144.0")), 1)
    )
    found = measure_recording_quality(replace(log, segments=segments))
    assert "Run with Python 3.11 and 3.13." in build_methods([PlanOutline.of(corridor_plan())], [found])[-2]
    told = page(quality=quality_section([found]))
    assert [told.count(f"refresh_hz_reported {hz}") for hz in ("60.0", "144.0")] == [1, 1]


def test_periods_of_real_time_without_a_step_are_counted_but_not_those_of_a_pause():
    log = session(episodes=1, blocks=("grid",))
    [played] = log.episodes
    flip_ns = int(played.frames.column("flip_ns")[0])
    steps = len(played.actions)
    periods = [1, 2, 4, 90, 91, 94, *range(95, 89 + steps)]  # after the fourth there is a pause
    t_ns = np.array([0, *(flip_ns + 20_000_000 * period + 3_000_000 for period in periods)])
    plan = msgspec.structs.replace(played.plan, pace="real_time", step_period_ms=20.0, noop="left")
    real_time = replace(played, start=replace(played.start, plan=plan), t_ns=t_ns)
    pause = (Paused(int(t_ns[3]) + 1, "asked"), Resumed(int(t_ns[4]) - 1))
    segment = replace(log.segments[0], notes=pause)
    found = measure_recording_quality(replace(log, episodes=(real_time,), segments=(segment,)))
    assert (found.periods, found.periods_missed) == (1 + 2 + 1 + 3 + steps - 6, 1 + 2)
    lead = quality_section([replace(found, displays=({"window": "pygame"},))]).lead
    assert lead.endswith(f"; 3 of {steps + 1} periods of real time passed without a step")
    assert measure_recording_quality(log).periods == 0


def test_blocks_that_the_page_computed_are_named_where_a_page_did():
    study = decode_protocol(find_shipped_protocol("fourrooms-transfer").read_bytes())
    plans = [PlanOutline.of(expand_protocol(study, enrol_participant(study, index))) for index in range(4)]
    plan = next(plan for plan in plans if plan.group == "grid-first")
    log = session(episodes=1, blocks=("grid",))
    kernels = replace(log.segments[0], facts={"page_kernels": "eafdd193f1072bf8"})
    for segment, says in ((log.segments[0], False), (kernels, True)):
        found = measure_recording_quality(replace(log, segments=(segment,)))
        text = build_methods([plan], [replace(found, participant=plan.participant)])[-2]
        assert (
            "stepped and drew blocks first-person and grid ahead of the server (kernels eafdd193f1072bf8)" in text
        ) is says


@pytest.mark.parametrize("moves", [False, True])
def test_a_view_that_moved_is_told_with_what_times_count_from(moves):
    toml = find_shipped_protocol("fourrooms-transfer").read_text()
    world = 'world = "minihuman/MiniWorld-FourRooms-v0"'
    assert toml.count(world) == 1
    study = decode_protocol((toml.replace(world, f"{world}\nmotion_ms = 120") if moves else toml).encode())
    plan = PlanOutline.of(expand_protocol(study, enrol_participant(study, 0)))
    text = " ".join(build_methods([plan], [], protocols=[study]))
    assert text.count("the view moved to each new picture for 120 ms, from the beginning of which times count") == moves


def test_a_session_whose_browser_had_other_kernels_is_not_said_to_have_been_stepped_by_its_page():
    study = decode_protocol(find_shipped_protocol("fourrooms-transfer").read_bytes())
    plans = [PlanOutline.of(expand_protocol(study, enrol_participant(study, index))) for index in range(8)]
    direct, both = (next(plan for plan in plans if plan.group == group) for group in ("direct", "grid-first"))
    log = session(episodes=1, blocks=("grid",))
    kernels = (replace(log.segments[0], facts={"page_kernels": "eafdd193f1072bf8"}),)
    qualities = [
        replace(measure_recording_quality(replace(log, segments=segments)), participant=plan.participant)
        for plan, segments in ((direct, kernels), (both, log.segments))
    ]
    text = build_methods([direct, both], qualities)[-2]
    assert "In browsers in 1 of 2 sessions the page stepped and drew block first-person ahead of" in text


def test_a_block_whose_keys_were_shown_or_kept_by_all_has_no_discovery():
    toml = find_shipped_protocol("fourrooms-transfer").read_bytes().decode()
    shown = decode_protocol(toml.replace("max_steps = 100", "max_steps = 100\nshow_keys = true", 1).encode())
    plans = [PlanOutline.of(expand_protocol(shown, enrol_participant(shown, index))) for index in range(4)]
    [block] = find_blocks_without_discovery(plans)
    assert {block_plan.show_keys for plan in plans for block_plan in plan.blocks if block_plan.block_name == block} == {
        True
    }
    first = [plan for plan in plans if plan.group == "grid-first"]
    assert "first-person" in find_blocks_without_discovery(first, [shown])


@pytest.mark.parametrize("keys", [3, 5])
def test_keys_that_are_drawn_anew_are_not_taken_for_those_of_the_block_before(keys):
    """Nor where there are no others than those, nor where some people happen to draw the same ones."""
    toml = find_shipped_protocol("fourrooms-transfer").read_bytes().decode()
    toml = re.sub(r"pool = \[.*\]", f"pool = {[str(key) for key in range(1, keys + 1)]}", toml)
    study = decode_protocol(toml.replace('key_map = "carry_over"', 'key_map = "new"').encode())
    plans = [
        PlanOutline.of(expand_protocol(study, enrol_participant(study, index)))
        for index in range(study.study.participants)
    ]
    both = [plan.blocks for plan in plans if plan.group == "grid-first"]
    assert any(set(grid.key_map.keys) == set(rooms.key_map.keys) for grid, rooms in both)
    assert find_known_keys(plans) == {}
    assert "the keys were those of the block before" not in " ".join(build_methods(plans, []))


def test_without_strata_nothing_is_said_of_them():
    assert "strata" not in build_methods([PlanOutline.of(corridor_plan())], [])[0]


def test_balanced_orders_and_teams_are_named():
    protocol = decode_protocol(find_shipped_protocol("two-days").read_bytes())
    plans = [PlanOutline.of(expand_protocol(protocol, enrol_participant(protocol, index))) for index in range(4)]
    order = "The order of open, rooms, crossing and lava followed a Latin square (Williams, 1949) for each 4 successive"
    assert f"{order} participants of a group." in " ".join(build_methods(plans, [], protocols=[protocol]))
    team = decode_protocol(find_shipped_protocol("team").read_bytes())
    plans = [PlanOutline.of(expand_protocol(team, enrol_participant(team, index))) for index in range(4)]
    text = " ".join(build_methods(plans, [], protocols=[team]))
    assert "Block kitchen, group two-people:" in text
    assert "; played by teams of 2 people." in text
    assert "; played by one person together with scripted:cook." in text
