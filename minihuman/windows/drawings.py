"""Screens that kinds of activity bring: each has a drawing of its own, found through the registry."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

from minihuman.errors import ProtocolError
from minihuman.plugins import names
from minihuman.study.activities.port import Kind
from minihuman.study.activities.registry import GROUP, OURS, kind_of
from minihuman.windows.sheet import Sheet, Size


@dataclass(frozen=True, slots=True)
class Drawing:
    """How screens of a type are drawn: all of one, at a window's size."""

    screen: type
    draw: Callable[[Any, Size], Sheet]


def drawing_of(screen: type) -> Drawing | None:
    """How screens of that type are drawn; None where no kind says so."""
    return _ours().get(screen) or _others().get(screen)


@cache
def _ours() -> dict[type, Drawing]:
    return {drawing.screen: drawing for kind in OURS for drawing in _drawings(kind)}


@cache
def _others() -> dict[type, Drawing]:
    return {drawing.screen: drawing for kind in names(GROUP) if kind not in OURS for drawing in _drawings(kind)}


def _drawings(kind: str) -> tuple[Drawing, ...]:
    try:
        return drawings_of(kind_of(kind))
    except (ProtocolError, ImportError):  # it is not installed here, or cannot be loaded
        return ()


def drawings_of(kind: Kind) -> tuple[Drawing, ...]:
    """The drawings that a kind names."""
    module, _, name = kind.drawings.partition(":")
    return tuple(getattr(import_module(module), name)) if module else ()
