"""Trials of a study: twenty simulated participants and their report, in a folder apart from the study's data."""

import subprocess
import sys
import threading
from pathlib import Path
from typing import Literal

import msgspec

N_SIMULATED = 20
_SHOWN_LINES = 12
State = Literal["running", "done", "failed"]


class SimulationRun(msgspec.Struct, frozen=True):
    """The state of a simulation.

    Attributes:
        number: the number of the run.
        state: whether it goes on, and how it ended.
        step: what it does at the moment, in words.
        progress: the share of the participants that have been simulated, 0 to 1.
        output: the last lines that its commands printed.
        commands: the commands, as they would be typed.
        report: the report's path below the reports' address; "" while there is none.
    """

    number: int
    state: State
    step: str
    progress: float
    output: str
    commands: list[str]
    report: str = ""


class SimulatedTrial:
    """Simulates participants of a protocol and writes the report, in a thread.

    Args:
        number: the number of the run.
        protocol: the protocol's file.
        study: the study's name.
        temporary: the folder for the simulated sessions, which is erased with the desk.
        reports: the folder of the desk's reports.
    """

    def __init__(self, number: int, protocol: Path, study: str, temporary: Path, reports: Path) -> None:
        self.number = number
        self._data = temporary / f"simulated-{number}"
        self._report_name = f"{study}-simulated"
        self._commands = [
            ["simulate", str(protocol), f"--participants={N_SIMULATED}", f"--data={self._data}"],
            ["report", str(self._data / study), f"--out={reports / self._report_name}"],
        ]
        self._output = temporary / f"simulated-{number}.txt"
        self._output.touch()
        self._step = 0
        self._state: State = "running"
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="minihuman-simulation", daemon=True)
        self._thread.start()

    def describe(self) -> SimulationRun:
        """Return the state of the run, with the last lines of its commands' output."""
        lines = self._output.read_text(encoding="utf-8", errors="replace").split("\n")
        n_sessions = sum(line.endswith(".mcap") for line in lines)
        report = ""
        if self._state == "done":
            report = f"{self._report_name}/report.html"
        return SimulationRun(
            self.number,
            self._state,
            ("simulating participants", "writing the report")[self._step],
            min(1.0, n_sessions / N_SIMULATED),
            "\n".join(lines[-_SHOWN_LINES:]).strip(),
            ["minihuman " + " ".join(words) for words in self._commands],
            report,
        )

    def _run(self) -> None:
        """Run the commands one after the other until all are done or one fails."""
        for step, words in enumerate(self._commands):
            self._step = step
            with self._output.open("ab") as file:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "minihuman", *words],
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # Ctrl-C is for the desk alone
                )
            if self._process.wait() != 0:
                self._state = "failed"
                return
        self._state = "done"

    def close(self) -> None:
        """Stop the running command, and wait until the thread has ended."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
        self._thread.join()
