"""Builds the library of compiled worlds into wheels, and into a checkout that is installed as editable."""

import os
import subprocess
import sys

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import platform_tags

LIBRARY = "minihuman/worlds/compiled"


class LibraryHook(BuildHookInterface):  # type: ignore[type-arg]
    """Make the library of the committed bitcode, unless the one beside the worlds is theirs already.

    In a process of its own: the sources are not on this one's path, and a back end takes much memory.
    """

    def dependencies(self) -> list[str]:
        """Return what a build needs beside llvmlite: a linker where there is none, Numba where kernels were edited."""
        listed = self._run("--requirements", check=True, capture_output=True, text=True).stdout
        return listed.split()

    def initialize(self, version: str, build_data: dict[str, object]) -> None:
        """Build, and say for which machines the wheel is."""
        # elsewhere no library was ever loaded yet: Numba is among what is installed there, and compiles instead
        self._run("--stale", check=sys.platform == "linux")
        build_data["artifacts"] = [f"{LIBRARY}/*"]
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{_platform(list(platform_tags()))}"

    def _run(self, *words: str, **options: object) -> "subprocess.CompletedProcess[str]":
        path = os.pathsep.join(filter(None, [self.root, os.environ.get("PYTHONPATH")]))  # pip's has what a build needs
        environment = os.environ | {"PYTHONPATH": path}
        command = [sys.executable, "-m", "kernel_build", "--native", *words]
        return subprocess.run(command, env=environment, cwd=self.root, **options)  # type: ignore[call-overload, no-any-return]


def _platform(tags: list[str]) -> str:
    """The oldest system that the library runs on."""
    manylinux = [tag for tag in tags if tag.startswith("manylinux_2_17_")]
    return next(iter(manylinux + tags))
