"""Plant faults in a copy of the package, one at a time, and see whether the tests notice.

    python -m tests.mutations [NUMBER ...]

Each fault changes what the package means and breaks no syntax. The tests named with it run until the first failure.
Prints a line a fault; exits 1 if more than two of the fifteen survive. Takes some minutes.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
MAY_SURVIVE = 2


@dataclass(frozen=True)
class Fault:
    """A change of one place in a file, and the tests that should notice it."""

    meaning: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


FAULTS = (
    Fault(
        "an input stamped before the last one turns the session's time back",
        "experiment/machine/session.py",
        "max(self.now_ns, happened.t_ns, at_ns)",
        "max(happened.t_ns, at_ns)",
        ("tests/study/test_session.py",),
    ),
    Fault(
        "an episode that was cut off counts as completed",
        "dataset/selection.py",
        'UNFINISHED_OUTCOMES = ("abandoned", "agent_failed", CUT_OFF)',
        'UNFINISHED_OUTCOMES = ("abandoned", "agent_failed")',
        ("tests/data/test_tables.py", "tests/data"),
    ),
    Fault(
        "an exclusion rule leaves out who is exactly at its bound",
        "dataset/selection.py",
        "value < rule.below",
        "value <= rule.below",
        ("tests/data/test_tables.py", "tests/data"),
    ),
    Fault(
        "an answer's time counts from the first change, not from the question's picture",
        "dataset/session_tables.py",
        '"answer_ms": (event.t_ns - event.shown_ns) * _MS if event.shown_ns else None,\n        "changes"',
        '"answer_ms": (event.t_ns - event.first_ns) * _MS if event.shown_ns else None,\n        "changes"',
        ("tests/data/test_tables.py", "tests/activities/questions/test_questions.py", "tests/report/test_answers.py"),
    ),
    Fault(
        "a group is drawn again whatever the stratum",
        "admin/enrolment_log.py",
        "if (line.stratum, line.slot is None) == (stratum, False):",
        "if line.slot is not None:",
        ("tests/study/test_strata.py", "tests/seats/test_drawn_group.py"),
    ),
    Fault(
        "a session that is due has no last day",
        "admin/next_session.py",
        "if not earliest <= passed <= latest:",
        "if not earliest <= passed:",
        ("tests/lab/test_parts_resumed.py", "tests/lab/test_next_session.py", "tests/lab/test_calendar_days.py"),
    ),
    Fault(
        "no space is kept for finishing a log",
        "log/record/disk.py",
        "needed = RESERVE_BYTES + min(",
        "needed = min(",
        ("tests/log/record", "tests/promises/test_faults.py"),
    ),
    Fault(
        "the steps of a torn write count as durable",
        "log/record/disk.py",
        "*(job.steps for job in written if job.whole)",
        "*(job.steps for job in written)",
        ("tests/log/record", "tests/promises/test_faults.py"),
    ),
    Fault(
        "two keys may have one time",
        "display/windows/blocking_window.py",
        "max(t_ns, self._last_key_ns + 1)",
        "max(t_ns, self._last_key_ns)",
        ("tests/windows/test_blocking.py", "tests/windows"),
    ),
    Fault(
        "one missing message of a page is accepted",
        "web/messages.py",
        "if number > self.received + 1:",
        "if number > self.received + 2:",
        ("tests/web/test_stream.py",),
    ),
    Fault(
        "the page does not show an end at the step limit",
        "web/outbox.py",
        "most_steps=min(limits),",
        "most_steps=max(limits) + 1,",
        ("tests/web/test_ahead.py", "tests/web/test_computed.py", "tests/web/test_seat.py"),
    ),
    Fault(
        "the offset between a page's clock and the server's has the wrong sign",
        "web/session_host.py",
        "offset_ns = ((link.received - link.sent)",
        "offset_ns = -((link.received - link.sent)",
        ("tests/web/test_seat.py",),
    ),
    Fault(
        'the report says "p < 0.001" of anything below 0.01',
        "reporting/template.py",
        '"< 0.001" if value < 0.001',
        '"< 0.001" if value < 0.01',
        ("tests/report/test_elements.py", "tests/report/test_results.py"),
    ),
    Fault(
        "the quantiles of LeRobot's pictures are divided by pixels instead of frames",
        "exporters/lerobot.py",
        "self._quantiles / self._frames",
        "self._quantiles / self._samples",
        ("tests/export/test_feature_statistics.py", "tests/export/test_formats.py"),
    ),
    Fault(
        "the hash chain leaves out the lengths of its parts",
        "log/integrity.py",
        '            digest.update(len(part).to_bytes(8, "little"))\n',
        "",
        ("tests/promises/test_tampering.py", "tests/log/record/test_finish.py", "tests/log"),
    ),
)


def notice(fault: Fault, copy: Path) -> str:
    """Plant a fault in a copy of the project, run its tests, and take it out again.

    Returns:
        The first test that failed; empty if none did.

    Raises:
        RuntimeError: if the place is not there exactly once, or the tests did not run.
    """
    path = copy / "minihuman" / fault.file
    text = path.read_text(encoding="utf-8")
    if text.count(fault.old) != 1:
        raise RuntimeError(f"{fault.file} has {text.count(fault.old)} times what is to be changed: {fault.old!r}")
    path.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
    try:
        for tests in fault.tests:
            command = [sys.executable, "-m", "pytest", "-n0", "-x", "-q", "-p", "no:cacheprovider", tests]
            ran = subprocess.run(command, cwd=copy, capture_output=True, text=True, env=_environment(copy))
            if ran.returncode == 1:
                failed = [line for line in ran.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return failed[0].split(" - ")[0] if failed else "a test"
            if ran.returncode:
                raise RuntimeError(f"{tests} did not run:\n{ran.stdout[-2000:]}{ran.stderr[-2000:]}")
    finally:
        path.write_text(text, encoding="utf-8")
    return ""


def _environment(copy: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(copy)}


def main(numbers: list[int]) -> int:
    """Try the faults of these numbers, or all; return the exit status."""
    survived = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "project"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", "__pycache__", "sessions", "site"))
        for number in numbers or range(len(FAULTS)):
            noticed = notice(FAULTS[number], copy)
            survived += not noticed
            print(f"{number:2} {'killed  ' if noticed else 'SURVIVED'} {FAULTS[number].meaning}: {noticed}", flush=True)
    print(f"{survived} survived")
    return int(survived > MAY_SURVIVE)


if __name__ == "__main__":
    sys.exit(main([int(number) for number in sys.argv[1:]]))
