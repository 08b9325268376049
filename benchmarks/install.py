"""CPU-seconds of an installation's build step, of this checkout and of another, in turn.

    python -m benchmarks.install [OTHER_CHECKOUT] [--rounds 1]

Each build is of a copy without a library, in a new environment with what its build asks for, by the call that
`pip install -e .` makes of the build backend; all processes that it starts count. Filling the environment is
apart, since it is pip's work. Ours is then built once more as a second checkout, from the cache that the first filled.
"""

import argparse
import json
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

HERE = Path(__file__).parents[1]
CACHE_VARIABLE = "MINIHUMAN_BUILD_CACHE"
# what pip asks a build backend for, and how it builds
REQUIREMENTS = "import hatchling.build, json; print(json.dumps(hatchling.build.get_requires_for_build_editable()))"
BUILD = "import hatchling.build, sys; hatchling.build.build_editable(sys.argv[1])"
VERSIONS = """
from importlib.metadata import distributions
print(", ".join(sorted(f"{found.name} {found.version}" for found in distributions() if found.name in (
    "hatchling", "llvmlite", "numba", "numpy", "ziglang"))))
"""


class Build:
    """A copy of a checkout and an environment for its build."""

    def __init__(self, checkout: Path, folder: Path, cache: Path) -> None:
        self.folder, self._cache = folder, cache
        self.sources = folder / "sources"
        self._python = folder / "venv" / "bin" / "python"
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=checkout, capture_output=True, check=True).stdout
        for name in listed.decode().rstrip("\0").split("\0"):
            if (checkout / name).is_file():
                (self.sources / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(checkout / name, self.sources / name)
        subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)

    def run(self, *words: str | Path) -> tuple[float, str]:
        """Run the environment's Python; return the CPU-seconds of all its processes, and what it printed."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        environment = os.environ | {CACHE_VARIABLE: str(self._cache), "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
        environment.pop("PYTHONPATH", None)
        ran = subprocess.run(
            [self._python, *words], cwd=self.sources, env=environment, capture_output=True, text=True, check=False
        )
        if ran.returncode:
            sys.exit(f"{words}: {ran.stdout}{ran.stderr}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, ran.stdout

    def prepare(self) -> float:
        """Install what the build asks for, and return the CPU-seconds of that."""
        project = tomllib.loads((self.sources / "pyproject.toml").read_text(encoding="utf-8"))
        # the backend imports what it shows of the project: nothing else
        first_s, _ = self.run("-m", "pip", "install", "-q", *project["build-system"]["requires"])
        asked_s, printed = self.run("-c", REQUIREMENTS)
        more = json.loads(printed.splitlines()[-1])
        more_s, _ = self.run("-m", "pip", "install", "-q", *more) if more else (0.0, "")
        return first_s + asked_s + more_s

    def build(self) -> float:
        """Build as `pip install -e .` does, and return the CPU-seconds of that."""
        shutil.rmtree(self.sources / "minihuman/worlds/compiled", ignore_errors=True)
        cpu_s, _ = self.run("-c", BUILD, self.folder)
        assert list((self.sources / "minihuman/worlds/compiled").glob("kernels-*")), "it made no library"
        return cpu_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", nargs="?", type=Path, metavar="OTHER_CHECKOUT")
    parser.add_argument("--rounds", type=int, default=1)
    arguments = parser.parse_args()
    machine = f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    print(f"Python {platform.python_version()}, {machine}, {time.strftime('%F')}")
    with tempfile.TemporaryDirectory() as scratch:
        cache = Path(scratch, "cache")
        checkouts = {"ours": HERE} | ({"other": arguments.other.resolve()} if arguments.other else {})
        builds = {side: Build(checkout, Path(scratch, side), cache) for side, checkout in checkouts.items()}
        for side, build in builds.items():
            print(
                f"{side}: {build.prepare():.1f} CPU s to fill the environment: {build.run('-c', VERSIONS)[1].strip()}"
            )
        for _ in range(arguments.rounds):
            for side, build in builds.items():
                shutil.rmtree(cache, ignore_errors=True)
                print(f"{side}: {build.build():.1f} CPU s to build", flush=True)
                if side == "ours":
                    print(f"{side}: {build.build():.1f} CPU s to build again, from the cache", flush=True)


if __name__ == "__main__":
    main()
