"""The main program of the learner process, which answers requests for policies.

The session host starts the process. Each request and each answer is one line of JSON. So that no frame of the session
waits for the process, it has a low priority and a memory limit, and the system ends it first if memory is short.
"""

import json
import os
import sys
import traceback
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.operating_system import limit_memory, lower_process_priority
from minihuman.plugins import describe_failure

MEMORY_SHARE = 0.5  # the share of the machine's memory that the process may use


def main() -> None:
    """Answer requests from standard input until it is closed."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    os.dup2(2, 1)  # what libraries print goes to standard error, so that it is not taken for an answer
    lower_process_priority()
    limit_memory(MEMORY_SHARE)
    import minihuman.learn.teaching.provenance  # noqa: F401 - slow, so done before the first request

    with TemporaryDirectory() as folder:
        for line in sys.stdin:
            try:
                request = json.loads(line)
                if request["pairs"]:  # a request with pairs asks which of them to compare, any other for a policy
                    answer = str(_choose_pair(request))
                else:
                    answer = str(_learn_policy(request, Path(folder) / "policy.pt"))
                reply = {"file": answer, "failure": ""}
            except Exception as error:  # any failure of a learner, a MemoryError included, is reported as an answer
                traceback.print_exc()
                reply = {"file": "", "failure": describe_failure(error)}
            answers.write(json.dumps(reply) + "\n")
            answers.flush()


def _learn_policy(request: dict[str, Any], out: Path) -> Path:
    """Learn the policy that a request asks for, write it to ``out`` and return the path of the file."""
    from minihuman.learn.teaching.log_dataset import read_session_dataset
    from minihuman.learn.teaching.provenance import make_policy

    dataset = read_session_dataset([Path(log) for log in request["logs"]], request["part"], request["episodes"])
    start = None
    if request["start"]:
        start = Path(request["start"])
    budget_s = request["budget_s"]
    return make_policy(dataset, request["learner"], out, seed=request["seed"], start=start, budget_s=budget_s).path


def _choose_pair(request: dict[str, Any]) -> int:
    """Return the index of the request's pair of clips that is to be compared next."""
    from minihuman.learn.teaching.preference_learner import choose_disputed_pair

    pairs = [
        tuple(EpisodeClip(**{**side, "actions": tuple(side["actions"])}) for side in pair) for pair in request["pairs"]
    ]
    logs = [Path(log) for log in request["logs"]]
    return choose_disputed_pair(logs, request["part"], [(left, right) for left, right in pairs], seed=request["seed"])


if __name__ == "__main__":
    main()
