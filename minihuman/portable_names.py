"""Names of files and folders that are valid on Linux, macOS and Windows."""

from collections.abc import Iterable

_RESERVED_NAMES = frozenset(
    {"con", "prn", "aux", "nul"} | {f"{device}{number}" for device in ("com", "lpt") for number in range(10)}
)


def explain_unportable_name(name: str) -> str:
    """Return why a file or folder name is not valid on every system; "" if it is."""
    if name.partition(".")[0].casefold() in _RESERVED_NAMES:
        return "Windows reserves the name for a device"
    if name.endswith((".", " ")):
        return "Windows drops a dot or space at the end"
    if any(letter in '<>:"/\\|?*' or ord(letter) < 32 for letter in name):
        return "Windows refuses one of its characters"
    return ""


def find_case_twin(name: str, names: Iterable[str]) -> str:
    """Return the first of ``names`` that differs from ``name`` only in case; "" if there is none.

    If ``name`` itself is among ``names``, the result is "", too. Windows, and macOS in its default configuration, store
    two names that differ only in case as the same folder.
    """
    unique_names = set(names)
    if name in unique_names:
        return ""
    return next((candidate for candidate in sorted(unique_names) if candidate.casefold() == name.casefold()), "")
