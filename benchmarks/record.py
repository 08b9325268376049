"""Run a command that measures or proves something, and keep what it printed as a file.

    python -m benchmarks.record first-starts -- python -m benchmarks.first_start
    MINIHUMAN_NIGHTLY=1 python -m benchmarks.record kills -- pytest -s tests/promises/test_kills.py

writes `benchmarks/results/NAME.json`: the command, its output, and what a figure of it depends on (date, commit,
versions, processor, load). Pages have the figure and point to the file. A command that fails leaves no file.
"""

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

RESULTS = Path(__file__).with_name("results")
PACKAGES = ("numpy", "numba", "gymnasium", "minigrid", "miniworld", "pygame-ce", "pyglet", "duckdb", "torch")


def describe_machine() -> dict[str, object]:
    """Return what a figure depends on beside the command."""
    commit = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True, cwd=RESULTS.parent)
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        "commit": commit.stdout.strip(),
        "python": platform.python_version(),
        "versions": versions,
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "load_before": round(os.getloadavg()[0], 1),
    }


def record(name: str, command: list[str], folder: Path) -> Path:
    """Run a command, pass its output through, and write its record.

    Raises:
        SystemExit: if the name is no file name, or the command fails, with its exit status.
    """
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]*", name):
        raise SystemExit(f"{name!r} is no name of a record; write small letters, digits and hyphens")
    machine = describe_machine()
    paths = sorted(
        (word for word in (*command, str(RESULTS.parents[1])) if Path(word).is_absolute() and word != "/"), key=len
    )

    def shorten(text: str) -> str:
        """Put names in the place of paths, which are of one machine."""
        for path in reversed(paths):
            text = text.replace(path, Path(path).name)
        return text

    output = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            output.append(shorten(line.rstrip("\n")))
    if process.returncode != 0:
        raise SystemExit(process.returncode)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    load = round(os.getloadavg()[0], 1)
    contents = {"command": [shorten(word) for word in command], **machine, "load_after": load, "output": output}
    path.write_text(json.dumps(contents, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def main(arguments: list[str] | None = None) -> None:
    """Record what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", help="of the file, without its ending")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where the file is written")
    parser.add_argument("command", nargs="+", help="what is run, after --")
    given = parser.parse_args(arguments)
    print(f"written: {record(given.name, given.command, given.folder)}", file=sys.stderr)


if __name__ == "__main__":
    main()
