"""Make a wheel for this platform of the one for all: the same, with the kernels' machine code for x86-64-v3 beside it.

    python .ci/platform_wheel.py dist/minihuman_lab-0.1.0-py3-none-any.whl

It runs in an environment where all that minihuman needs is installed: the code is for its versions of Python, Numba,
llvmlite and NumPy, and for any processor from x86-64-v3 on. Whoever has others compiles, as with the wheel for all.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path
from tempfile import TemporaryDirectory

PLAY = Path(__file__).with_name("play_everything.py")


def main() -> None:
    """Read the command line, make the wheel and name it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    wheel = parser.parse_args().wheel.absolute()
    with TemporaryDirectory() as scratch:
        print(platform_wheel(wheel, Path(scratch)))


def platform_wheel(wheel: Path, scratch: Path) -> Path:
    """The wheel for this platform, made beside the one for all."""
    run("-m", "wheel", "unpack", "--dest", scratch / "unpacked", wheel)
    (root,) = (scratch / "unpacked").iterdir()
    compiled = root / "minihuman" / "worlds" / "compiled"
    shutil.copytree(code_of(root, scratch / "cache"), compiled)
    (about,) = root.glob("*.dist-info")
    metadata = (about / "WHEEL").read_text()
    metadata = re.sub(r"Root-Is-Purelib: .*\n|Tag: .*\n", "", metadata) + "Root-Is-Purelib: false\n" + tags()
    (about / "WHEEL").write_text(metadata)
    (scratch / "packed").mkdir()
    run("-m", "wheel", "pack", "--dest-dir", scratch / "packed", root)
    (made,) = (scratch / "packed").iterdir()
    return Path(shutil.copy(made, wheel.parent))


def code_of(root: Path, cache: Path) -> Path:
    """A folder with the machine code of all that an unpacked wheel's worlds compute."""
    environment = os.environ | {"PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(cache)}
    level = subprocess.run(
        [sys.executable, "-c", "from minihuman.worlds.kernels import SHIPPED_CPU; print(SHIPPED_CPU)"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    run(PLAY, env=environment | {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""})
    return cache / "minihuman" / "kernels"


def tags() -> str:
    """Where llvmlite's own wheel runs, which carries the compiler, the code does too."""
    metadata = distribution("llvmlite").read_text("WHEEL")
    assert metadata is not None, "llvmlite was not installed from a wheel, so there is no telling where it runs"
    return "".join(re.findall(r"Tag: .*\n", metadata))


def run(*command: object, env: dict[str, str] | None = None) -> None:
    """Run this Python; the outer process's output goes nowhere but on failure."""
    ran = subprocess.run([sys.executable, *map(str, command)], env=env, capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        sys.exit(f"{ran.stdout}{ran.stderr}\n{' '.join(map(str, command))} failed")


if __name__ == "__main__":
    main()
