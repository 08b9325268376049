"""Try every command in an environment with only what a station or a server has: it works, or says what to install.

    python .ci/station.py station VENV/bin/python    # or server

The environment is made by `pip install --no-deps . -r requirements/station.txt`. Windows need a display (xvfb-run).
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import contextmanager, suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / "protocols/demo.toml"
PATIENCE_S = 300
STUDY = "data/demo"
LOG = f"{STUDY}/sub-01/ses-01"
REFUSAL = re.compile(r"minihuman: .* (needs|need) .*; run: pip install .*")
WORK = {  # what has to work, by role
    "station": {"run", "simulate", "verify", "status", "check", "info", "play", "worlds", "recover"},
    "server": {"serve", "simulate", "verify", "status", "check", "info", "desk", "deploy", "watch", "worlds"},
}
WORDS = {  # of every command; one that is new fails until it is listed here
    "demo": "",
    "new": "made --yes",
    "check": f"{DEMO}",
    "doctor": "--windowed",
    "play": "minihuman/MiniGrid-Empty-5x5-v0",
    "worlds": "",
    "run": f"{DEMO} --data live --windowed --next-slot",
    "serve": f"{DEMO} --data served --port 0",
    "watch": f"{STUDY} --port 0",
    "desk": ". --data data --no-browser",
    "deploy": f"{DEMO} --address https://study.example.org --out server",
    "simulate": f"{DEMO} --participants 1 --player optimal --data data",
    "status": STUDY,
    "info": LOG,
    "replay": f"{LOG} --out one.rrd",
    "film": f"{LOG} --out one.mp4",
    "plot": f"{STUDY} --out figures",
    "report": f"{STUDY} --out report",
    "query": f"{STUDY} select|1",
    "publish": f"{STUDY} --for osf --out for-osf",
    "bots": STUDY,
    "verify": STUDY,
    "recover": STUDY,
    "annotate": f"{LOG} --tag quiet",
    "manifest": STUDY,
    "withdraw": f"sub-01 --study {STUDY} --reason none --erase",
    "replace": f"sub-09 --study {STUDY} --reason none",
    "gather": STUDY,
    "import": "no-data.json --study imported",
    "pack": "minihuman/MiniGrid-Empty-5x5-v0 --seeds 0-1 --out packed",
    "site": f"{DEMO} --out site --slots 1",
    "export": f"csv {STUDY} --out csv",
    "power": f"{DEMO} --effect shift=0.5",
    "fit": STUDY,
    "score": STUDY,
    "payments": STUDY,
    "learn clone": f"{STUDY} --world minihuman/MiniGrid-FourRooms-v0 --out clone.pt",
    "learn teach": f"{STUDY} --world minihuman/MiniGrid-FourRooms-v0 --out teach.pt",
    "learn ppo": "minihuman/MiniGrid-FourRooms-v0 --out ppo.pt",
    "learn compare": f"ppo.pt {STUDY}",
    "bench new": "--out bench.toml",
    "bench run": f"{DEMO}",
    "plugins": "",
    "schema": "",
}
LIST_COMMANDS = """
import click
from minihuman.cli.command_line import make_command_line
def walk(command, words):
    if isinstance(command, click.Group):
        for name in command.list_commands(click.Context(command)):
            walk(command.get_command(click.Context(command), name), [*words, name])
    else:
        print(" ".join(words))
walk(make_command_line(), [])
"""


class Trial:
    """One environment, and a folder to try it in."""

    def __init__(self, python: str, folder: Path) -> None:
        self._python, self._folder = python, folder

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end."""
        command = [self._python, "-m", "minihuman", *words]
        return subprocess.run(
            command, cwd=self._folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )

    @contextmanager
    def start(self, *words: str):
        """Start a command, and end it as an operator does."""
        command = [self._python, "-m", "minihuman", *words]
        with subprocess.Popen(
            command, cwd=self._folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            try:
                yield process
            finally:
                with suppress(ProcessLookupError):
                    process.send_signal(signal.SIGTERM)
                process.communicate(timeout=PATIENCE_S)

    def answers(self, *words: str) -> str:
        """Start what serves a page, and read it; "works", or the refusal."""
        with self.start(*words) as process:
            for line in process.stdout:
                if found := re.search(r"http://[^\s#]+", line):
                    with urllib.request.urlopen(found[0], timeout=PATIENCE_S) as page:
                        assert b"<html" in page.read().lower(), words
                    return "works"
            return judge(words, process.wait(), process.stderr.read())

    def opens(self, *words: str) -> str:
        """Start what opens a window; "works" if it still runs when its session is recorded, or after a while."""
        with self.start(*words) as process:
            until_s = time.monotonic() + (PATIENCE_S if words[0] == "run" else 15)
            while time.monotonic() < until_s and process.poll() is None:
                if list((self._folder / "live").rglob("*.part")):
                    break
                time.sleep(0.2)
            if process.poll() is not None:
                return judge(words, process.returncode, process.stderr.read())
        if words[0] == "run":
            assert list((self._folder / "live").rglob("*.mcap")), "the session left no finished log"
        return "works"


def judge(words: tuple[str, ...], status: int, errors: str) -> str:
    """ "works", or the one line in which a command says what to install; anything else is an error."""
    lines = [line for line in errors.splitlines() if not line.startswith(("compiling ", "Warning: "))]
    if status == 2 and len(lines) == 1 and REFUSAL.match(lines[0]):
        return lines[0]
    if status in (0, 1, 2) and "Traceback" not in errors:
        return "works" if status == 0 else f"ended with {status}: {lines[-1] if lines else ''}"
    raise SystemExit(f"minihuman {' '.join(words)} ended with {status}:\n{errors}")


def main() -> None:
    """Try them all, and print what each did."""
    role, python = sys.argv[1], str(Path(sys.argv[2]).absolute())
    listed = subprocess.run([python, "-c", LIST_COMMANDS], capture_output=True, text=True, check=True).stdout.split(
        "\n"
    )
    names = [name for name in listed if name]
    if missing := sorted({*names} ^ WORDS.keys()):
        raise SystemExit(f"{', '.join(missing)}: not in WORDS of .ci/station.py, or no command any more")
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        trial = Trial(python, Path(name))
        for command in sorted(names, key=lambda one: (one != "simulate", one == "withdraw")):  # data for all the others
            words = (*command.split(), *(word.replace("|", " ") for word in WORDS[command].split()))
            if command in ("serve", "watch", "desk"):
                found[command] = trial.answers(*words)
            elif command in ("run", "play", "demo"):
                found[command] = trial.opens(*words) if os.environ.get("DISPLAY") else "no display"
            else:
                done = trial.run(*words)
                found[command] = judge(words, done.returncode, done.stderr)
            print(f"{command:12} {found[command][:200]}", flush=True)
    if broken := sorted(one for one in WORK[role] if found[one] != "works"):
        raise SystemExit(f"{', '.join(broken)}: has to work on a {role}")
    refused = [one for one in names if found[one].startswith("minihuman: ")]
    print(f"{role}: {len(names)} commands, {len(refused)} say what to install")


if __name__ == "__main__":
    main()
