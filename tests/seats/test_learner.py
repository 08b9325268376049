"""The learner's process: slow, hung, killed, out of memory, or talking nonsense, a session goes on with what it has."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from minihuman.lab.policies import Policies
from minihuman.lab.proofs import proofs
from minihuman.log.read.open_log import open_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.players.choose import make_player
from minihuman.seats import learner as learners
from minihuman.seats.agent_seat import CANDIDATES, AgentSeat
from minihuman.seats.learner import Learner, Request
from minihuman.seats.run import run_session
from minihuman.seats.simulated import SimulatedWindow
from minihuman.seats.stretches import Stretches
from minihuman.study.activities.agent_events import LearnerAsked, PolicyGiven
from minihuman.study.activities.pair_events import WantsStretch
from minihuman.study.expand import enrol, expand
from minihuman.study.protocol import decode
from minihuman.study.session import Session
from minihuman.windows.scripted import VirtualClock
from minihuman.worlds.adapt.world import World

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
    "no policy": "no policy file",
}
TOML = """
[study]
name = "taught"
version = "1"
seed = 5
closing = ""
[keys]
pool = ["1", "2", "3"]
check = false
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
    return Learner([str(script)])


@pytest.mark.parametrize("kind", WORKERS)
def test_whatever_becomes_of_the_learner_every_episode_is_played_and_nothing_is_lost(tmp_path, monkeypatch, kind):
    if kind == "no policy":
        pytest.importorskip("torch", reason="reading a policy file needs the extra `learn`")
    monkeypatch.setattr(learners, "FIRST_S", 3.0)
    protocol = decode(TOML.format(budget_s=0.2).encode())
    plan, clock = expand(protocol, enrol(protocol, 0)), VirtualClock()
    session = Session(plan, World, {}, picture_px=None)
    recorder = McapRecorder(tmp_path, plan, started_ns=0)
    seat = AgentSeat(
        Policies(tmp_path / "taught"),
        {},
        logs=lambda: [recorder.where.part],
        learner=worker(tmp_path, kind),
        patient=True,  # the learner's time is real time, and the session's is not
        unhurried=False,
    )
    window = SimulatedWindow(make_player("human-like", np.random.default_rng(1)), session, clock)
    path = run_session(session, window, recorder, clock, agent=seat)
    log = open_log(path)
    assert [episode.outcome for episode in log.episodes].count("abandoned") == 0
    assert len(log.episodes) == 4
    assert {episode.taught.policy for episode in log.episodes} == {"random"}
    given = [event for event in log.part_events if isinstance(event, PolicyGiven)]
    asked = [event for event in log.part_events if isinstance(event, LearnerAsked)]
    failures = [event.failure for event in given if event.failure]
    assert asked
    assert failures == [] or SAID[kind] in failures[0]
    assert all(fine for _, fine in proofs(path, policies=True))


def request():
    return Request(logs=[], part="teach", episodes=1, learner="any", seed=1, start="", budget_s=0.2)


@pytest.mark.parametrize("kind", sorted(SAID.keys() - {"no file", "no policy"}))  # these two the seat finds out
def test_what_went_wrong_is_said(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(learners, "FIRST_S", 3.0)
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
    learner = Learner([str(script)])
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
    learner = Learner([str(script)])
    learner.ask(request())
    assert learner.answer(patient=True).file == "teach"
    learner.close()


DISPUTES = READ + "    print(json.dumps({'file': str(len(asked['pairs']) - 1), 'failure': ''}), flush=True)"


@pytest.mark.parametrize(("worker_says", "place"), [(DISPUTES, CANDIDATES - 1), (WORKERS["killed"], 0)])
def test_of_several_pairs_the_one_comes_that_the_ensemble_disputes_and_any_where_it_fails(
    tmp_path, monkeypatch, worker_says, place
):
    monkeypatch.setattr(learners, "FIRST_S", 3.0)
    script = tmp_path / "worker.py"
    script.write_text(worker_says)
    [log] = TAUGHT.rglob("*.mcap")
    stretches = Stretches(lambda: [log], seed=3, index=0)
    learner = Learner([str(script)])
    seat = AgentSeat(Policies(tmp_path), {}, logs=lambda: [log], learner=learner, stretches=stretches, patient=True)
    block = open_log(log).episodes[0].plan.block_name
    want = WantsStretch(9, block, 0, 0, 3, None, "disagreement", 0.2)
    first = seat.answer(want, None, 0)
    other = seat.answer(replace(want, place=1, again=first.stretch), None, 0)
    seat.close()
    assert (first.stretch, other.stretch) == stretches.candidates(want, CANDIDATES)[place]
    assert first.stretch != other.stretch
