"""What Minigrid's users set and call on a world works here as there, or is refused with what to use."""

import copy
import pickle

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from minigrid.core.world_object import Ball, Lava
from minigrid.utils.baby_ai_bot import BabyAIBot

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.core.state import STEP
from minihuman.worlds.grid.env import GridEnv, GridWorld

pytestmark = pytest.mark.filterwarnings("ignore:.*out of date")


def both(name, **options):
    makes = (f"minihuman/{name}", name)
    return [gymnasium.make(world_id, disable_env_checker=True, **options) for world_id in makes]


def images_after(env, actions):
    return [env.step(action)[0]["image"].tolist() for action in actions]


def outcomes_after(env, actions):
    return [env.step(action)[1:4] for action in actions]


def find(world, kind):
    return next(cell for cell in world.grid.grid if cell is not None and cell.type == kind)


def clear_the_step_count(env):
    env.step(2)
    env.unwrapped.step_count = 0
    return env.unwrapped.step_count, outcomes_after(env, [0, 0, 0])


def shorten_the_episode(env):
    env.unwrapped.max_steps = 2
    ends = outcomes_after(env, [0, 0])
    env.reset(seed=4)
    return ends, env.unwrapped.max_steps, env.unwrapped.steps_remaining, outcomes_after(env, [0, 0])


def see_through_walls(env):
    env.unwrapped.see_through_walls = True
    seen = images_after(env, [0, 1, 1, 0])
    env.reset(seed=4)
    return seen, env.unwrapped.see_through_walls, images_after(env, [1])


def see_less(env):
    env.unwrapped.agent_view_size = 5
    seen = images_after(env, [0, 1, 2])
    return seen, env.unwrapped.agent_view_size, env.unwrapped.get_view_exts()


def draw_a_place_for_the_agent(env):
    world = env.unwrapped
    place = world.place_agent(top=(0, 0), size=(5, 6))
    where = tuple(map(int, place)), tuple(map(int, world.agent_pos)), int(world.agent_dir)
    return where, images_after(env, [2]), int(world.np_random.integers(1000))


def draw_places_for_things(env):
    world = env.unwrapped
    far = world.place_obj(Ball("red"), reject_fn=lambda env, place: sum(place) < 8)
    near = world.place_obj(Ball("green"), top=(-2, 1), size=(5, 4), max_tries=50)
    return tuple(map(int, far)), tuple(map(int, near)), world.grid.encode().tolist()


def build_walls(env):
    grid = env.unwrapped.grid
    grid.horz_wall(1, 4, 2)
    grid.vert_wall(5, 5, obj_type=Lava)
    grid.wall_rect(2, 2, 3, 3)
    return grid.encode().tolist(), images_after(env, [0])


def open_and_paint_the_door(env):
    door = find(env.unwrapped, "door")
    door.is_locked = False
    door.is_open = True
    door.color = "purple"
    seen = images_after(env, [0, 1]), door.encode(), door.can_overlap()
    door.is_open = False
    return seen, door.encode(), env.unwrapped.grid.encode().tolist()


def toggle_the_door_by_hand(env):
    world = env.unwrapped
    door, key = find(world, "door"), find(world, "key")
    place = next((x, y) for x in range(8) for y in range(8) if world.grid.get(x, y) is door)
    refused = door.toggle(world, place)
    world.carrying = key
    return refused, door.toggle(world, place), door.is_open, door.toggle(world, place), door.is_open


def keep_a_thing_in_hand(env):
    key = find(env.unwrapped, "key")
    env.unwrapped.carrying = key
    return env.unwrapped.carrying is key, key.color, key.can_pickup(), key.can_contain()


def keep_a_grid_and_a_copy(env):
    world = env.unwrapped
    grid, before = world.grid, world.grid.copy()
    before.set(1, 1, Ball("red"))
    world.put_obj(Ball("blue"), 1, 2)
    return grid == world.grid, before == world.grid, before.get(1, 1).color, before.get(1, 2) is None


EDITS = (
    clear_the_step_count,
    shorten_the_episode,
    see_through_walls,
    see_less,
    draw_a_place_for_the_agent,
    draw_places_for_things,
    build_walls,
    open_and_paint_the_door,
    toggle_the_door_by_hand,
    keep_a_thing_in_hand,
    keep_a_grid_and_a_copy,
)


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_does_what_it_does_in_minigrid(edit):
    ours, upstream = both("MiniGrid-DoorKey-8x8-v0")
    ours.reset(seed=3)
    upstream.reset(seed=3)
    assert edit(ours) == edit(upstream)


NAMES = {
    "MiniGrid-Dynamic-Obstacles-6x6-v0": ("n_obstacles", "agent_start_dir"),
    "MiniGrid-GoToObject-8x8-N2-v0": ("target_pos", "target_color", "targetType", "numObjs"),
    "MiniGrid-GoToDoor-6x6-v0": ("target_pos", "target_color"),
    "MiniGrid-PutNear-8x8-N3-v0": ("target_pos", "target_type", "target_color", "move_type", "moveColor"),
    "MiniGrid-MemoryS11-v0": ("success_pos", "failure_pos", "size", "random_length"),
    "MiniGrid-Fetch-8x8-N3-v0": ("targetType", "targetColor"),
    "MiniGrid-KeyCorridorS3R3-v0": ("room_size", "num_rows", "num_cols", "obj_type"),
    "BabyAI-GoToLocal-v0": ("surface", "room_size", "num_rows"),
    "MiniGrid-Empty-8x8-v0": ("reward_range", "agent_start_pos", "agent_start_dir", "steps_remaining"),
}


@pytest.mark.parametrize("name", NAMES)
def test_names_of_a_class_of_minigrids_read_the_same(name):
    ours, upstream = both(name)
    for seed in range(3):
        ours.reset(seed=seed)
        upstream.reset(seed=seed)
        for attribute in NAMES[name]:
            assert getattr(ours.unwrapped, attribute) == getattr(upstream.unwrapped, attribute), attribute


@pytest.mark.parametrize(
    ("name", "attributes"),
    [
        ("MiniGrid-RedBlueDoors-6x6-v0", ("red_door", "blue_door")),
        ("MiniGrid-Unlock-v0", ("door",)),
        ("MiniGrid-KeyCorridorS4R3-v0", ("obj",)),
    ],
)
def test_a_class_of_minigrids_names_the_same_things(name, attributes):
    ours, upstream = both(name)
    ours.reset(seed=5)
    upstream.reset(seed=5)
    for attribute in attributes:
        thing = getattr(ours.unwrapped, attribute)
        assert thing.encode() == getattr(upstream.unwrapped, attribute).encode()
        assert thing is ours.unwrapped.grid.get(*thing.cur_pos)


def test_obstacles_are_where_they_have_moved_to():
    ours, upstream = both("MiniGrid-Dynamic-Obstacles-8x8-v0")
    ours.reset(seed=1)
    upstream.reset(seed=1)
    obstacles = ours.unwrapped.obstacles
    for _ in range(5):
        ours.step(0)
        upstream.step(0)
        places = [tuple(map(int, ball.cur_pos)) for ball in upstream.unwrapped.obstacles]
        assert [ball.cur_pos for ball in obstacles] == places


def test_rooms_know_their_neighbours_and_doors():
    ours, upstream = both("MiniGrid-KeyCorridorS3R3-v0")
    ours.reset(seed=2)
    upstream.reset(seed=2)
    for column in range(3):
        for row in range(3):
            room, expected = (env.unwrapped.get_room(column, row) for env in (ours, upstream))
            assert (room.top, room.size, room.pos_inside(3, 3)) == (
                expected.top,
                expected.size,
                expected.pos_inside(3, 3),
            )
            doors = [door if door in (True, None) else door.encode() for door in room.doors]
            assert doors == [door if door in (True, None) else door.encode() for door in expected.doors]
            tops = [neighbour and neighbour.top for neighbour in room.neighbors]
            assert tops == [neighbour and neighbour.top for neighbour in expected.neighbors]
    assert ours.unwrapped.room_grid[1][2] == ours.unwrapped.get_room(2, 1)
    assert tuple(ours.unwrapped.place_agent(1, 1)) == tuple(map(int, upstream.unwrapped.place_agent(1, 1)))


def test_rooms_are_furnished_as_in_minigrid():
    answers = []
    for env in both("BabyAI-GoTo-v0"):
        env.reset(seed=6)
        world = env.unwrapped
        ball, place = world.add_object(0, 1, "ball", "red")
        drawn, _ = world.add_object(2, 2)
        more = world.add_distractors(1, 0, num_distractors=2) if world.num_dists < 18 else []
        several = world.add_distractors(num_distractors=3, all_unique=False)
        kinds = [thing.encode() for thing in (ball, drawn, *more, *several)]
        answers.append((kinds, tuple(map(int, place)), world.grid.encode().tolist(), int(world.np_random.integers(99))))
    assert answers[0] == answers[1]


REFUSED = (
    ("step_count", -1, "step_count is -1"),
    ("max_steps", 0, "max_steps is 0"),
    ("agent_view_size", 4, "agent_view_size"),
    ("width", 9, "give the size when the world is made"),
    ("front_pos", (1, 1), "set agent_pos or agent_dir"),
    ("grid", None, r"set its cells with grid\.set\(\)"),
    ("actions", None, "computed from the state"),
    ("steps_remaining", 5, "set step_count or max_steps"),
    ("instrs", None, "no attribute 'instrs' to set"),
    ("max_step", 5, "no attribute 'max_step' to set, so setting it would do nothing; attributes of your own belong to"),
    ("gen_obs", len, r"gen_obs\(\) of .* cannot be replaced"),
    ("window", None, "render_mode='human'"),
)


@pytest.mark.parametrize(("name", "setting", "message"), REFUSED)
def test_what_would_do_nothing_is_refused(name, setting, message):
    world = gymnasium.make("minihuman/MiniGrid-DoorKey-8x8-v0").unwrapped
    world.reset(seed=0)
    before = world.state_hash()
    with pytest.raises(WorldError, match=message):
        setattr(world, name, setting)
    assert world.state_hash() == before


def test_what_has_no_meaning_here_names_what_to_use():
    world = gymnasium.make("minihuman/MiniGrid-DoorKey-8x8-v0").unwrapped
    world.reset(seed=0)
    assert not hasattr(world, "instrs")
    with pytest.raises(AttributeError, match=r"'_rand_int'; draw with env\.unwrapped\.np_random"):
        world._rand_int(0, 3)
    with pytest.raises(AttributeError, match="write the layout of a GridWorld"):
        world.add_door(0, 0)
    door, key = find(world, "door"), find(world, "key")
    with pytest.raises(WorldError, match="is locked, so it cannot be open; set is_locked = False first"):
        door.is_open = True
    with pytest.raises(AttributeError, match="a key has no is_open to set"):
        key.is_open = True
    with pytest.raises(AttributeError, match=r"put_obj\(thing, column, row\)"):
        key.cur_pos = (1, 1)
    with pytest.raises(AttributeError, match="'init_pos'; read cur_pos right after reset"):
        _ = key.init_pos
    with pytest.raises(WorldError, match="a part of another; set cells of"):
        world.grid.slice(0, 0, 3, 3).set(1, 1, None)
    with pytest.raises(RecursionError, match="a larger rectangle"):
        world.place_obj(None, top=(0, 0), size=(1, 1), max_tries=10)


def test_a_view_shows_the_present_until_its_episode_is_gone():
    env = gymnasium.make("minihuman/MiniGrid-DoorKey-8x8-v0")
    env.reset(seed=0)
    door = find(env.unwrapped, "door")
    twin = find(env.unwrapped, "door")
    assert door is twin
    saved = env.unwrapped.save()
    door.is_locked = False
    assert not twin.is_locked
    env.reset(seed=1)
    assert not door.is_locked  # the last state of its episode
    assert find(env.unwrapped, "door") is not door
    env.unwrapped.restore(saved)
    assert find(env.unwrapped, "door").is_locked
    assert pickle.loads(pickle.dumps(env.unwrapped)).state_hash() == env.unwrapped.state_hash()
    assert copy.deepcopy(env.unwrapped).state_hash() == env.unwrapped.state_hash()


class Counted(GridWorld):
    """A world of one's own that uses Minigrid's names for itself."""

    kept = ("step_count", "visits")

    def __init__(self, **options):
        super().__init__(width=5, height=5, max_steps=6, mission="count", **options)
        self.goal_pos = (3, 3)

    def layout(self, grid):
        grid.wall_rect()
        grid.put_agent(1, 1)
        self.step_count, self.visits = 100, 0

    def reward_and_done(self, action, reward, terminated):
        self.step_count += 1
        self.visits += action == 2
        return reward, terminated


def test_a_world_of_ones_own_may_use_any_name():
    world = Counted()
    world.reset(seed=0)
    ends = [world.step(np.array([2]))[3] for _ in range(6)]
    assert (world.step_count, world.visits, world.goal_pos) == (106, 6, (3, 3))
    assert world.state.row[STEP] == 6
    assert ends == [False] * 5 + [True]
    world.anything = 1
    del world.step_count
    assert world.step_count == 6


@pytest.mark.parametrize("action", [np.array([2]), 2.0, np.array(2), np.float32(2), np.array([[2.0]])])
def test_an_action_may_be_an_array_of_one_or_a_whole_float(action):
    ours, upstream = both("MiniGrid-Empty-5x5-v0")
    ours.reset(seed=0)
    upstream.reset(seed=0)
    assert ours.step(action)[0]["image"].tolist() == upstream.step(action)[0]["image"].tolist()
    assert tuple(map(int, upstream.unwrapped.agent_pos)) == ours.unwrapped.agent_pos == (2, 1)
    assert ours.unwrapped.advance(action)[1:] == (False, False)


@pytest.mark.parametrize("action", [2.5, np.array([2, 2]), "2", None, [2], float("nan"), float("inf")])
def test_other_actions_are_refused(action):
    env = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0")
    env.reset(seed=0)
    with pytest.raises(WorldError, match="does not exist"):
        env.step(action)


def test_scripts_that_pass_a_screen_size_or_any_render_mode_get_their_world():
    env = gymnasium.make("minihuman/MiniGrid-MultiRoom-N6-v0", tile_size=8, screen_size=640, agent_pov=True)
    assert env.unwrapped.screen_size == 640
    with pytest.warns(UserWarning, match="debug_rgb_array"):  # Gymnasium's, of Minigrid's own world too
        env = gymnasium.make("minihuman/MiniGrid-MemoryS9-v0", agent_view_size=3, render_mode="debug_rgb_array")
    env.reset(seed=0)
    assert env.render().shape == (9 * 32, 9 * 32, 3)
    with pytest.raises(WorldError, match="render_mode is 3"):
        GridEnv("empty", render_mode=3)


@pytest.mark.parametrize("view", ["grid", "first_person"])
def test_the_human_mode_shows_every_reset_and_step_without_a_warning(view, monkeypatch, recwarn):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0", render_mode="human", view=view)
    shown = []
    drawn = env.unwrapped._rendered
    monkeypatch.setattr(type(env.unwrapped), "_rendered", lambda self: shown.append(1) or drawn())
    env.reset(seed=0)
    env.step(2)
    assert env.render() is None
    assert len(shown) == 3
    assert env.unwrapped.render_mode == "human"
    assert len(env.unwrapped.shortest_path()) == 4
    env.close()
    assert [warning for warning in recwarn if "render" in str(warning.message)] == []


def actions_of_bot(env, seed):
    env.reset(seed=seed)
    bot, actions, is_over = BabyAIBot(env), [], False
    while not is_over:
        actions.append(int(bot.replan(actions[-1] if actions else None)))
        *_, terminated, truncated, _ = env.step(actions[-1])
        is_over = terminated or truncated or len(actions) >= 300
    return actions


@pytest.mark.parametrize(
    ("name", "episodes"), [("BabyAI-GoToLocal-v0", 4), ("BabyAI-GoToSeqS5R2-v0", 1), ("BabyAI-PutNextLocalS5N3-v0", 2)]
)
def test_minigrids_bot_plays_the_same_actions(name, episodes):
    ours, upstream = both(name)
    for seed in range(episodes):
        assert actions_of_bot(ours, seed) == actions_of_bot(upstream, seed)
