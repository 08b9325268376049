"""Textures and meshes, read once a process for every world that draws with them."""

import importlib.util
import threading
from functools import cache
from pathlib import Path

from minihuman.worlds.first_person.render.assets import Library
from minihuman.worlds.first_person.render.folder import FolderAssets

library_lock = threading.Lock()  # hold it while a scene is laid out: that may read another texture into the library


@cache
def library(folder: str | None) -> Library:
    """The library of a folder, or of our own assets."""
    if folder is None:
        spec = importlib.util.find_spec("miniworld")
        assert spec is not None
        assert spec.submodule_search_locations is not None
        folder = spec.submodule_search_locations[0]
    return Library(FolderAssets(Path(folder)))
