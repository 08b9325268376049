"""Scripted partners: cooks that deliver soups, and two in a corridor."""

from types import SimpleNamespace

import numpy as np
import pytest

import minihuman
from minihuman.agents.team_agents import CookAgent, CorridorAgent
from minihuman.errors import SimulationError
from minihuman.worlds.adapters.world import World


def seat(team, number):
    """A team world as an agent in one seat gets it."""
    return SimpleNamespace(
        id="a team", action_names=team.action_names, unwrapped=SimpleNamespace(team=team, seat=number)
    )


def play(team, agents, seed=0):
    """What the team earned in one episode."""
    rng = np.random.default_rng(seed)
    team.reset(seed)
    seats = [seat(team, number) for number in range(team.bodies)]
    for agent, world in zip(agents, seats, strict=True):
        agent.begin(None, world)
    earned = np.zeros(team.bodies)
    while True:
        chances = [agent.action_probabilities(world) for agent, world in zip(agents, seats, strict=True)]
        assert all(abs(each.sum() - 1) < 1e-5 for each in chances)
        done = team.step([int(rng.choice(len(each), p=each / each.sum(dtype=np.float64))) for each in chances])
        earned += done.rewards
        if done.terminated or done.truncated:
            return earned, done.terminated


@pytest.mark.parametrize("rules", ["2019", "1.1.0"])
@pytest.mark.parametrize(
    "name", ["CrampedRoom", "AsymmetricAdvantages", "CoordinationRing", "ForcedCoordination", "CounterCircuit"]
)
def test_two_cooks_deliver_soups_in_every_kitchen(name, rules):
    team = minihuman.make_team(f"minihuman/Team-{name}-v0", rules=rules)
    earned, _ = play(team, [CookAgent(""), CookAgent("")])
    assert earned[0] >= 5 * (5 if rules == "2019" else 20)


@pytest.mark.parametrize("layout", ["cramped_room_tomato", "cramped_room_single", "soup_coordination"])
def test_a_cook_reads_the_orders(layout):
    team = minihuman.make_team("minihuman/Team-CrampedRoom-v0", layout=layout)
    earned, _ = play(team, [CookAgent("")] * team.bodies)
    assert earned[0] >= 60


@pytest.mark.parametrize(("one", "other", "passed"), [("", "", 8), ("yield", "insist", 4), ("insist", "insist", 0)])
def test_two_in_a_corridor_pass_if_one_gives_way(one, other, passed):
    """One who yields needs the bay on its own side: else it is the other's turn to give way."""
    ends = []
    for seed in range(4):
        for names in ((one, other), (other, one)):
            team = minihuman.make_team("minihuman/Team-SwapCorridor-v0")
            ends.append(play(team, list(map(CorridorAgent, names)), seed)[1])
    assert sum(ends) == passed


def test_a_partner_says_what_it_cannot_play():
    corridor, kitchen = (minihuman.make_team(f"minihuman/Team-{name}-v0") for name in ("SwapCorridor", "CrampedRoom"))
    for agent, team, why in (
        (CookAgent(""), corridor, "plays only in kitchens"),
        (CorridorAgent(""), kitchen, "is not a swap corridor"),
        (CorridorAgent("push"), corridor, "unknown behaviour 'push'"),
    ):
        with pytest.raises(SimulationError, match=why):
            agent.begin(None, seat(team, 0))


def test_a_cook_plays_a_seat_as_a_session_makes_it():
    world = World("minihuman/Team-CrampedRoom-v0", {"layout": "cramped_room_single", "seat": 0}, trusted=True)
    world.reset(0)
    agent, earned = CookAgent(""), 0.0
    agent.begin(None, world)
    for _ in range(200):
        earned += world.step(int(agent.action_probabilities(world).argmax())).reward
    assert earned >= 60
    world.close()
