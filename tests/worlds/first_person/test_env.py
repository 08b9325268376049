import copy
import math
import pickle

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.catalogue import FIRST_PERSON_WORLDS
from minihuman.worlds.first_person.entities import Ball, Box
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.rules import COUNT, MOVES

IDS = [entry.id for entry in FIRST_PERSON_WORLDS]


def make(name, **options):
    return gymnasium.make(f"minihuman/MiniWorld-{name}-v0", obs_width=8, obs_height=6, **options).unwrapped


def test_without_a_step_limit_an_arrival_is_never_late():
    env = make("OneRoom", max_steps=None)
    env.reset(seed=0)
    env.agent.pos = env.box.pos
    _, reward, terminated, truncated, _ = env.step(0)
    assert (reward, terminated, truncated) == (1.0, True, False)


def play(env, steps, seed=0):
    """Hashes after each of some random actions."""
    rng = np.random.default_rng(seed)
    hashes = []
    for _ in range(steps):
        if any(env.step(int(rng.integers(env.action_space.n)))[2:4]):
            env.reset()
        hashes.append(env.state_hash())
    return hashes


@pytest.mark.parametrize("world", IDS)
def test_a_world_saved_pickled_or_copied_in_mid_episode_goes_on_the_same(world):
    env = gymnasium.make(world, obs_width=8, obs_height=6, domain_rand="Sign" not in world).unwrapped
    env.reset(seed=3)
    play(env, 40)
    saved, pickled, copied = env.save(), pickle.loads(pickle.dumps(env)), copy.deepcopy(env)
    shown = env.picture(size_px=(16, 12))
    onwards = play(env, 40, seed=1)
    for other in (pickled, copied):
        assert np.array_equal(other.picture(size_px=(16, 12)), shown)
        assert play(other, 40, seed=1) == onwards
    env.restore(pickle.loads(pickle.dumps(saved)))
    assert play(env, 40, seed=1) == onwards
    env.restore(saved)
    assert play(env, 40, seed=1) == onwards


def test_what_is_carried_is_still_carried_after_a_restore():
    env = make("PutNext")
    env.reset(seed=0)
    env.agent.carrying = env.red_box
    env.step(0)
    saved = env.save()
    env.step(env.action_names.index("drop"))
    assert env.agent.carrying is None
    env.restore(saved)
    assert env.agent.carrying is env.red_box
    assert env.red_box in env.entities


def test_a_kit_that_was_placed_again_is_on_the_stage_each_time():
    env = make("CollectHealth", trig=1)
    env.reset(seed=0)
    kit = env.entities[0]
    for _ in range(3):  # from the second time on, it comes back to where it was in the list of things
        env.agent.carrying = kit
        env.step(env.action_names.index("pickup"))
        assert env.health == 100
        assert env.agent.carrying is None
        env.step(env.action_names.index("turn_left"))
        assert env.flat_state().numbers[COUNT] == len(env.entities)


def test_sixteen_worlds_in_one_process_are_each_as_they_are_alone():
    ids = IDS[:16]

    def picture(env, step):
        seen, _, terminated, truncated, _ = env.step(step % env.action_space.n)
        return env.reset()[0] if terminated or truncated else seen

    def pictures(env, steps):
        return [picture(env, step) for step in range(steps)]

    def flat(seen):
        return [frame["obs"] if isinstance(frame, dict) else frame for frame in seen]

    alone = []
    for number, world in enumerate(ids):
        env = gymnasium.make(world, obs_width=16, obs_height=12)
        env.reset(seed=number)
        alone.append(flat(pictures(env, 5)))
    together = [gymnasium.make(world, obs_width=16, obs_height=12) for world in ids]
    for number, env in enumerate(together):
        env.reset(seed=number)
    seen = [[] for _ in together]
    for step in range(5):
        for frames, env in zip(seen, together, strict=True):
            frames += flat([picture(env, step)])
    assert all(np.array_equal(a, b) for a, b in zip(alone, seen, strict=True))


def test_drawing_changes_no_state():
    env = make("FourRooms")
    env.reset(seed=1)
    env.step(2)
    before = env.state_hash()
    env.picture(size_px=(32, 24))
    env.picture(view="full", size_px=(32, 24), palette="colour-safe")
    env.depth(size_px=(32, 24))
    env.visible_entities()
    assert env.state_hash() == before


def test_the_map_has_the_walls_and_the_things_but_not_the_agent():
    env = make("FourRooms")
    env.reset(seed=0)
    plan = env.map()
    assert plan.unit == "m"
    assert plan.bounds == (-7, -7, 7, 7)
    assert len(plan.walls) == len(env.stage.floor.walls)
    (thing,) = plan.things
    assert thing.name == "red box"
    assert (thing.x, thing.z) == (env.box.pos[0], env.box.pos[2])
    assert thing.colour == "#ff0000"


def test_the_limit_of_steps_truncates_and_does_not_terminate():
    env = make("FourRooms", max_steps=2)
    env.reset(seed=0)
    assert env.step(0)[2:4] == (False, False)
    assert env.step(0)[2:4] == (False, True)


def test_the_red_box_is_in_view_when_the_agent_faces_it():
    env = make("OneRoom")
    env.reset(seed=0)
    x, _, z = env.box.pos
    env.agent.pos, env.agent.dir = (x - 3.0, 0.0, z), 0.0
    assert env.visible_entities() == [env.box]
    env.agent.dir = np.pi
    assert env.visible_entities() == []


def test_a_ball_is_shown_in_the_colour_of_the_palette():
    env = Odd(lambda env: (room(env), env.place_entity(Ball("red"), pos=(3.4, 0, 2)), env.place_agent(pos=(0.6, 0, 2))))
    env.reset(seed=0)
    env.agent.dir = 0.0
    classic, safe = (env.picture(size_px=(40, 30), palette=palette) for palette in ("classic", "colour-safe"))
    changed = (classic != safe).any(axis=2)
    assert changed.sum() > 10
    red, orange = np.median(classic[changed], axis=0), np.median(safe[changed], axis=0)
    assert red[1] == 0
    assert 0.3 < orange[1] / orange[0] < 0.7
    assert orange[2] == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"max_steps": 0}, "max_steps is 0"),
        ({"view": "side"}, "view is 'side'"),
        ({"obs_width": 0}, "obs_width is 0; it must be a whole number from 1 to 4096"),
    ],
)
def test_a_wrong_option_is_named(options, said):
    with pytest.raises(WorldError, match=said):
        gymnasium.make("minihuman/MiniWorld-FourRooms-v0", **options)


def test_misuse_in_play_is_named():
    env = gymnasium.make("minihuman/MiniWorld-FourRooms-v0")
    for call in (lambda: env.step(0), lambda: env.unwrapped.picture(), lambda: env.unwrapped.state_hash()):
        with pytest.raises(WorldError, match="has not been reset"):
            call()
    env.reset(seed=0)
    with pytest.raises(WorldError, match="action is 3; it must be a whole number, 0 to 2"):
        env.step(3)
    other = make("Hallway")
    other.reset(seed=0)
    with pytest.raises(WorldError, match="was not saved by a FourRooms"):
        env.unwrapped.restore(other.save())


class Odd(FirstPersonEnv):
    def __init__(self, build):
        self._build = None
        self.steps_of_build = build
        super().__init__(actions=MOVES, obs_width=4, obs_height=3)

    def build(self):
        self.steps_of_build(self)


def room(env, **looks):
    return env.add_rect_room(min_x=0, max_x=4, min_z=0, max_z=4, **looks)


def two_rooms(env, *openings, **height):
    a, b = room(env), env.add_rect_room(min_x=5, max_x=9, min_z=0, max_z=4)
    for opening in openings:
        env.connect_rooms(a, b, **dict(zip(("min_z", "max_z", "min_x"), opening, strict=False)), **height)


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda env: None, "has no room"),
        (room, "placed no agent"),
        (lambda env: env.add_room(((0, 0), (1, 0))), "fewer than 3 corners"),
        (lambda env: env.add_room(((0, 0), (4, 0), (4, 4), (0, 4))), "counter-clockwise"),
        (lambda env: env.add_room(((0, 0), (0, 0), (4, 4))), "twice in a row"),
        (lambda env: env.add_rect_room(min_x=1, max_x=1, min_z=0, max_z=4), "has no area"),
        (lambda env: env.connect_rooms(room(env), room(env), min_x=0, max_x=1), "No wall|no wall"),
        (
            lambda env: env.connect_rooms(
                room(env), env.add_rect_room(min_x=5, max_x=9, min_z=0, max_z=4), min_z=1, max_z=5
            ),
            "does not fit in the wall",
        ),
        (
            lambda env: env.connect_rooms(
                room(env), env.add_rect_room(min_x=5, max_x=9, min_z=0, max_z=4), min_x=1, max_x=2
            ),
            "has a single x",
        ),
        (lambda env: two_rooms(env, (1, 3), (2, 3.5)), "from 0.5 to 2 m .* overlaps the one from 1 to 3 m"),
        (lambda env: two_rooms(env, (1, 3), max_y=3), "portal is 3 m high; it must be above 0 and at most .* 2.74 m"),
        (lambda env: two_rooms(env, (1, 3), max_y=0), "portal is 0 m high"),
        (lambda env: two_rooms(env, (3, 1.5, 2)), "give min_x and max_x, or min_z and max_z"),
        (lambda env: room(env, wall_height=-1), "wall_height is -1 m"),
        (lambda env: env.add_room(((0, 0), (0, 4), (math.nan, 4))), "no finite length"),
        (lambda env: env.add_room(((0, 0), (0, 4), (4, 4), (1, 2))), "turns right"),
        (lambda env: (room(env), env.place_entity(Box("red", 9.0))), "no free place for red box"),
        (lambda env: (room(env), env.place_entity(Box("pink"))), "unknown colour 'pink'"),
        (lambda env: (room(env), env.place_entity(Box("red"), pos=(1, 0, 1)), room(env)), "floor plan is fixed"),
    ],
)
def test_a_world_that_cannot_be_built_says_why(build, said):
    with pytest.raises(WorldError, match=said):
        Odd(build).reset(seed=0)


def test_a_picture_on_the_way_is_the_earlier_one_at_its_start_and_this_one_at_its_end_and_changes_nothing():
    env = make("PutNext", trig=1)
    other = make("PutNext", trig=1)
    rng, carried = np.random.default_rng(3), 0
    for each in (env, other):
        each.reset(seed=4)
    for _ in range(300):
        before, earlier, held = env.pose(), env.picture(size_px=(80, 60)), env.agent.carrying
        action = int(rng.choice([0, 1, 2, 2, 2, 4]))
        (seen, _, goal, late, _), (also, *_) = (each.step(action) for each in (env, other))
        np.testing.assert_array_equal(seen, also)
        now, state = env.picture(size_px=(80, 60)), env.state_hash()
        if env.agent.carrying is held:
            np.testing.assert_array_equal(env.picture_between(before, 0.0, size_px=(80, 60)), earlier)
        between = env.picture_between(before, 0.5, size_px=(80, 60))
        if env.pose() != before:
            assert (between != now).any()
        np.testing.assert_array_equal(env.picture_between(before, 1.0, size_px=(80, 60)), now)
        assert env.state_hash() == state == other.state_hash()
        carried += env.agent.carrying is not None
        if goal or late:
            _ = [each.reset(seed=carried) for each in (env, other)]
    assert carried > 0
