"""What the page says around a session: waiting, refusals, the end."""

import tomllib
from functools import cache
from importlib.resources import files

from minihuman.study.words import ENGLISH


@cache
def all_said() -> dict[str, dict[str, str]]:
    """By language, by key."""
    return tomllib.loads(files(__package__).joinpath("said.toml").read_text(encoding="utf-8"))


def said(language: str) -> dict[str, str]:
    """What the page says in a language; English where it is none of ours."""
    return all_said().get(language, all_said()[ENGLISH])
