import math
from itertools import pairwise

import numpy as np
import pytest

from minihuman.display.windows.window import VirtualClock
from minihuman.errors import SimulationError
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import EpisodeEnded, EpisodeStarted, KeyPressed, Stepped
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.human_like import HumanLikeParticipant, ParticipantParameters, ParticipantPopulation
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from minihuman.worlds.grid.core.cells import EMPTY, GOAL

GRID = "minihuman/MiniGrid-FourRooms-v0"
ROOMS = "minihuman/MiniWorld-FourRooms-v0"
MOVES = {GRID: ["left", "right", "forward"], ROOMS: ["turn_left", "turn_right", "move_forward"]}


STUDY = """
[study]
name = "trial"
version = "1"
seed = 5
[[groups]]
name = "all"
blocks = {blocks}
"""
BLOCK = """
[[blocks]]
name = {name!r}
world = {world!r}
episodes = {episodes}
actions = {actions}
max_steps = 250
key_map = {key_map!r}
view = {view!r}
"""
NO_ERRORS = "lapse=0,wrong_turn=0,judgement_sd_steps=0,forgetting_rate_per_s=0,key_forgetting=0"
PLAIN_TIMES = "practice=0,repeat_factor=1,orientation_ms=0,post_error_slowing_ms=0,fatigue=0"


def a_plan(*blocks: dict[str, object]):
    toml = STUDY.format(blocks=[block["name"] for block in blocks])
    protocol = decode_protocol(
        (toml + "".join(BLOCK.format(**{"view": "partial"} | block) for block in blocks)).encode()
    )
    return expand_protocol(protocol, enrol_participant(protocol, 0))


def one_block(world: str, episodes: int, *, key_map: str = "fresh", view: str = "partial"):
    block = {"name": "only", "world": world, "episodes": episodes, "key_map": key_map, "view": view}
    return a_plan(block | {"actions": MOVES.get(world, ["0", "1"])})


def two_blocks(key_map: str):
    both = {"world": GRID, "episodes": 4, "actions": MOVES[GRID]}
    return a_plan({"name": "first", "key_map": "fresh", **both}, {"name": "second", "key_map": key_map, **both})


def second_block(events) -> list[KeyPressed]:
    starts = [
        place for place, event in enumerate(events) if isinstance(event, EpisodeStarted) and event.plan.block == 1
    ]
    return [event for event in events[starts[0] :] if isinstance(event, KeyPressed)]


def played(player: str, plan, seed: int = 0):
    clock, recorder = VirtualClock(), MemoryRecorder()
    session = SessionMachine(plan, World, {}, picture_px=None)
    window = SimulatedWindow(make_participant(player, np.random.default_rng(seed)), session, clock)
    run_session(session, window, recorder, clock)
    assert find_violations(recorder.events) == []
    return recorder.events


def steps_an_episode(events) -> list[int]:
    return [event.steps for event in events if isinstance(event, EpisodeEnded)]


def outcomes(events) -> set[str]:
    return {event.outcome for event in events if isinstance(event, EpisodeEnded)}


@pytest.mark.parametrize(("world", "episodes"), [(GRID, 5), (ROOMS, 2)])
def test_the_optimal_player_takes_the_shortest_way(world, episodes):
    plan = one_block(world, episodes)
    events = played("optimal", plan)
    assert outcomes(events) == {"goal"}
    for episode, steps in zip(plan.episodes, steps_an_episode(events), strict=True):
        fresh = World(episode.world)
        fresh.reset(episode.seed)
        assert steps == len(fresh.shortest_path())


@pytest.mark.parametrize("player", ["optimal", "random", "human-like"])
def test_the_same_seed_plays_the_same_keys_at_the_same_times(player):
    plan = one_block(GRID, 2)
    assert played(player, plan, seed=4) == played(player, plan, seed=4)


@pytest.mark.parametrize("player", ["random", "human-like"])
def test_another_seed_plays_otherwise(player):
    plan = one_block(GRID, 2)
    assert played(player, plan, seed=4) != played(player, plan, seed=5)


def test_a_random_player_uses_every_key_that_does_something_and_no_other():
    plan = one_block(GRID, 2)
    keys = {event.key for event in played("random", plan) if isinstance(event, Stepped)}
    assert keys == set(plan.episodes[0].key_map.keys)


def test_a_person_has_to_find_the_keys_that_are_not_shown():
    def keys_before_the_first_step(key_map: str) -> int:
        events = played(f"human-like:{NO_ERRORS}", one_block(GRID, 1, key_map=key_map))
        return sum(getattr(event, "verdict", "") == "spare" for event in events)

    assert keys_before_the_first_step("fresh") > 0
    assert keys_before_the_first_step("shown") == 0


def test_a_person_who_knows_the_keys_sees_everything_and_never_errs_is_optimal():
    plan = one_block(GRID, 4, key_map="shown", view="full")
    assert steps_an_episode(played(f"human-like:{NO_ERRORS}", plan)) == steps_an_episode(played("optimal", plan))


def test_a_person_reaches_the_goal_in_more_steps_than_it_takes():
    plan = one_block(GRID, 10)
    person, best = played("human-like", plan), played("optimal", plan)
    assert "goal" in outcomes(person)
    assert sum(steps_an_episode(person)) > sum(steps_an_episode(best))


def reaction_times(events) -> dict[int, list[float]]:
    found: dict[int, list[float]] = {}
    for event in events:
        if isinstance(event, Stepped) and event.rt_ms is not None:
            found.setdefault(event.episode, []).append(event.rt_ms)
    return found


def test_a_person_gets_faster_with_practice():
    plan = one_block(GRID, 20, key_map="shown")
    rts = reaction_times(played("human-like:repeat_factor=1,orientation_ms=0", plan))
    early, late = (np.mean(np.concatenate([rts[episode] for episode in which])) for which in (range(2), range(17, 20)))
    assert late < 0.85 * early


def test_nobody_reacts_faster_than_people_can():
    rts = reaction_times(played("human-like:mu_ms=100,tau_ms=20", one_block(GRID, 5)))
    assert min(map(min, rts.values())) >= 150


def test_the_same_key_again_takes_less_time_than_another():
    again, other = [], []
    for person in range(3):
        events = played("human-like", one_block(GRID, 5), seed=person)
        for before, event in pairwise(event for event in events if isinstance(event, Stepped)):
            (again if event.key == before.key else other).append(event.rt_ms)
    assert np.median(again) < 0.8 * np.median(other)


def test_reaction_times_have_the_mean_that_was_asked_for():
    """Parameter recovery in the small: mu + tau, of everybody and without practice."""
    plan = one_block(GRID, 30, key_map="shown")
    events = played(f"human-like:mu_ms=400,sigma_ms=40,tau_ms=100,{PLAIN_TIMES}", plan)
    rts = [event.rt_ms for event in events if isinstance(event, Stepped)]
    assert abs(np.mean(rts) - 500) < 4 * np.hypot(40, 100) / np.sqrt(len(rts))


def test_people_differ_and_without_a_spread_they_do_not():
    def people(argument: str) -> set[ParticipantParameters]:
        return {HumanLikeParticipant(argument, np.random.default_rng(seed)).person for seed in range(5)}

    assert len(people("")) == 5
    assert people("spread=0") == {ParticipantParameters()}
    assert {person.lapse for person in people("lapse=0.1")} == {0.1}


def keys_until_it_is_seen(world_id: str, move_goal, seed: int) -> tuple[list[str], list[str]]:
    """Two worlds that differ in where the goal is, and the keys in each until their pictures differ."""
    one, other = World(world_id), World(world_id)
    for world in (one, other):
        world.reset(seed)
    move_goal(other.unwrapped)
    plan = one_block(world_id, 1).episodes[0]
    players = [HumanLikeParticipant("", np.random.default_rng(seed)) for _ in range(2)]
    keys: tuple[list[str], list[str]] = [], []
    for player, world in zip(players, (one, other), strict=True):
        player.begin(plan, tuple("123456789"), world)
    for _ in range(90):
        if not np.array_equal(one.frame(), other.frame()):
            return keys
        for player, world, pressed in zip(players, (one, other), keys, strict=True):
            pressed.append(player.press(world).key)
            action = plan.key_map.keys.get(pressed[-1])
            if action is not None:
                world.step(world.action_names.index(action))
    return keys


def far_off_in_the_grid(env) -> None:
    state = env.state
    (goal,) = np.argwhere(state.kinds == GOAL)
    code = int(state.cells[tuple(goal)])
    free = [cell for cell in np.argwhere(state.kinds == EMPTY) if np.abs(cell - state.position).sum() > 14]
    state.cells[tuple(goal)], state.cells[tuple(free[0])] = int(state.cells[tuple(free[0])]), code


def far_off_in_rooms(env) -> None:
    x, _, z = env.agent.pos
    env.box.pos = (math.copysign(4.0, -x), 0.0, math.copysign(4.2, -z))


@pytest.mark.parametrize(("world", "move_goal"), [(GRID, far_off_in_the_grid), (ROOMS, far_off_in_rooms)])
def test_of_a_goal_that_was_not_in_view_a_person_knows_nothing(world, move_goal):
    pressed = 0
    for seed in range(4):
        here, there = keys_until_it_is_seen(world, move_goal, seed)
        assert here == there
        pressed += len(here)
    assert pressed > 40  # the test could see something


@pytest.mark.parametrize(("key_map", "searches"), [("carry", False), ("fresh", True)])
def test_a_person_searches_for_keys_again_only_where_they_are_new(key_map, searches):
    plan = two_blocks(key_map)
    searched = {
        event.phase == "playing" and event.verdict == "spare"
        for event in second_block(played(f"human-like:{NO_ERRORS}", plan))
    }
    assert (True in searched) == searches


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("clairvoyant", "player 'clairvoyant' is unknown; it is one of"),
        ("human-like:speed=9", "no setting 'speed'; use mu_ms"),
        ("human-like:lapse=often", "setting lapse is 'often'; use a number"),
        ("human-like:lapse=2", "use a probability from 0 to 1"),
        ("human-like:tau_ms=-1", "use 0 or more"),
        ("human-like:tau_ms=inf", "use 0 or more"),
        ("human-like:wrong_turn_steps=0", "use 1 or more"),
    ],
)
def test_a_player_that_cannot_be_says_why(name, said):
    with pytest.raises(SimulationError, match=said):
        make_participant(name, np.random.default_rng(0))


def test_a_persons_parameters_are_read_from_its_name():
    assert ParticipantPopulation.parse("lapse=0.1,tau_ms=300").median == ParticipantParameters(lapse=0.1, tau_ms=300.0)


def test_the_optimal_player_refuses_a_world_that_has_no_planner():
    with pytest.raises(SimulationError, match="has no planner"):
        played("optimal", one_block("CartPole-v1", 1))


def test_earlier_names_of_parameters_are_read():
    old = "astray=0.1,detour_steps=2,misjudge=3,forget=0.01,forget_keys=0.2,repeat=0.7,post_error_ms=5,orient_ms=6"
    new = (
        "wrong_turn=0.1,wrong_turn_steps=2,judgement_sd_steps=3,forgetting_rate_per_s=0.01,key_forgetting=0.2,"
        "repeat_factor=0.7,post_error_slowing_ms=5,orientation_ms=6"
    )
    assert ParticipantPopulation.parse(old) == ParticipantPopulation.parse(new) != ParticipantPopulation()
