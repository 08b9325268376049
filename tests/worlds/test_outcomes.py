"""What an end means is said by a rule that was stated; where none was, the episode has just ended."""

from pathlib import Path
from typing import Any

import gymnasium
import pytest

import tests.worlds.odd_ends  # noqa: F401 - registers the worlds
from minihuman.admin.verify.log import verify_session
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.plan.stated_outcomes import find_world_rule
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.words import LANGUAGES, load_words
from minihuman.log.read.session_reader import read_log
from minihuman.log.segment_schema import find_schema_version
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.outcome_table import GYMNASIUM_RULES, find_table_entry
from minihuman.worlds.adapters.world import World
from minihuman.worlds.outcomes import normalize_outcome_rule

STUDY = """
[study]
name = "ends"
version = "1"
seed = 1
participants = 2
[keys]
pool = ["1", "2", "3"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["play"]
[[blocks]]
name = "play"
world = "{world}"
episodes = 1
actions = {actions}
max_steps = {max_steps}
{more}
"""
ANY = 'success_at = "any"'


def study(world: str, more: str = "", *, actions: str = '["0"]', max_steps: int = 20) -> Protocol:
    text = STUDY.format(world=world, more=more, actions=actions, max_steps=max_steps)
    return decode_protocol(text.encode(), "ends.toml")


def plan_of(protocol: Protocol, **expansion: int) -> EpisodePlan:
    return expand_protocol(protocol, enrol_participant(protocol, 0), **expansion).episodes[0]


def ending(kind: str, more: str = "") -> Protocol:
    return study("tests/Ending-v0", f'options = {{ kind = "{kind}" }}\n{more}')


def play(plan: EpisodePlan, action: int = 0) -> RunningEpisode:
    world = World(plan.world, plan.options, trusted=True)
    episode = RunningEpisode(plan, world, picture_px=None)
    episode.start(0)
    while episode.outcome is None:
        episode.step(0, action, key="", key_t_ns=0)
    world.close()
    return episode


@pytest.mark.parametrize(
    ("kind", "more", "outcome"),
    [
        ("paid", "", "ended"),
        ("minus", "", "ended"),
        ("cut", "", "ended"),
        ("array", "", "goal"),
        ("array-false", "", "failure"),
        ("dictionary", "", "goal"),
        ("dictionary-of-two", "", "ended"),
        ("dictionary-of-two", 'success = "info:success.task"', "goal"),
        ("nested", 'success = "info:robot.task"', "goal"),
        ("nested", 'success = "info:robot.half"', "failure"),
        ("nested", 'success = "info:robot.third"', "ended"),
        ("never-terminates", "", "goal"),
        ("never-succeeds", "", "timeout"),
        ("half", "", "ended"),
        ("not-a-number", "", "ended"),
        ("vector", "", "ended"),
        ("text", "", "ended"),
        ("nothing", "", "ended"),
        ("first-key", "", "failure"),
        ("first-key", 'success = "info:success"', "goal"),
        ("passes", "", "failure"),
        ("passes", ANY, "goal"),
        ("minus", 'success = "terminated"', "goal"),
        ("cut", 'success = "terminated"', "timeout"),
        ("paid", 'success = "none"', "ended"),
        ("array", 'success = "none"', "ended"),
        ("paid", 'success = "return >= 1"', "goal"),
        ("minus", 'success = "return>=-1"', "goal"),
        ("minus", 'success = "return > -1"', "failure"),
        ("cut", 'success = "return >= 1"', "goal"),
        ("cut", 'success = "terminated and reward > 0"', "timeout"),
        ("paid", 'success = "reward > 0 and terminated"', "goal"),
    ],
)
def test_an_end_is_what_a_rule_says_or_just_an_end(kind: str, more: str, outcome: str) -> None:
    assert play(plan_of(ending(kind, more))).outcome == outcome


@pytest.mark.parametrize(
    ("world", "options", "outcome"),
    [
        ("tests/OwnGrid-v0", "{}", "goal"),
        ("tests/OwnGrid-v0", "{ reward = -1.0 }", "failure"),
        ("tests/OwnGrid-v0", "{ says = false }", "failure"),
        ("tests/OwnGrid-v0", "{ reward = 0.0, says = true }", "goal"),
        ("tests/OwnRoom-v0", "{}", "goal"),
        ("tests/OwnTeam-v0", "{ seat = 0 }", "goal"),
        ("tests/OwnTeam-v0", "{ seat = 1 }", "failure"),
        ("tests/SaidDuet-v0", "{ seat = 0 }", "goal"),
        ("tests/SaidDuet-v0", "{ seat = 1 }", "failure"),
        ("Duet-v0", "{ seat = 0, length = 0 }", "ended"),
    ],
)
def test_an_own_world_says_by_its_reward_what_its_info_does_not(world: str, options: str, outcome: str) -> None:
    names = World(world, {"seat": 0} if "seat" in options else {}, trusted=True).action_names
    protocol = study(world, f"options = {options}", actions=f'["{names[0]}"]')
    assert play(plan_of(protocol)).outcome == outcome


def test_a_fallen_pole_is_a_failure_and_one_that_stands_to_its_limit_a_goal() -> None:
    fallen = play(plan_of(study("CartPole-v1", max_steps=500)))
    assert (fallen.outcome, fallen.steps < 20) == ("failure", True)
    assert GYMNASIUM_RULES["CartPole-v1"].rule == "return >= 500"


@pytest.mark.parametrize(
    ("world", "rule"),
    [
        ("MountainCar-v0", "terminated"),
        ("gymnasium:Acrobot-v1", "terminated"),
        ("CliffWalking-v1", "terminated"),
        ("FrozenLake-v1", ""),
        ("CarRacing-v3", "terminated and info:lap_finished"),
        ("Ant-v5", "none"),
        ("ale_py:ALE/Pong-v5", "none"),
        ("ale_py:BreakoutNoFrameskip-v4", "none"),
        ("ALE/Tetris-v5", "none"),
        ("minigrid:MiniGrid-Empty-5x5-v0", ""),
        ("miniworld:MiniWorld-OneRoom-v0", ""),
        ("minihuman/MiniGrid-Empty-5x5-v0", ""),
        ("my_lab:CartPole-v1", "world"),
        ("my_lab:MiniGrid-Mine-v0", "world"),
        ("Flappy-v0", "world"),
    ],
)
def test_the_table_knows_a_world_only_by_its_own_package(world: str, rule: str) -> None:
    assert find_world_rule(world).rule == rule


@pytest.mark.parametrize(("rule", "outcome"), [("none", "ended"), ("terminated", "timeout"), ("reward < 0", "goal")])
def test_an_episode_that_a_time_limit_ends_is_proven_whatever_it_means(rule: str, outcome: str, tmp_path: Path) -> None:
    limited = study("MountainCar-v0", f'success = "{rule}"\nmax_episode_s = 3.0', actions='["left"]', max_steps=100)
    (log,) = simulate(limited, tmp_path, participants=1, seed=1, player="random")
    [episode] = read_log(log).episodes
    assert (episode.outcome, episode.end_cause) == (outcome, "max_s")
    assert [line for line, is_right in verify_session(log) if not is_right] == []


def test_the_table_has_every_environment_that_gymnasium_registers() -> None:
    own = {
        name
        for name, spec in gymnasium.registry.items()
        if str(spec.entry_point).startswith("gymnasium.envs") and find_table_entry(name) is None
    }
    assert own == set()


@pytest.mark.parametrize(
    ("success", "says"),
    [
        ("won", "has 'won', which is no condition"),
        ("return => 3", "has 'return => 3', which is no condition"),
        ("info:", "has 'info:', which is no condition"),
        ("world", "leave it out"),
        ("info:a and info:b", "name one key of info"),
        ("none and terminated", "has 'none', which is no condition"),
    ],
)
def test_a_rule_that_is_none_is_refused_with_the_field_and_an_example(success: str, says: str) -> None:
    with pytest.raises(ProtocolError, match="success") as error:
        ending("paid", f'success = "{success}"')
    assert says in str(error.value)
    assert "ends.toml:" in str(error.value)


def test_rules_that_mean_the_same_are_one() -> None:
    spellings = ("return >= 195", "return>=195.0", " return  >=  195 ")
    assert len({normalize_outcome_rule(text, at_any_step=False) for text in spellings}) == 1


def test_a_study_that_began_before_keeps_its_rule_unless_its_block_states_one() -> None:
    assert play(plan_of(ending("paid"), outcome_rules=0)).outcome == "goal"
    assert play(plan_of(ending("paid", 'success = "none"'), outcome_rules=0)).outcome == "ended"


def test_only_a_segment_whose_ends_an_older_reader_would_misread_has_the_new_schema() -> None:
    def schema(protocol: Protocol) -> int:
        return find_schema_version(expand_protocol(protocol, enrol_participant(protocol, 0)), {})

    grid: dict[str, Any] = {"actions": '["left"]'}
    assert schema(study("minihuman/MiniGrid-Empty-5x5-v0", **grid)) == 2
    assert schema(study("FrozenLake-v1")) == 2
    assert schema(ending("paid")) == 3
    assert schema(ending("paid", 'success = "reward > 0 and terminated"')) == 2


def test_every_language_says_that_the_episode_is_over() -> None:
    said = {language: load_words(language)["outcome.ended"] for language in LANGUAGES}
    assert said["en"] == "the episode is over"
    assert len(set(said.values())) == len(LANGUAGES)
