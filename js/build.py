"""Build the npm package: `python js/build.py [FOLDER] [--pack]`; publishing it is a person's.

The page's own modules, rules and tiles are packed as `minihuman pack` packs them; this folder adds what only other
people's pages need. Types are written by TypeScript (`npm ci` in `tests/web/page`).
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
TSC = ROOT / "tests/web/page/node_modules/typescript/bin/tsc"
SEEDS = range(20)  # of the mazes, which no page lays out; `minihuman pack` packs others


def build_package(folder: Path, *, with_types: bool = True) -> None:
    """Write the package into a folder, which is emptied first.

    Raises:
        SystemExit: if TypeScript is wanted and not here.
    """
    from minihuman.web.world_pack import pack_worlds
    from minihuman.worlds.catalogue import BABYAI_WORLDS, GRID_WORLDS, is_compiled_grid

    shutil.rmtree(folder, ignore_errors=True)
    worlds = [entry.name for entry in (*GRID_WORLDS, *BABYAI_WORLDS) if is_compiled_grid(entry.id, {})]
    pack_worlds(folder, SEEDS, worlds)
    for source in (*sorted((HERE / "src").iterdir()), ROOT / "minihuman/web/page/episode_view.js"):
        shutil.copy(source, folder)
    shutil.copy(ROOT / "LICENSE", folder)
    shutil.copy(HERE / "README.md", folder)
    modules = sorted(path.name for path in folder.glob("*.js"))
    package = json.loads((HERE / "package.json").read_text(encoding="utf-8"))
    package["files"] = [*modules, "types", "worlds", "starts", "index.z", "layouts.z", "atlas.z"]
    (folder / "package.json").write_text(json.dumps(package, indent=2) + "\n", encoding="utf-8")
    if with_types:
        _write_types(folder, modules)
    for module in modules:
        (folder / module).write_text(_strip_comments((folder / module).read_text(encoding="utf-8")), encoding="utf-8")


def _strip_comments(source: str) -> str:
    """Return a module without its JSDoc, its lines of comment and its indentation, of which the types are already made.

    A third of a module is comments, which every visitor of a page would load. Comments that bundlers read stay.
    """
    assert all(line.count("`") % 2 == 0 for line in source.splitlines()), "a text of several lines keeps its own"
    comments = r"(?m)^[ \t]*/\*\*(?:(?!\*/)[\s\S])*\*/[ \t]*\n|^[ \t]*//.*\n|/\*\* (?:(?!\*/)[\s\S])*\*/ ?|^[ \t]+|^\n"
    return re.sub(comments, "", source)


def _write_types(folder: Path, modules: list[str]) -> None:
    if not TSC.exists():
        sys.exit(f"{TSC} does not exist; run: cd tests/web/page && npm ci")
    options = ["--allowJs", "--checkJs", "--strict", "--declaration", "--emitDeclarationOnly", "--outDir", "types"]
    target = ["--target", "es2023", "--lib", "es2023,dom,dom.iterable", "--module", "esnext"]
    settings = [*options, *target, "--moduleResolution", "bundler"]
    subprocess.run(["node", str(TSC), *settings, *modules], cwd=folder, check=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=HERE / "dist")
    parser.add_argument("--pack", action="store_true", help="Run `npm pack` in it.")
    given = parser.parse_args()
    build_package(given.folder)
    print(given.folder)
    if given.pack:
        subprocess.run(["npm", "pack"], cwd=given.folder, check=True)
