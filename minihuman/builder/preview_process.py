"""The process of previews, and the desk's side of it: requests and answers as lines of JSON.

The process ends with its standard input. A world that crashes takes the process with it, and the next request starts
another; the desk and its sessions go on.
"""

import subprocess
import sys
import threading
from contextlib import closing, suppress
from pathlib import Path
from typing import BinaryIO

import msgspec

from minihuman.builder.preview_server import Preview, PreviewRequest, PreviewServer
from minihuman.errors import MinihumanError, ProtocolError

_STOP_S = 5.0


class _Answer(msgspec.Struct, frozen=True, omit_defaults=True):
    """An answer of the process: a preview, or why there is none."""

    preview: Preview | None = None
    error: str = ""


class PreviewProcess:
    """Starts the process when a preview is requested, and again after it has died."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._turn = threading.Lock()

    def start(self) -> None:
        """Start the process unless it runs, so that the first preview comes sooner."""
        with self._turn:
            self._start_if_needed()

    def show(self, request: PreviewRequest) -> Preview:
        """Serve a session in the process, and return its address and parts.

        Raises:
            ProtocolError: if the protocol cannot be shown, or its world ended the process.
        """
        with self._turn:
            process = self._start_if_needed()
            assert process.stdin is not None
            assert process.stdout is not None
            line = b""
            with suppress(BrokenPipeError):
                process.stdin.write(msgspec.json.encode(request) + b"\n")
                process.stdin.flush()
                line = process.stdout.readline()
        if not line:
            name = Path(request.protocol).name
            raise ProtocolError(f"{name} ended the process of previews; run `minihuman check {name}` to see the reason")
        answer = msgspec.json.decode(line, type=_Answer)
        if answer.preview is None:
            raise ProtocolError(answer.error)
        return answer.preview

    def _start_if_needed(self) -> subprocess.Popen[bytes]:
        """Return the running process, after starting one if there is none."""
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._process = subprocess.Popen(
                [sys.executable, "-m", "minihuman.builder.preview_process"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is for the desk alone
            )
        return self._process

    def close(self) -> None:
        """End the process with its previews."""
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


def answer_requests(requests: BinaryIO, answers: BinaryIO) -> None:
    """Serve the preview that each line of ``requests`` asks for, and write one line to ``answers`` for each.

    Return at the end of ``requests``, or when nothing reads ``answers`` any more. All previews end then.
    """
    with closing(PreviewServer()) as server:
        for line in requests:
            try:
                answer = _Answer(server.show(msgspec.json.decode(line, type=PreviewRequest)))
            except (MinihumanError, OSError) as error:
                answer = _Answer(error=str(error))
            try:
                answers.write(msgspec.json.encode(answer) + b"\n")
                answers.flush()
            except BrokenPipeError:  # the desk has ended
                return


if __name__ == "__main__":
    stdout = sys.stdout
    sys.stdout = sys.stderr  # what a world prints is no answer
    answer_requests(sys.stdin.buffer, stdout.buffer)
