"""Lines of Minigrid's own code that touch an environment give the same on ours, or are refused with what to use."""

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from minigrid.wrappers import ImgObsWrapper, RGBImgPartialObsWrapper

import minihuman  # noqa: F401
from tests.counts import count
from tests.worlds.upstream_lines import Line, compare, expressions_in, extract_lines, installed_folders

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.mark.nightly(sample=True)
def test_drawn_lines_of_minigrids_sources_give_the_same_or_are_refused():
    lines = [line for line in extract_lines(installed_folders()) if not line.world_id.startswith("MiniWorld")]
    assert len(lines) > 400
    order = np.random.default_rng(7).permutation(len(lines))[: count(25, len(lines))]
    outcomes = {lines[number]: compare(lines[number]) for number in order.tolist()}
    assert {line: words for line, (outcome, words) in outcomes.items() if outcome == "differs"} == {}
    assert {line: words for line, (outcome, words) in outcomes.items() if outcome == "raises without advice"} == {}
    assert sum(outcome == "same" for outcome, _ in outcomes.values()) > len(outcomes) / 3


@pytest.mark.parametrize(
    ("text", "outcome"),
    [
        ("u.agent_pos", "same"),
        ("u.step_count = 3", "same"),
        ("u.connect_all", "refused"),
        ("u.no_such_name", "upstream fails"),
    ],
)
def test_a_line_is_judged_by_what_it_gives_and_what_follows(text, outcome):
    assert compare(Line(text, "MiniGrid-KeyCorridorS3R1-v0"))[0] == outcome


def test_lines_are_taken_from_what_touches_an_environment():
    source = (
        "env.unwrapped.grid.set(i, j, None)\nenv.agent_dir = 2\nx = other.thing\nself.count = 1\nenv._rand_int(0, 1)\n"
    )
    lines = set(expressions_in(source, inside=True))
    assert lines == {"u.grid.set(1, 1, None)", "u.grid.set", "u.grid", "u.agent_dir", "u.agent_dir = 2"}


def make_for_ppo_trxl(world_id):
    """CleanRL's line for Minigrid's worlds, but for the id."""
    env = gymnasium.make(world_id, agent_view_size=3, tile_size=28, render_mode="debug_rgb_array")
    return TimeLimit(ImgObsWrapper(RGBImgPartialObsWrapper(env, tile_size=28)), 96)


def test_the_environments_of_cleanrls_ppo_trxl_are_equal():
    ours, upstream = make_for_ppo_trxl("minihuman/MiniGrid-MemoryS9-v0"), make_for_ppo_trxl("MiniGrid-MemoryS9-v0")
    assert (ours.reset(seed=1)[0] == upstream.reset(seed=1)[0]).all()
    for action in (2, 2, 0, 1, 2, 2):
        mine, other = ours.step(action), upstream.step(action)
        assert (mine[0] == other[0]).all()
        assert mine[1:4] == other[1:4]
