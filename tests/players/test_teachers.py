import numpy as np
import pytest

from minihuman.errors import SimulationError
from minihuman.simulation.supervisor import (
    Critic,
    CriticParameters,
    Rater,
    RaterParameters,
    Supervisor,
    SupervisorParameters,
)
from minihuman.worlds.adapters.world import World

LEFT = 0


def watching(*, full_knowledge, patience=3):
    world = World("minihuman/MiniGrid-Empty-8x8-v0")
    world.reset(1)
    supervisor = Supervisor(
        SupervisorParameters(patience_steps=patience, full_knowledge=full_knowledge), np.random.default_rng(1)
    )
    supervisor.begin(world)
    return world, supervisor, supervisor.plan(world)


@pytest.mark.parametrize("full_knowledge", [True, False])
def test_an_agent_on_its_way_is_never_worse(full_knowledge):
    world, supervisor, way = watching(full_knowledge=full_knowledge)
    for _ in range(4):
        world.step(world.action_names.index(way[0]))
        way = supervisor.plan(world)
        assert supervisor.excess_steps == 0
        assert not supervisor.takes_over(1e9)


def test_an_agent_that_turns_in_circles_is_taken_over_after_a_human_delay():
    world, supervisor, _ = watching(full_knowledge=True)
    taken_ms = None
    for step in range(12):
        if supervisor.takes_over(600.0 * step):
            taken_ms = 600.0 * step
            break
        world.step(LEFT)
        supervisor.plan(world)
    assert supervisor.excess_steps >= 3
    assert taken_ms is not None
    assert taken_ms >= 600.0 * 3  # not before it is three steps worse, and not at once


def test_a_supervisor_steers_some_steps_before_it_hands_back():
    world, supervisor, way = watching(full_knowledge=True)
    while not (supervisor.takes_over(0.0) or supervisor.takes_over(1e9)):
        world.step(LEFT)
        way = supervisor.plan(world)
    handed = []
    for _ in range(4):
        world.step(world.action_names.index(way[0]))
        way = supervisor.plan(world)
        handed.append(supervisor.hands_back())
    assert handed == [False, False, False, True]
    assert supervisor.excess_steps == 0


def test_a_rater_says_what_is_better_but_for_its_lapses():
    rater = Rater(RaterParameters(beta=3, lapse=0.1), np.random.default_rng(1))
    answers = [rater.answer(0, 5) for _ in range(2000)]
    assert answers.count("left") / 2000 == pytest.approx(0.05, abs=0.015)
    noisy = Rater(RaterParameters(beta=1, lapse=0), np.random.default_rng(1))
    assert [noisy.answer(0, 1) for _ in range(2000)].count("right") / 2000 == pytest.approx(0.731, abs=0.03)
    assert Rater(RaterParameters(lapse=0, indifference=0.5), np.random.default_rng(1)).answer(1, 1.4) == "equal"


def test_a_critic_presses_after_its_delay_and_seldom():
    critic = Critic(CriticParameters(mu_ms=400, tau_ms=100, response_rate=0.3, error_rate=0), np.random.default_rng(1))
    presses = [critic.press(1 if step % 2 else -1, 1000.0) for step in range(4000)]
    made = [press for press in presses if press is not None]
    assert len(made) / 4000 == pytest.approx(0.3, abs=0.03)
    assert np.mean([t_ms - 1000 for t_ms, _ in made]) == pytest.approx(500, abs=10)
    assert all(press[1] == (1 if step % 2 else -1) for step, press in enumerate(presses) if press is not None)


def test_what_no_teacher_can_be_is_refused():
    with pytest.raises(SimulationError, match=r"lapse is 1\.5"):
        RaterParameters(lapse=1.5)
    with pytest.raises(SimulationError, match="rate is -1"):
        CriticParameters(response_rate=-1)
