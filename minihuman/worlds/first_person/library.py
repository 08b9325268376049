"""Textures and meshes, read once a process for every world that draws with them."""

import threading
from functools import cache
from pathlib import Path

from minihuman.worlds.first_person.render.assets import Library
from minihuman.worlds.first_person.render.folder import FolderAssets
from minihuman.worlds.first_person.render.own import own_library

library_lock = threading.Lock()  # hold it while a scene is laid out: that may read another texture into the library


@cache
def library(folder: str | None) -> Library:
    """The library of a folder, or of our own assets; always the same one."""
    return own_library() if folder is None else Library(FolderAssets(Path(folder)))
