"""Promises: kept, or an error that names the one that is not."""

from minihuman.errors import MinihumanError


class ContractError(MinihumanError, AssertionError):
    """Something does not keep what everything of its kind promises."""

    exit_code = 1  # a check failed


def promise(kept: bool, broken: str) -> None:
    """Raise `ContractError`, saying what is broken, unless the promise is kept."""
    if not kept:
        raise ContractError(broken)
