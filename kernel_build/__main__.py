"""Build what the worlds are compiled to: the page's modules, or with ``--native`` the library that Python calls.

``python -m kernel_build [--native [--all | --stale | --requirements] | --bitcode] [FOLDER]``; without a folder, where
they are looked for. ``--bitcode`` writes what the library is made of wherever minihuman is installed: after an edit of
a kernel that is to be merged. See `kernel_build.bitcode`.
"""

import argparse
import sys
from pathlib import Path

from kernel_build import bitcode, library_manifest
from kernel_build.libraries import build_every_library, build_library, list_requirements
from kernel_build.linking import BuildError


def main() -> None:
    """Build what is asked for."""
    parser = argparse.ArgumentParser("python -m kernel_build", description="Compile the worlds.")
    products = parser.add_mutually_exclusive_group()
    products.add_argument("--native", action="store_true", help="The library that Python calls, for this machine.")
    products.add_argument("--bitcode", action="store_true", help="The LLVM module that every library is made of.")
    ways = parser.add_mutually_exclusive_group()
    ways.add_argument("--all", action="store_true", help="With --native: for every machine it can be built for.")
    ways.add_argument("--stale", action="store_true", help="With --native: only if what is there does not fit.")
    ways.add_argument("--requirements", action="store_true", help="With --native: print what it needs, a line each.")
    parser.add_argument("folder", nargs="?", type=Path, help="The folder to write to.")
    arguments = parser.parse_args()
    if not arguments.native and (arguments.all or arguments.stale or arguments.requirements):
        parser.error("--all, --stale and --requirements are of --native")
    try:
        if arguments.native:
            _build_native(arguments)
        elif arguments.bitcode:
            bitcode.run_numba("kernel_build.lowering", str(arguments.folder or bitcode.COMMITTED))
        else:
            folder = arguments.folder or library_manifest.PACKAGE / "web/page/worlds"
            bitcode.run_numba("kernel_build.page_modules", str(folder))
    except BuildError as error:
        sys.exit(str(error))


def _build_native(arguments: argparse.Namespace) -> None:
    folder = arguments.folder or library_manifest.LIBRARY_FOLDER
    if arguments.requirements:
        print(*list_requirements(folder), sep="\n")
    elif arguments.all:
        build_every_library(folder)
    else:
        build_library(folder, only_stale=arguments.stale)


if __name__ == "__main__":
    main()
