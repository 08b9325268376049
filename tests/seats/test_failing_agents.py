"""A lab's agent that crashes, has no answer or takes too long: the session goes on, and no step reads as its choice."""

from pathlib import Path

import pytest

from minihuman import plugins
from minihuman.activities.agent_blocks.events import ControlChanged, PolicyGiven
from minihuman.admin.verify.log import verify_session
from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.plugins import describe_failure
from minihuman.runtime.simulated_session import simulate
from tests.counts import PATIENCE_S
from tests.lab_package import install_lab as install_lab

STUDY = """
[study]
name = "fails"
version = "1"
seed = 4
participants = 3
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["take", "rate"]
[[blocks]]
name = "take"
kind = "takeover"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 8
episodes = 1
agent = { policy = "POLICY", step_ms = 400 }
[[blocks]]
name = "rate"
kind = "rating"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 8
episodes = 2
agent = { policy = "POLICY", step_ms = 400 }
"""
AGENTS = """
import signal
import time
import numpy as np
from minihuman.ext import BaseAgent

class Agent(BaseAgent):
    def __init__(self, argument):
        super().__init__(argument)
        if argument == "load":
            open("/home/somebody/weights.pt")

    def begin(self, plan, world):
        self.calls = 0
        if self.argument == "begin":
            open("/home/somebody/weights.pt")

    def action_probabilities(self, world):
        self.calls += 1
        good = np.zeros(len(world.action_names), np.float32)
        good[0] = 1
        if self.calls < 3:
            return good
        match self.argument:
            case "crash":
                return {}["/home/somebody/weights.pt"]
            case "none":
                return None
            case "nan":
                return good * np.nan
            case "short":
                return good[:2]
            case "hangs":
                assert 0 < signal.getitimer(signal.ITIMER_REAL)[0] <= PATIENCE_S
                signal.setitimer(signal.ITIMER_REAL, 0.01)  # its time is nearly over
                while True:
                    time.sleep(0.01)
""".replace("PATIENCE_S", str(PATIENCE_S))
UNPLAYABLE = "the policy gives no chance to any action that has a key"
FAILURES = {
    "load": ("the agent failed: FileNotFoundError", 0),
    "begin": ("the agent failed: FileNotFoundError", 0),
    "crash": ("the agent failed: KeyError", 2),
    "none": ("the agent failed: TypeError", 2),
    "nan": (UNPLAYABLE, 2),
    "short": (UNPLAYABLE, 2),
    "hangs": ("the agent failed: TimeoutError", 2),
}


@pytest.mark.parametrize(
    ("error", "described"),
    [
        (KeyError("/home/somebody/x"), "KeyError"),
        (LearnError("there is no lesson"), "LearnError: there is no lesson"),
        (LearnError("/home/some body of/x.pt: is no policy\n  at 3"), "LearnError: ... is no policy"),
        (LearnError("'C:\\\\Users\\\\me' and a/b: both are empty"), "LearnError: ... both are empty"),
    ],
)
def test_what_a_log_says_of_a_failure_has_no_path(error: Exception, described: str) -> None:
    assert describe_failure(error) == described


@pytest.mark.parametrize("how", FAILURES)
def test_an_agent_that_fails_is_named_and_nothing_plays_in_its_name(
    how: str, tmp_path: Path, install_lab, monkeypatch
) -> None:
    failure, steps = FAILURES[how]
    monkeypatch.setattr(plugins, "ANSWER_TIMEOUT_S", PATIENCE_S)  # a busy machine is no agent that hangs
    install_lab("lab", AGENTS, agents=["lab = a_lab:Agent"])
    protocol = decode_protocol(STUDY.replace("POLICY", f"lab:{how}").encode())
    [path] = simulate(protocol, tmp_path, participants=1, seed=1, player="random")
    log = read_log(path)
    assert log.end_reason == "complete"
    taken, *rated = log.episodes
    assert taken.outcome in ("goal", "timeout", "failure")  # the person played on
    assert [(episode.outcome, episode.end_cause) for episode in rated] == [("agent_failed", "agent_failed")] * 2
    assert [len(episode.actions) for episode in rated] == [steps] * 2
    control = [(event.who, event.reason) for event in log.part_events if isinstance(event, ControlChanged)]
    assert ("person", "no_policy" if how == "load" else "agent_failed") in control
    assert {event.failure for event in log.part_events if isinstance(event, PolicyGiven)} - {""} == {failure}
    assert b"somebody" not in path.read_bytes()
    assert [good for _, good in verify_session(path)] == [True]
    assert Selection().judge(log).reasons == ("", *["the agent failed"] * 2)
