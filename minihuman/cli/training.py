"""What the commands that train have in common: PyTorch has to be there, and results say which command made them."""

import sys
from enum import StrEnum

from minihuman.errors import LearnError


class SightChoice(StrEnum):
    """What a clone sees."""

    view = "view"
    whole = "whole"
    remembered = "remembered"


def command_line() -> str:
    """The command that is running, as results name it."""
    return " ".join(["minihuman", *sys.argv[1:]])


def need_torch() -> None:
    """Make sure that the extra `learn` is installed.

    Raises:
        LearnError: if it is not.
    """
    try:
        import stable_baselines3  # noqa: F401
        import torch  # noqa: F401
    except ImportError:
        raise LearnError('training needs PyTorch; install it with pip install "minihuman[learn]"') from None
