"""The methods paragraph tells how people came to their groups."""

import re
from collections import Counter
from dataclasses import replace

import pytest

from minihuman.data.quality import Outline, quality_of
from minihuman.lab.shipped import shipped_protocol
from minihuman.report.methods import knew_the_keys, methods
from minihuman.report.recorded import quality
from minihuman.study.expand import enrol, expand
from minihuman.study.protocol import decode
from tests.builders import session
from tests.seats.test_drawn_group import STUDY
from tests.study.sessions import corridor_plan


def test_strata_are_named_with_their_question_and_who_is_in_them():
    plans = [expand(STUDY, enrol(STUDY, index, stratum=name)) for index in range(3) for name in ("left", "right")]
    plans = [plan for number, plan in enumerate(plans) if number != 5]
    codes = [Outline.of(plan) for plan in plans]
    outlines = [
        Outline(*(getattr(one, name) if name != "participant" else f"sub-{number}" for name in one.__struct_fields__))
        for number, one in enumerate(codes)
    ]
    many = Counter((plan.participant.stratum, plan.participant.group) for plan in plans)
    told = "; ".join(f"{name}: a {many[name, 'a']}, b {many[name, 'b']}" for name in ("left", "right"))
    text = methods(outlines, [])[0]
    assert text.endswith(
        f" Groups were drawn after the answer to you.hand, within strata that have a list each ({told})."
    )


def test_who_came_with_the_keys_of_the_block_before_is_named():
    protocol = shipped_protocol("fourrooms-transfer").read_bytes()
    study = decode(protocol)
    plans = [Outline.of(expand(study, enrol(study, index))) for index in range(4)]
    assert {plan.group for plan in plans} == {"grid-first", "direct"}
    assert knew_the_keys(plans) == {"first-person": ["grid-first"]}
    grid, rooms = methods(plans, [])[1:3]  # in the order of play, whoever came first
    assert grid.startswith("Block grid")
    assert "not by grid-first: the keys were those of the block before" in rooms


def test_a_session_that_went_on_elsewhere_names_both_stations():
    log = session(episodes=1, blocks=("grid",))
    segments = tuple(
        replace(log.segments[0], number=number, facts={"python": python, "refresh_hz_reported": hz})
        for number, (python, hz) in enumerate((("3.11", "60.0"), ("3.13", "144.0"), ("3.13", "144.0")), 1)
    )
    found = quality_of(replace(log, segments=segments))
    assert "Run with Python 3.11 and 3.13." in methods([Outline.of(corridor_plan())], [found])[-2]
    page = quality([found])
    assert [page.count(f"refresh_hz_reported {hz}") for hz in ("60.0", "144.0")] == [1, 1]


@pytest.mark.parametrize("keys", [3, 5])
def test_keys_that_are_drawn_anew_are_not_taken_for_those_of_the_block_before(keys):
    """Nor where there are no others than those, nor where some people happen to draw the same ones."""
    toml = shipped_protocol("fourrooms-transfer").read_bytes().decode()
    toml = re.sub(r"pool = \[.*\]", f"pool = {[str(key) for key in range(1, keys + 1)]}", toml)
    study = decode(toml.replace('key_map = "carry"', 'key_map = "fresh"').encode())
    plans = [Outline.of(expand(study, enrol(study, index))) for index in range(study.study.participants)]
    both = [plan.blocks for plan in plans if plan.group == "grid-first"]
    assert any(set(grid.key_map.keys) == set(rooms.key_map.keys) for grid, rooms in both)
    assert knew_the_keys(plans) == {}
    assert "the keys were those of the block before" not in " ".join(methods(plans, []))


def test_without_strata_nothing_is_said_of_them():
    assert "strata" not in methods([Outline.of(corridor_plan())], [])[0]
