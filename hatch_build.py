"""Builds the library of compiled worlds into wheels, and into a checkout that is installed as editable."""

import os
import shutil
import subprocess
import sys

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import platform_tags

LIBRARY = "minihuman/worlds/compiled"
LINKERS = {"linux": ("ld.lld", "ld"), "darwin": ("ld64.lld", "cc"), "win32": ("lld-link",)}


class LibraryHook(BuildHookInterface):  # type: ignore[type-arg]
    """Whatever installs minihuman compiles its worlds, unless the library beside them is theirs already."""

    def dependencies(self) -> list[str]:
        """A linker from PyPI, where the machine has none."""
        return [] if any(map(shutil.which, LINKERS.get(sys.platform, ()))) else ["ziglang>=0.13"]

    def initialize(self, version: str, build_data: dict[str, object]) -> None:
        """Build, and say for which machines the wheel is."""
        path = os.pathsep.join(filter(None, [self.root, os.environ.get("PYTHONPATH")]))  # pip's has what a build needs
        environment = os.environ | {"PYTHONPATH": path}
        command = [sys.executable, "-m", "kernel_build", "--native", "--stale"]
        # elsewhere no library was ever loaded yet: Numba is among what is installed there, and compiles instead
        subprocess.run(command, env=environment, check=sys.platform == "linux")
        build_data["artifacts"] = [f"{LIBRARY}/*"]
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{_platform(list(platform_tags()))}"


def _platform(tags: list[str]) -> str:
    """The oldest system that the library runs on."""
    manylinux = [tag for tag in tags if tag.startswith("manylinux_2_17_")]
    return next(iter(manylinux + tags))
