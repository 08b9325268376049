"""The learner process, which makes policies between episodes. If it fails, the session continues.

A request is one line of JSON, and so is an answer. The process has a low priority, is the first that the system may
kill for its memory, and is ended when its time is over; the next request starts another.
"""

import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import IO

from minihuman.activities.episode_clips import EpisodeClip

LEARNER_COMMAND = ("-m", "minihuman.learn.teaching.learner_main")
_LAST_LINE_TIMEOUT_S = 5.0  # to read a dead process's last line, as its children may keep the pipe open
_CHECK_INTERVAL_S = 0.2  # between a patient caller's checks whether the process has died
FIRST_ANSWER_TIMEOUT_S = 60.0  # more time for the first answer: the process has to start


@dataclass(frozen=True, slots=True)
class LearnerRequest:
    """A request for a policy, with the data to learn it from, or for the choice of one of several pairs of clips."""

    logs: list[str]  # of the session so far; the live one may be among them
    part: str  # the block's name
    episodes: int  # number of the session's episodes before the next one
    learner: str  # name and settings
    seed: int
    start: str  # the policy file to start from; "" for none
    budget_s: float
    pairs: Sequence[tuple[EpisodeClip, EpisodeClip]] = ()  # to choose from; empty if a policy is requested


@dataclass(frozen=True, slots=True)
class LearnerAnswer:
    """A learner's answer: a policy or the choice of a pair, or the reason why there is none."""

    file: str  # the policy's file, which exists until the next request; or the index of the chosen pair, in digits
    failure: str  # why there is no answer; "" if there is one


class LearnerProcess:
    """Starts the learner process, and sends it one request at a time.

    Args:
        command: the arguments after Python's own name.
    """

    def __init__(self, command: Sequence[str] = LEARNER_COMMAND) -> None:
        self._command = [sys.executable, *command]
        self._process: subprocess.Popen[bytes] | None = None
        self._until_s: float | None = None  # monotonic deadline of the pending request; None if none is pending
        self._answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._reader: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """Return whether a request is still unanswered."""
        return self._until_s is not None

    @property
    def pid(self) -> int:
        """Return the id of the process, which must have been started."""
        assert self._process is not None, "the learner process was not started"
        return self._process.pid

    def start(self) -> None:
        """Start the process if none is running; this is done before it is needed, since it takes seconds."""
        if self._process is None or self._process.poll() is not None:
            self._kill()
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
            self._answers = queue.SimpleQueue()
            self._reader = threading.Thread(
                target=_read_lines, args=(self._process.stdout, self._answers), name="minihuman-learner", daemon=True
            )
            self._reader.start()

    def ask(self, request: LearnerRequest) -> None:
        """Send a request, starting the process if necessary; answers to earlier requests are dropped."""
        is_new = self._process is None or self._process.poll() is not None
        self.start()
        assert self._process is not None
        assert self._process.stdin is not None
        while not self._answers.empty():
            self._answers.get()
        self._until_s = time.monotonic() + request.budget_s
        if is_new:
            self._until_s += FIRST_ANSWER_TIMEOUT_S
        with suppress(OSError):  # the process has died, which ``answer`` reports
            self._process.stdin.write(json.dumps(asdict(request)).encode() + b"\n")
            self._process.stdin.flush()

    def answer(self, *, patient: bool = False) -> LearnerAnswer | None:
        """Return the answer to the pending request; None if there is none yet. With ``patient``, wait for it."""
        assert self._until_s is not None, "no request is pending"
        timeout_s = _CHECK_INTERVAL_S if patient else 0.0
        while True:
            answer = self._poll_answer(timeout_s)
            if answer is not None:
                self._until_s = None
                return answer
            if not patient:
                return None

    def close(self) -> None:
        """End the learner process."""
        self._kill()
        self._until_s = None

    def _poll_answer(self, timeout_s: float) -> LearnerAnswer | None:
        """Return an answer, or one with the reason why none will come; None if neither came within ``timeout_s``."""
        assert self._process is not None
        assert self._reader is not None
        assert self._until_s is not None
        exit_status = self._process.poll()
        if exit_status is not None:
            self._reader.join(_LAST_LINE_TIMEOUT_S)
        with suppress(queue.Empty):
            return _parse_answer(self._answers.get(block=timeout_s > 0, timeout=timeout_s))
        if exit_status is not None:
            self._kill()
            cause = f"exit status {exit_status}"
            if exit_status < 0:
                cause = f"signal {-exit_status}"
            return LearnerAnswer("", f"the learner died ({cause})")
        if time.monotonic() >= self._until_s:
            self._kill()
            return LearnerAnswer("", "the learner took too long and was ended")
        return None

    def _kill(self) -> None:
        """Kill the process, if there is one, and close its streams."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        if self._reader is not None:
            self._reader.join(_LAST_LINE_TIMEOUT_S)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(OSError):  # a request that was not written to the dead process
                    stream.close()
        self._process = None


def _read_lines(stream: IO[bytes], lines: "queue.SimpleQueue[bytes]") -> None:
    """Put each whole line of a stream into a queue, until the stream ends."""
    for line in stream:
        if line.endswith(b"\n"):  # otherwise the process died while it wrote the line
            lines.put(line)


def _parse_answer(line: bytes) -> LearnerAnswer:
    """Parse a line of the learner; one that is not valid becomes an answer with a failure."""
    try:
        answer = json.loads(line)
        return LearnerAnswer(str(answer["file"]), str(answer["failure"]))
    except (ValueError, KeyError, TypeError):
        return LearnerAnswer("", f"the learner answered {line[:200]!r}")
