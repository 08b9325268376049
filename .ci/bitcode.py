"""Prove that the committed bitcode is of the sources, and that libraries are made of it, or of edited kernels.

    python .ci/bitcode.py rebuild     # lower the kernels again with the tools that wrote it, and compare
    python .ci/bitcode.py llvmlite    # build with the oldest and the newest that pyproject.toml admits, and play
    python .ci/bitcode.py edit        # edit a kernel and install: Numba compiles it, and the worlds do otherwise

Run it in an environment that has minihuman; each build is in an environment of its own.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from tests.worlds.build.checkouts import copy_checkout, edit_kernel  # noqa: E402

MANIFEST = "manifest.json"
COMMITTED = ROOT / "kernel_build" / "bitcode"
PRINT_VERSION = "from importlib.metadata import version; print(version('llvmlite'))"


def make_environment(folder: Path, python: str, *requirements: str) -> str:
    """Make an environment, and return its Python."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    made = str(folder / "bin" / "python")
    subprocess.run([made, "-m", "pip", "install", "-q", "--disable-pip-version-check", *requirements], check=True)
    return made


def build(python: str, *words: str | Path) -> None:
    """Run this checkout's compiler, without a cache."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MINIHUMAN_BUILD_CACHE": ""}
    subprocess.run([python, "-m", "kernel_build", *words], env=environment, cwd=ROOT, check=True)


def rebuild(scratch: Path) -> None:
    """Compare the committed bitcode with what its own tools make of the sources now."""
    committed = json.loads((COMMITTED / MANIFEST).read_bytes())
    tools = committed["written by"]
    python = shutil.which(f"python{tools['python']}")
    if python is None:
        sys.exit(f"Python {tools['python']}, which wrote {COMMITTED}, is not on the path")
    pinned = [f"{name}=={tools[name]}" for name in ("llvmlite", "numba", "numpy")]
    build(make_environment(scratch / "venv", python, *pinned, "gymnasium"), "--bitcode", scratch / "new")
    new = json.loads((scratch / "new" / MANIFEST).read_bytes())
    if different := [name for name in committed if committed[name] != new.get(name)]:
        sys.exit(f"{COMMITTED}: not of these sources: {', '.join(different)}; run: python -m kernel_build --bitcode")
    print(f"{COMMITTED}: of these sources ({committed['sha256']})")


def try_versions(scratch: Path) -> None:
    """Build a library with the oldest and the newest llvmlite, and compare what the worlds do with each."""
    requires = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    oldest = next(found[1] for name in requires if (found := re.fullmatch(r"llvmlite>=([\d.]+)", name)))
    walks = {}
    for requirement in (f"llvmlite=={oldest}.0", f"llvmlite>={oldest}"):
        python = make_environment(scratch / requirement / "venv", sys.executable, requirement, "ziglang")
        checkout = scratch / requirement / "checkout"
        for name in ("minihuman", "protocols"):
            shutil.copytree(ROOT / name, checkout / name, ignore=shutil.ignore_patterns("compiled", "__pycache__"))
        build(python, "--native", checkout / "minihuman/worlds/compiled")
        walks[requirement] = walk(checkout)
        version = subprocess.check_output([python, "-c", PRINT_VERSION], text=True).strip()
        print(f"{requirement}: {version}, {len(walks[requirement].splitlines())} worlds", flush=True)
    if len(set(walks.values())) != 1:
        sys.exit("worlds differ between libraries of the oldest and the newest llvmlite")


def walk(checkout: Path) -> str:
    """Return what a walk in every world shows and earns, by a checkout's library."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(checkout), str(ROOT)])}
    command = [sys.executable, "-m", "tests.worlds.build.walks"]
    walked = subprocess.run(command, env=environment, cwd=checkout, capture_output=True, text=True, check=False)
    if walked.returncode or "compiled here by Numba: False" not in walked.stderr:
        sys.exit(f"{checkout}: its library does not play: {walked.stderr}")
    return walked.stdout


def install_edited(scratch: Path) -> None:
    """Install a checkout with an edited kernel, in an environment that has nothing, and see its worlds differ."""
    checkout = copy_checkout(scratch / "checkout")
    shutil.rmtree(checkout / "minihuman/worlds/compiled", ignore_errors=True)
    edit_kernel(checkout)
    subprocess.run([sys.executable, "-m", "venv", scratch / "venv"], check=True)
    command = [scratch / "venv" / "bin" / "python", "-m", "pip", "install", "-q", "--no-deps", "-e", checkout]
    subprocess.run(command, env=os.environ | {"MINIHUMAN_BUILD_CACHE": ""}, check=True)
    edited, ours = walk(checkout).splitlines(), walk(ROOT).splitlines()
    different = [line.split()[0] for line, our_line in zip(edited, ours, strict=True) if line != our_line]
    print(f"an edited kernel installs; {len(different)} of {len(ours)} worlds differ")
    if not different or any("MiniWorld" in name for name in different):
        sys.exit("it differs in no grid world, or in a world that the edit is not of")


PROOFS = {"rebuild": rebuild, "llvmlite": try_versions, "edit": install_edited}


def main() -> None:
    """Prove what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proof", choices=PROOFS)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        PROOFS[arguments.proof](Path(scratch))


if __name__ == "__main__":
    main()
