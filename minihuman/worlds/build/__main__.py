"""Build the page's modules: ``python -m minihuman.worlds.build [FOLDER]``; without one, where the page finds them."""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import minihuman
from minihuman.worlds.build.page_modules import PORTABLE, build_page_modules


def main() -> None:
    """Build, and say how large each module is."""
    folder = _read_folder()
    manifest = build_page_modules(folder)
    for module in manifest["modules"].values():
        for file in module["files"]:
            print(f"{folder / file['file']}: {file['bytes'] / 1000:.1f} kB")


def _read_folder() -> Path:
    parser = argparse.ArgumentParser("python -m minihuman.worlds.build", description="Compile the worlds for the page.")
    beside_page = Path(minihuman.__file__).parent / "web/page/worlds"
    parser.add_argument("folder", nargs="?", type=Path, default=beside_page, help="The folder of the modules.")
    folder: Path = parser.parse_args().folder
    return folder


if __name__ == "__main__":
    _read_folder()  # a mistake on the command line is reported before anything is compiled
    if any(os.environ.get(name) != value for name, value in PORTABLE.items()):
        # Numba reads them when it is imported, which was just now; and code from its cache is not to the byte what is
        # compiled anew
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, "-m", "minihuman.worlds.build", *sys.argv[1:]]
            sys.exit(subprocess.run(command, env=os.environ | PORTABLE | {"NUMBA_CACHE_DIR": cache}).returncode)
    main()
