"""Names of files and folders that Linux, macOS and Windows can all keep."""

from collections.abc import Iterable

_RESERVED_NAMES = frozenset(
    {"con", "prn", "aux", "nul"} | {f"{device}{number}" for device in ("com", "lpt") for number in range(10)}
)


def explain_unportable_name(name: str) -> str:
    """Say why a file or folder of this name cannot be kept on every system; "" where it can."""
    if name.partition(".")[0].casefold() in _RESERVED_NAMES:
        return "Windows reserves the name for a device"
    if name.endswith((".", " ")):
        return "Windows drops a dot or space at the end"
    if any(letter in '<>:"/\\|?*' or ord(letter) < 32 for letter in name):
        return "Windows refuses one of its characters"
    return ""


def find_case_twin(name: str, names: Iterable[str]) -> str:
    """Find the name among others that differs from this one in case only; "" if none does, or the same name is there.

    Windows, and macOS as it comes, keep one folder for both.
    """
    other_names = set(names)
    if name in other_names:
        return ""
    return next((other for other in sorted(other_names) if other.casefold() == name.casefold()), "")
