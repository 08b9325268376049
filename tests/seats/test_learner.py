"""The learner's process: slow, hung, killed, out of memory, or talking nonsense, a session goes on with what it has."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from minihuman.activities.agent_blocks.events import LearnerAsked, PolicyGiven
from minihuman.activities.clip_requests import ClipRequest
from minihuman.admin.policies import PolicyStore
from minihuman.admin.verify.log import verify_session
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime import learner_process
from minihuman.runtime.agent_host import N_CANDIDATE_PAIRS, AgentHost
from minihuman.runtime.clip_sampler import ClipSampler
from minihuman.runtime.learner_process import LearnerProcess, LearnerRequest
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.machine import needs

pytestmark = pytest.mark.program
TAUGHT = Path(__file__).parents[1] / "golden" / "v1" / "taught"

READ = "import json, os, signal, sys, time\nfor line in sys.stdin:\n    asked = json.loads(line)\n"
WORKERS = {
    "hung": READ + "    time.sleep(600)",
    "killed": READ + "    os.kill(os.getpid(), signal.SIGKILL)",
    "gone": "raise SystemExit(3)",
    "out of memory": READ + "    print(json.dumps({'file': '', 'failure': 'MemoryError: '}), flush=True)",
    "nonsense": READ + "    print('Segmentation fault', flush=True)",
    "no file": READ + "    print(json.dumps({'file': '/nowhere/policy.pt', 'failure': ''}), flush=True)",
    "no policy": READ + "    print(json.dumps({'file': sys.argv[0], 'failure': ''}), flush=True)",
}
SAID = {
    "hung": "took too long",
    "killed": "died (signal 9)",
    "gone": "died (exit status 3)",
    "out of memory": "MemoryError",
    "nonsense": "Segmentation fault",
    "no file": "cannot be kept",
    "no policy": "is not a policy file",
}
TOML = """
[study]
name = "taught"
version = "1"
seed = 5
closing = ""
[keys]
pool = ["1", "2", "3"]
keyboard_check = false
[[groups]]
name = "everyone"
blocks = ["teach"]
[[blocks]]
name = "teach"
kind = "takeover"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 4
actions = ["left", "right", "forward"]
max_steps = 20
[blocks.agent]
policy = "random"
learner = "any"
budget_s = {budget_s}
wait_s = 5
"""


def worker(tmp_path, kind):
    script = tmp_path / "worker.py"
    script.write_text(WORKERS[kind])
    return LearnerProcess([str(script)])


def first_answer_s(kind: str) -> float:
    """How long a worker has for its first answer: a busy machine is no worker that hangs."""
    return 3.0 if kind == "hung" else PATIENCE_S


KINDS = [pytest.param(kind, marks=needs("learn")) if kind == "no policy" else kind for kind in WORKERS]


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_becomes_of_the_learner_every_episode_is_played_and_nothing_is_lost(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(learner_process, "FIRST_ANSWER_TIMEOUT_S", first_answer_s(kind))
    protocol = decode_protocol(TOML.format(budget_s=0.2).encode())
    plan, clock = expand_protocol(protocol, enrol_participant(protocol, 0)), VirtualClock()
    session = SessionMachine(plan, World, {}, picture_px=None)
    recorder = McapRecorder(tmp_path, plan, started_ns=0)
    seat = AgentHost(
        PolicyStore(tmp_path / "taught"),
        {},
        logs=lambda: [recorder.segment_path.part],
        learner=worker(tmp_path, kind),
        patient=True,  # the learner's time is real time, and the session's is not
        unhurried=False,
    )
    window = SimulatedWindow(make_participant("human-like", np.random.default_rng(1)), session, clock)
    path = run_session(session, window, recorder, clock, agent=seat)
    log = read_log(path)
    assert [episode.outcome for episode in log.episodes].count("abandoned") == 0
    assert len(log.episodes) == 4
    assert {episode.taught.policy for episode in log.episodes} == {"random"}
    given = [event for event in log.part_events if isinstance(event, PolicyGiven)]
    asked = [event for event in log.part_events if isinstance(event, LearnerAsked)]
    failures = [event.failure for event in given if event.failure]
    assert asked
    assert failures == [] or SAID[kind] in failures[0]
    assert all(fine for _, fine in verify_session(path, policies=True))


def request():
    return LearnerRequest(logs=[], part="teach", episodes=1, learner="any", seed=1, start="", budget_s=0.2)


@pytest.mark.parametrize("kind", sorted(SAID.keys() - {"no file", "no policy"}))  # these two the seat finds out
def test_what_went_wrong_is_said(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(learner_process, "FIRST_ANSWER_TIMEOUT_S", first_answer_s(kind))
    learner = worker(tmp_path, kind)
    learner.ask(request())
    answer = learner.answer(patient=True)
    learner.close()
    assert SAID[kind] in answer.failure


def test_after_a_death_the_next_question_starts_another(tmp_path):
    script = tmp_path / "worker.py"
    first = "import os, pathlib\nflag = pathlib.Path('FLAG')\n".replace("FLAG", str(tmp_path / "flag"))
    script.write_text(
        first
        + "if not flag.exists():\n    flag.touch()\n    raise SystemExit(1)\n"
        + READ
        + "    print(json.dumps({'file': 'f', 'failure': ''}), flush=True)"
    )
    learner = LearnerProcess([str(script)])
    answers = []
    for _ in range(2):
        learner.ask(request())
        answers.append(learner.answer(patient=True))
    learner.close()
    assert [answer.file for answer in answers] == ["", "f"]


def test_a_learner_that_is_at_work_keeps_nobody_waiting(tmp_path):
    learner = worker(tmp_path, "hung")
    learner.ask(request())
    assert learner.answer() is None
    assert learner.busy
    learner.close()
    assert not learner.busy


def test_a_learner_killed_from_outside_is_noticed(tmp_path):
    learner = worker(tmp_path, "hung")
    learner.ask(request())
    os.kill(learner.pid, signal.SIGKILL)
    assert "signal 9" in learner.answer(patient=True).failure
    learner.close()


def test_the_question_is_one_line_of_json(tmp_path):
    script = tmp_path / "worker.py"
    script.write_text(READ + "    print(json.dumps({'file': asked['part'], 'failure': ''}), flush=True)")
    learner = LearnerProcess([str(script)])
    learner.ask(request())
    assert learner.answer(patient=True).file == "teach"
    learner.close()


DISPUTES = READ + "    print(json.dumps({'file': str(len(asked['pairs']) - 1), 'failure': ''}), flush=True)"


@pytest.mark.parametrize(("worker_says", "place"), [(DISPUTES, N_CANDIDATE_PAIRS - 1), (WORKERS["killed"], 0)])
def test_of_several_pairs_the_one_comes_that_the_ensemble_disputes_and_any_where_it_fails(
    tmp_path, monkeypatch, worker_says, place
):
    monkeypatch.setattr(learner_process, "FIRST_ANSWER_TIMEOUT_S", PATIENCE_S)
    script = tmp_path / "worker.py"
    script.write_text(worker_says)
    [log] = TAUGHT.rglob("*.mcap")
    stretches = ClipSampler(lambda: [log], seed=3, index=0)
    learner = LearnerProcess([str(script)])
    seat = AgentHost(PolicyStore(tmp_path), {}, logs=lambda: [log], learner=learner, clips=stretches, patient=True)
    block = read_log(log).episodes[0].plan.block_name
    want = ClipRequest(9, block, 0, 0, 3, None, "disagreement", PATIENCE_S)
    first = seat.answer(want, None, 0)
    other = seat.answer(replace(want, place=1, again=first.stretch), None, 0)
    seat.close()
    assert (first.stretch, other.stretch) == stretches.draw_pairs(want, N_CANDIDATE_PAIRS)[place]
    assert first.stretch != other.stretch
