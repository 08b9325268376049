"""Erases files and folders durably, as far as the disk allows, and reports what could not be erased."""

import os
from collections.abc import Iterator
from pathlib import Path

from minihuman.storage.durable_files import sync_folder
from minihuman.storage.system import current_system


def erase(path: Path) -> list[OSError]:
    """Erase a file, or a folder with everything below it, so that a power cut brings nothing back.

    A file that cannot be erased does not stop the erasure of the rest. A link is erased, but not its target.

    Returns:
        An error for each file or folder that could not be erased, which names it; empty if everything was erased.
    """
    errors = list(_erase_entry(path))
    try:
        sync_folder(path.parent)  # also where nothing is left: an erasure before this one may have been cut short
    except OSError as error:
        errors.append(error)
    return errors


def _erase_entry(path: Path) -> Iterator[OSError]:
    """Erase a file, a link or a folder, and yield an error for everything that could not be erased."""
    disk = current_system().disk
    is_folder = path.is_dir() and not path.is_symlink()
    if is_folder:
        errors = list(_erase_content(path))
        yield from errors
        if errors:
            return
    try:
        if is_folder:
            disk.remove_folder(path)
        elif os.path.lexists(path):
            disk.unlink(path)
    except FileNotFoundError:  # another command erases it, too
        return
    except OSError as error:
        error.filename = os.fspath(path)
        yield error


def _erase_content(folder: Path) -> Iterator[OSError]:
    """Erase everything in a folder, and yield an error for everything that could not be erased."""
    try:
        paths = sorted(folder.iterdir())
    except OSError as error:
        error.filename = os.fspath(folder)
        yield error
        return
    errors = [error for path in paths for error in _erase_entry(path)]
    yield from errors
    if errors:  # the folder stays, and so must what was taken out of it stay out
        try:
            sync_folder(folder)
        except OSError as error:
            yield error
