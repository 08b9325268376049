"""Check that what was built can be released, and print what is left to do; nothing is uploaded and no tag is set.

    python .ci/release.py DIST            # a dry run, as CI makes it
    python .ci/release.py DIST --final    # refuses as long as the changelog says Unreleased or the tree is not clean

DIST is a folder with one sdist and a wheel for each platform, as `python -m build --outdir DIST` writes them.
"""

import argparse
import email
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SEMANTIC = re.compile(r"\d+\.\d+\.\d+(?:(?:a|b|rc)\d+)?")
SHIPPED = (  # what a wheel has beside Python files
    "minihuman/protocols/demo.toml",
    "minihuman/py.typed",
    "minihuman/web/page/page.html",
    "minihuman/web/deployment/templates/Caddyfile.j2",
    "minihuman/worlds/compiled/manifest.json",
)

NEEDED_TO_BUILD = (  # what an sdist has, to install from
    "LICENSE",
    "README.md",
    "tests/conftest.py",
    "hatch_build.py",
    "kernel_build/bitcode/kernels.bc.xz",
    "kernel_build/bitcode/manifest.json",
)


def find_problems(dist: Path, *, final: bool) -> list[str]:
    """What has to be put right before a release, one sentence each."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = read_version()
    stem = f"{project['name'].replace('-', '_')}-{version}"
    wheels, sdist = sorted(dist.glob(f"{stem}-py3-none-*.whl")), dist / f"{stem}.tar.gz"
    found = [] if wheels else [f"there is no wheel {dist / stem}-py3-none-*.whl; run: python -m build"]
    found += [] if sdist.is_file() else [f"{sdist} does not exist; run: python -m build"]
    if not SEMANTIC.fullmatch(version):
        found.append(f"minihuman/__init__.py: {version!r} is no semantic version; use major.minor.patch")
    if f"\nversion: {version}\n" not in (ROOT / "CITATION.cff").read_text(encoding="utf-8"):
        found.append(f"CITATION.cff: its version is not {version}")
    for wheel in wheels:
        found += find_wheel_problems(wheel, project, version)
    if sdist.is_file():
        with tarfile.open(sdist) as archive:
            names = {name.partition("/")[2] for name in archive.getnames()}
        found += [f"{sdist.name}: {name} is missing" for name in NEEDED_TO_BUILD if name not in names]
    heading = re.search(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    said = heading[1] if heading else ""
    if not re.fullmatch(rf"{re.escape(version)}, \d{{4}}-\d\d-\d\d", said) and (final or said != "Unreleased"):
        found.append(f"CHANGELOG.md: its first heading is {said!r}; make it '{version}, YYYY-MM-DD'")
    if final and run("git", "status", "--porcelain"):
        found.append("the tree has changes; commit them")
    if run("git", "tag", "--list", f"v{version}"):
        found.append(f"the tag v{version} exists; raise the version")
    return found


def find_wheel_problems(wheel: Path, project: dict[str, object], version: str) -> list[str]:
    """What the wheel's metadata and files lack."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        metadata = email.message_from_bytes(
            archive.read(next(name for name in names if name.endswith(".dist-info/METADATA")))
        )
    expected = {"Name": project["name"], "Version": version, "License-Expression": project["license"]}
    found = [
        f"{wheel.name}: {field} is {metadata[field]!r}, not {value!r}"
        for field, value in expected.items()
        if metadata[field] != value
    ]
    if set(str(metadata["Requires-Python"]).split(",")) != set(str(project["requires-python"]).split(",")):
        found.append(f"{wheel.name}: Requires-Python is {metadata['Requires-Python']!r}")
    if metadata["Description-Content-Type"] != "text/markdown" or not metadata.get_payload():
        found.append(f"{wheel.name}: the README is not its description")
    found += [f"{wheel.name}: {name} is missing" for name in SHIPPED if name not in names]
    return found + [f"{wheel.name}: {name} does not belong to it" for name in names if name.startswith("tests/")]


def read_version() -> str:
    """The version, from the one file that says it."""
    return re.search(r'^__version__ = "(.*)"$', (ROOT / "minihuman/__init__.py").read_text(), re.MULTILINE)[1]


def run(*words: str) -> str:
    """Run git; "" where the source is no checkout."""
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False).stdout


def main() -> None:
    """Print the problems, or what is left to do."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dist", type=Path)
    parser.add_argument("--final", action="store_true", help="no dry run")
    asked = parser.parse_args()
    if problems := find_problems(asked.dist, final=asked.final):
        print(*problems, sep="\n", file=sys.stderr)
        sys.exit(1)
    version = read_version()
    but = "" if asked.final else ", but for the changelog and the tag (--final)"
    print(f"{version} can be released{but}. Left to do:")
    print(f"  git tag -s v{version} && git push origin v{version}")
    print(f"  python -m twine upload {asked.dist}/*    # with an attestation where the host makes one")


if __name__ == "__main__":
    main()
