"""Erases files and folders durably, as far as the disk allows, and reports what could not be erased."""

import os
from pathlib import Path

from minihuman.storage.durable_files import sync_folder
from minihuman.storage.system import current_system


def erase(path: Path) -> list[OSError]:
    """Erase a file, or a folder with everything below it, so that a power cut brings nothing back.

    A file that cannot be erased does not stop the erasure of the other files. A link is erased, but not its target.

    Returns:
        One error, with the path, for each file or folder that could not be erased; empty if everything was erased.
    """
    errors = _erase_entry(path)
    try:
        sync_folder(path.parent)  # also if the path did not exist: an earlier erasure may have been interrupted
    except OSError as error:
        errors.append(error)
    return errors


def _erase_entry(path: Path) -> list[OSError]:
    """Erase a file, a link or a folder; return an error for each path that could not be erased."""
    disk = current_system().disk
    is_folder = path.is_dir() and not path.is_symlink()
    if is_folder:
        errors = _erase_content(path)
        if errors:
            return errors
    try:
        if is_folder:
            disk.remove_folder(path)
        elif os.path.lexists(path):
            disk.unlink(path)
    except FileNotFoundError:  # another command erases it, too
        return []
    except OSError as error:
        error.filename = os.fspath(path)
        return [error]
    return []


def _erase_content(folder: Path) -> list[OSError]:
    """Erase everything in a folder; return an error for each path that could not be erased."""
    try:
        paths = sorted(folder.iterdir())
    except OSError as error:
        error.filename = os.fspath(folder)
        return [error]
    errors = [error for path in paths for error in _erase_entry(path)]
    if errors:  # the folder stays, so the removals from it must be made durable
        try:
            sync_folder(folder)
        except OSError as error:
            errors.append(error)
    return errors
