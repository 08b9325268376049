"""Levels drawn as diagrams: in Python, and as the level editor's page reads and writes them."""

import json
import tomllib
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401  # registers the worlds
from minihuman.errors import WorldError

DRAWN = Path(__file__).parents[2] / "web/page/level.json"  # a level's file and its first state; the page has it too


def make(**options):
    return gymnasium.make("minihuman/Level-v0", **options).unwrapped


def test_a_diagram_is_laid_out_as_it_is_drawn():
    world = make(diagram="WWWWWWWW\n  WWvvWW\n  WWGgWW\n  WWWWWW", mission="down")
    observation, _ = world.reset(seed=0)
    assert world.text() == "WWWWWWWW\n  WWvvWW\n  WWGgWW\n  WWWWWW"
    assert observation["mission"] == "down"
    assert world.step(2)[1:3] == (1 - 0.9 / 64, True)


def test_common_indentation_is_left_out():
    assert make(diagram="\n    WWWWWW\n    WW  WW\n    WWWWWW\n").reset(seed=0)
    assert make(diagram="\n    WWWWWW\n    WW  WW\n    WWWWWW\n").diagram == "WWWWWW\nWW  WW\nWWWWWW"


def test_without_an_agent_its_place_follows_from_the_seed():
    world = make(diagram="\n".join(["WW" * 9, *["WW" + "  " * 7 + "WW"] * 7, "WW" * 9]))
    places = [world.reset(seed=seed) and world.state.position for seed in (1, 2, 3, 1)]
    assert places[0] == places[3]
    assert len(set(places)) == 3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"diagram": "WW\nWW"}, "1 columns and 2 rows"),
        ({"diagram": "WWWWWW\nWW>>Zq\nWWWWWW"}, "'Zq' in column 2, row 1"),
        ({"diagram": "WWWWWW\nWW>>^^\nWWWWWW"}, "2 agents"),
        ({"diagram": 3}, "must be a string"),
        ({"diagram": ""}, "0 columns"),
    ],
)
def test_a_diagram_that_means_nothing_is_refused(options, words):
    with pytest.raises(WorldError, match=words):
        make(**options)


def test_a_file_of_the_editor_is_a_world_whose_first_state_the_page_has():
    drawn = json.loads(DRAWN.read_text(encoding="utf-8"))
    level = tomllib.loads(drawn["file"])
    world = gymnasium.make(level["world"], **level["options"]).unwrapped
    world.reset(seed=0)
    np.testing.assert_array_equal(world.state.row, drawn["row"])


def test_a_level_is_seen_from_inside():
    world = gymnasium.make("minihuman/Level-v0", view="first_person", obs_width=40, obs_height=30)
    assert world.reset(seed=0)[0]["image"].shape == (30, 40, 3)
