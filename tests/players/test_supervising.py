"""A simulated teacher in whole sessions: it rates what an agent does and compares what was played."""

import numpy as np
import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import SimulationError
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.simulation.supervisor import SupervisorParameters, SupervisorParticipant, _parse_settings
from minihuman.worlds.adapters.world import World

WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
PROTOCOL = f"""
[study]
name = "said"
version = "1.0"
seed = 3
participants = 20

[keys]
pool = ["1", "2", "3"]

[[groups]]
name = "everyone"
parts = ["rate", "compare"]

[[blocks]]
name = "rate"
kind = "rating"
world = "{WORLD}"
episodes = 4
actions = ["left", "right", "forward"]
max_steps = 30
final_frame_ms = 2000
[blocks.agent]
step_ms = 700

[[activities]]
name = "compare"
kind = "preferences"
[activities.settings]
source = "rate"
pairs = 6
steps = 5
"""
SURE = "supervisor:critic_response_rate=1,critic_error_rate=0,rater_lapse=0,rater_beta=50"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("said")
    (folder / "said.toml").write_text(PROTOCOL)
    (path,) = simulate(read_protocol(folder / "said.toml"), folder, participants=1, player=SURE, seed=1)
    return read_log(path)


def left_after(seed, actions):
    """How many steps the way is after each of an episode's steps, the reset first."""
    world = World(WORLD)
    world.reset(seed)
    left = [len(world.shortest_path())]
    for action in actions:
        left.append(0 if world.step(int(action)).terminated else len(world.shortest_path()))
    return left


@pytest.mark.program
def test_a_simulated_critic_says_good_of_what_shortens_the_way_and_bad_of_the_rest(log):
    said = 0
    for episode in log.episodes:
        left = left_after(episode.plan.seed, episode.actions)
        shown_ns = {frame.step: frame.flip_ns for frame in reversed(list(episode.frames))}  # the first of each step
        for press in episode.taught.ratings:
            # a critic takes 300 ms at least and a second at most: what it has seen by then is one of two pictures
            seen = [step for step, flip_ns in shown_ns.items() if step and 0 < press.pressed_ns - flip_ns < 1.4e9]
            assert press.value in {1.0 if left[step - 1] > left[step] else -1.0 for step in seen}
            said += 1
    assert said >= 10
    answered = [e for e in log.episodes if e.outcome == "goal" and e.taught.ratings[-1].step == len(e.actions)]
    assert answered, "nobody said anything of the last picture"
    assert all(episode.taught.ratings[-1].value == 1 for episode in answered)


@pytest.mark.program
def test_a_simulated_rater_prefers_the_stretch_that_shortens_the_way_more(log):
    answers = set()
    for each in log.comparisons:
        gained = []
        for side in (each.left, each.right):
            left = left_after(side.seed, side.actions)
            gained.append(left[side.first] - left[-1])
        better = "equal" if gained[0] == gained[1] else "left" if gained[0] > gained[1] else "right"
        assert each.preference.answer == better
        answers.add(better)
    assert len(log.comparisons) == 6
    assert len(answers) > 1


def test_a_teacher_is_told_which_settings_it_has():
    with pytest.raises(SimulationError, match=r"no setting 'critic_rat'.*critic_response_rate"):
        SupervisorParticipant("critic_rat=1", np.random.default_rng(1))
    with pytest.raises(SimulationError, match=r"lapse is 2\.0"):
        SupervisorParticipant("rater_lapse=2", np.random.default_rng(1))


def test_earlier_names_of_the_supervisors_settings_are_read():
    old = "least_steps=1,knows_all=1,critic_rate=0.7,critic_mistakes=0.2,rater_equal_within=0.4"
    new = "min_control_steps=1,full_knowledge=1,critic_response_rate=0.7,critic_error_rate=0.2,rater_indifference=0.4"
    assert _parse_settings(old) == _parse_settings(new)
    assert SupervisorParameters(**_parse_settings(old)[""]) == SupervisorParameters(4, 1, full_knowledge=True)
