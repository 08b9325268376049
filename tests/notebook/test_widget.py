"""A world in a notebook's cell: played by real keys in Chromium, and back in Python as an episode that was replayed."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import pytest

import minihuman
from minihuman.errors import WorldError
from minihuman.notebook.cell_world import choose_keys, pack_cell_world
from minihuman.notebook.played_episodes import PlayedEpisodes
from minihuman.web.page_data.page_episodes import PageDataError
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import ObjectKind, door, goal, key
from tests.machine import needs
from tests.notebook.cell_page import list_errors, play_actions, read_played, show_cell
from tests.web.browser import browsing

PAGE = Path(__file__).parents[2] / "docs" / "play.md"

MUD = ObjectKind(
    "mud", "M", stepped_on=True, draw=lambda canvas, colour, state: canvas.fill(canvas.box(0, 0, 1, 1), colour)
)


class Muddy(GridWorld):
    """A lab's own world, with an object kind of its own."""

    kinds = (MUD,)

    def __init__(self, length=7, **options):
        super().__init__(width=length, height=5, max_steps=60, mission="get out", **options)

    def layout(self, grid):
        grid.wall_rect()
        x = grid.integer(3, grid.width - 2)
        grid.down(x, 1, 3)
        grid.put(door("red", locked=True), x, 2)
        grid.put(goal(), grid.width - 2, 2)
        grid.put(MUD("yellow"), grid.width - 2, 1)
        grid.place_agent(size=(x, grid.height))
        grid.place(key("red"), size=(x, grid.height))


gymnasium.register("lab/Muddy-v0", entry_point=Muddy, disable_env_checker=True, order_enforce=False)


def find_solution(world) -> list[str]:
    env = gymnasium.make(world.id, **world.options).unwrapped
    env.reset(seed=world.seeds[0])
    return [env.action_names[action] for action in env.shortest_path()]


def draw_docs_figure(episode) -> None:
    """Draw the person beside the policy, as the docs do."""
    (block,) = re.findall(r"```\n(import gymnasium\n\nperson = .*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names = {"cell": SimpleNamespace(episode=episode, save=lambda study: None)}
    exec(block, names)
    *_, policy = names["figure"].axes[0].lines
    assert len(policy.get_xdata()) == episode.steps + 1
    assert policy.get_xdata()[-1] == episode.path[-1][0]


@needs("chromium")
@pytest.mark.program
def test_an_episode_played_in_a_cell_comes_back_replayed(tmp_path):
    world = pack_cell_world("MiniGrid-DoorKey-5x5-v0", [5, 12345678901234567890 % 2**62])
    solution = find_solution(world)
    with browsing() as sit_down:
        person = sit_down("about:blank")
        show_cell(person.page, world)
        play_actions(person.page, world, solution)
        person.page.wait_for_function("window.saved")
        assert "Goal" in person.page.inner_text(".minihuman-status")
        person.page.get_by_text("Next").click()
        person.page.wait_for_function("document.body.innerText.includes('seed 3')")
        played = read_played(person.page)
        assert not list_errors(person)
    cell = PlayedEpisodes(world)
    cell.receive(played)
    (episode,) = cell.episodes
    assert episode.actions == tuple(solution)
    assert (episode.outcome, episode.world, episode.seed) == ("goal", "minihuman/MiniGrid-DoorKey-5x5-v0", 5)
    assert len(episode.frames()) == episode.steps + 1
    assert (episode.reaction_ms >= 0).all()
    draw_docs_figure(episode)
    log = cell.save(tmp_path / "mine")
    assert all(line.ok for line in minihuman.verify(tmp_path / "mine"))
    assert "imported from a page: consistent, not witnessed" in {line.text for line in minihuman.verify(log)}
    assert cell.save(tmp_path / "mine") is None
    assert minihuman.open_study(tmp_path / "mine").table("participants").evidence.tolist() == ["consistent"]


@needs("chromium")
@pytest.mark.program
@pytest.mark.parametrize(("world_id", "options"), [("MiniWorld-OneRoom-v0", {}), ("lab/Muddy-v0", {"length": 8})])
def test_first_person_and_own_worlds_are_played_too(world_id, options):
    world = pack_cell_world(world_id, [4], options=options)
    solution = find_solution(world)
    with browsing() as sit_down:
        person = sit_down("about:blank")
        show_cell(person.page, world)
        play_actions(person.page, world, solution)
        person.page.wait_for_function("window.saved")
        played = read_played(person.page)
        assert not list_errors(person)
    cell = PlayedEpisodes(world)
    cell.receive(played)
    assert cell.episodes[0].outcome == "goal"
    assert cell.episodes[0].actions == tuple(solution)


@needs("chromium")
@pytest.mark.program
def test_a_changed_episode_is_refused_and_named(tmp_path):
    world = pack_cell_world("MiniGrid-Empty-5x5-v0", [0])
    with browsing() as sit_down:
        person = sit_down("about:blank")
        show_cell(person.page, world)
        play_actions(person.page, world, find_solution(world))
        person.page.wait_for_function("window.saved")
        (columns,) = read_played(person.page)
    cell = PlayedEpisodes(world)
    for changes, error in [
        ({"actions": [1, *columns["actions"][1:]], "keys": ["ArrowRight", *columns["keys"][1:]]}, "step 1: digest"),
        ({"reward": 1.0}, "reward is 1.0, played again"),
        ({"seed": 1}, "layout 1 of 1"),
        ({"world": 3}, "Expected `str`"),
    ]:
        with pytest.raises(PageDataError, match=error):
            cell.receive([json.loads(json.dumps(columns | changes))])
    assert cell.episodes == ()
    with pytest.raises(PageDataError, match="nothing to save: play an episode to its end first"):
        cell.save(tmp_path / "mine")


def test_worlds_keys_and_views_that_no_cell_can_show_are_refused():
    for settings, error in [
        (
            {"world": "MiniGrid-Nowhere-v0"},
            "minihuman/MiniGrid-Nowhere-v0: Environment `MiniGrid-Nowhere`",
        ),
        (
            {"world": "MiniGrid-GoToObj-Transfer-v0"},
            "so no page computes it; play it with: minihuman play",
        ),
        ({"view": "above"}, "view is 'above'; it is 'partial' or 'full'"),
        ({"keys": {"f": "fly"}}, "key 'f' has action 'fly'; minihuman/MiniGrid-Empty-5x5-v0 has left, right"),
        ({"keys": {"€": "left"}}, "key '€' is none that a log can hold"),
        ({"seeds": []}, "seeds are \\[\\]; give one or more, each 0 or more"),
        ({"seeds": [-1]}, "seeds are \\[-1\\]"),
    ]:
        with pytest.raises(WorldError, match=error):
            pack_cell_world(**({"world": "MiniGrid-Empty-5x5-v0", "seeds": [0]} | settings))


def test_every_action_has_a_key_of_its_own():
    actions = ["left", "right", "forward", "pickup", "drop", "toggle", "done", "turn_left", "action_7"]
    keys = choose_keys(actions)
    assert list(keys.values()) == actions
    assert list(keys) == ["ArrowLeft", "ArrowRight", "ArrowUp", "p", "d", " ", "1", "2", "3"]
