"""Adaptive blocks in whole sessions: logged before the reset, asked again, continued after a cut, in the tables."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import verify_session
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.display.windows.window import VirtualClock
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import DesignDecided, EpisodesSkipped, EpisodeStarted
from minihuman.experiment.machine.inputs import Stop
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.dry_run import describe_plan
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay, resume_from_events
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.reporting.study_measures import add_measures
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.scripted import ObserverParticipant
from minihuman.testing import ContractError, check_participant
from minihuman.worlds.adapters.world import World
from tests.study.sessions import Desk, corridor_plan

PROTOCOL = Path(__file__).parents[2] / "protocols" / "trials" / "threshold.toml"
STAIRCASE = """
[blocks.design]
name = "staircase"
settings = { option = "start", values = [2, 1, 0], down = 1, stop_reversals = 2 }
"""


def play(desk: Desk, *, success: bool) -> int:
    """Play the next episode; where it started."""
    desk.pass_ms(1)
    desk.press("enter")
    start = desk.of(EpisodeStarted)[-1].plan.options["start"]
    desk.act(*(["forward"] * (3 - start) if success else ["dive"]))
    return start


@pytest.fixture(scope="module")
def stairs() -> Desk:
    """A block of eight episodes that the design ends after five."""
    desk = Desk(corridor_plan(episodes=8, more=STAIRCASE))
    desk.starts = [play(desk, success=won) for won in (True, True, True, False, True)]
    return desk


def test_a_design_chooses_each_episode_and_ends_the_block(stairs):
    assert stairs.starts == [2, 1, 0, 0, 1]
    decided = stairs.of(DesignDecided)
    assert [(one.episode, one.options.get("start"), one.stop) for one in decided] == [
        *((0, 2, False), (1, 1, False), (2, 0, False), (3, 0, False), (4, 1, False), (5, None, True)),
    ]
    order = [type(one) for one in stairs.events if isinstance(one, DesignDecided | EpisodeStarted)]
    assert order == [DesignDecided, EpisodeStarted] * 5 + [DesignDecided]
    [skipped] = stairs.of(EpisodesSkipped)
    assert (skipped.first, skipped.count, skipped.reason) == (5, 3, "design")
    assert [episode.options for episode in stairs.plan.episodes] == [{}] * 8  # open until the decision
    assert "  design staircase chooses each episode" in "\n".join(describe_plan(stairs.plan))


def test_verify_asks_again_and_names_a_decision_that_was_changed(stairs):
    assert list(compare_replay(stairs.events, World)) == []
    for change in ({"options": {"start": 1}}, {"posterior": 1}, {"estimates": {"reversals": 9.0}}, {"version": 2}):
        events = list(stairs.events)
        at = next(at for at, one in enumerate(events) if isinstance(one, DesignDecided) and one.episode == 3)
        events[at] = replace(events[at], **change)
        [difference] = compare_replay(events, World)
        assert f"DesignDecided: {next(iter(change))} " in difference
    events = list(stairs.events)
    at = next(at for at, one in enumerate(events) if isinstance(one, EpisodeStarted) and one.plan.episode == 3)
    events[at] = replace(events[at], plan=msgspec.structs.replace(events[at].plan, options={"start": 2}))
    [difference] = compare_replay(events, World)
    assert "EpisodeStarted: plan" in difference


def test_a_program_killed_between_episodes_goes_on_with_the_same_decision(stairs):
    at = next(at for at, one in enumerate(stairs.events) if isinstance(one, DesignDecided) and one.episode == 3)
    session, missing = resume_from_events(stairs.events[:at], World, picture_px=None)
    session.close()
    assert missing[0] == stairs.events[at]


def test_what_cannot_be_designed_is_refused_with_its_place():
    def errors(more: str) -> str:
        with pytest.raises(ProtocolError) as refused:
            corridor_plan(more=more)
        return str(refused.value)

    assert "is 'page', but a design resolves" in errors('computed = "page"' + STAIRCASE)
    wrong = errors('design = { name = "staircase", settings = { option = "start", values = [1] } }')
    assert "'staircase': settings: values has 1; give two or more" in wrong
    assert "design 'stairs' is unknown; it is one of" in errors('design = { name = "stairs" }')
    assert "must make a minihuman.experiment.plan.designs.Design" in errors('design = { name = "thompson" }')


def test_an_adaptive_block_is_computed_by_the_server_and_a_plain_plan_says_nothing_of_designs():
    plain, design = corridor_plan().protocol_toml.decode(), STAIRCASE.replace("start", "size")
    plain = plain.replace("tests.worlds.corridor:tests/Corridor-v0", "minihuman/MiniGrid-Empty-5x5-v0")
    plain = plain.replace('"back", "forward", "dive", "crash"', '"left", "forward"')
    for toml, computed in ((plain, "page"), (plain + design, "server")):
        protocol = decode_protocol(toml.encode())
        part = expand_protocol(protocol, enrol_participant(protocol, 0)).parts[0]
        assert part.plan.computed == computed
        assert (b"design" in msgspec.json.encode(part.plan)) == (computed == "server")


class CutWindow(SimulatedWindow):
    """Closes during the first text behind so many episodes."""

    def __init__(self, *given, episodes: int) -> None:
        super().__init__(*given)
        self._episodes = episodes

    def wait(self, until_ns):
        if self._session.next_episode >= self._episodes:
            return [Stop(self._clock(), "window_closed")]
        return super().wait(until_ns)


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> tuple[Path, list]:
    """A session of QUEST+ that was cut after five trials and went on, and both segments' plans."""
    data, toml = tmp_path_factory.mktemp("data"), PROTOCOL.read_bytes().replace(b"episodes = 40", b"episodes = 16")
    (file := data / "threshold.toml").write_bytes(toml)
    protocol, plans = read_protocol(file), []
    for episodes in (5, 99):
        plans.append(plan := plan_next_session(protocol, data, participant="sub-01"))
        clock, session = VirtualClock(), SessionMachine(plan, World, {"player": "observer"}, picture_px=None)
        player = ObserverParticipant("threshold=0.02,spread=0", np.random.default_rng(episodes))
        window = CutWindow(player, session, clock, episodes=episodes)
        run_session(session, window, McapRecorder(data, plan, started_ns=episodes * 10**12), clock)
    return data / "threshold", plans


def test_a_session_that_was_cut_goes_on_with_its_history_and_proves_itself(study):
    folder, (first, second) = study
    log = read_log(folder / "sub-01" / "ses-01")
    assert not first.standing.history
    assert [one.options for one in second.standing.history] == [one.plan.options for one in log.episodes[:5]]
    decided = [[one for one in part.part_events if isinstance(one, DesignDecided)] for part in log.segments]
    assert [len(its) for its in decided] == [6, 12]
    assert replace(decided[1][0], t_ns=0) == replace(decided[0][5], t_ns=0)
    assert decided[1][-1].stop
    assert list(verify_session(folder / "sub-01" / "ses-01")) == [("16 episodes, 16 steps, all as logged", True)]


def test_the_tables_have_each_decision_and_the_last_threshold_is_a_measure(study):
    folder, _ = study
    with StudyStore(StudySessions(folder, processes=1), with_shortest=False) as store:
        tables = {name: store.tables.table(name).to_pandas() for name in ("decisions", "blocks")}
    decisions = tables["decisions"]
    assert list(decisions["episode"]) == [*range(1, 7), *range(6, 18)]
    assert decisions["posterior"].str.fullmatch("[0-9a-f]{16}").all()
    assert decisions["stop"].tolist() == [False] * 17 + [True]
    found = add_measures(tables["blocks"], tables, ["design:threshold", "design:nothing"])
    [threshold] = found["design:threshold"]
    assert 0.01 < threshold < 0.04
    assert found["design:nothing"].isna().all()


def test_the_observer_keeps_the_contract_and_needs_a_correct_response():
    trial = {"correct": "left", "size": 0.05, "shape": "circle"}
    check_participant("observer:threshold=0.03", "minihuman/Stimulus-v0", trial, max_steps=1)
    with pytest.raises((ContractError, Exception), match="needs trials with a number above 0 in the option 'size'"):
        check_participant("observer", "minihuman/Stimulus-v0", {"size": 0.05}, max_steps=1)
