"""Screens as plain values for the page: one function a kind of screen. What they look like is the page's. No I/O.

A new kind of screen is a function here with its row, and a function of the same name in ``static/page.js``.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.study.keycaps import label
from minihuman.study.screens import (
    BlankScreen,
    Choices,
    Entry,
    FilmScreen,
    PageScreen,
    PairScreen,
    PlayScreen,
    QuestionScreen,
    Scale,
    Screen,
    Slider,
    TextScreen,
)
from minihuman.windows.keycaps import arrange

TO_COME = -1  # the number of a picture that is not drawn yet: see `reels`
Numbered = Callable[[NDArray[np.uint8]], int]  # a picture's number; it is sent before the screen


def drawn(screen: Screen, number: Numbered) -> dict[str, Any]:
    """A screen as JSON holds it: its kind, the script, and what the kind has."""
    kind, function = DRAWN[type(screen)]
    script = {"language": screen.script.language, "rtl": screen.script.rtl}
    return {"kind": kind, **script, **function(screen, number)}


def _text(screen: TextScreen, number: Numbered) -> dict[str, Any]:
    labels = {key: (cap, above) for key, cap, above in screen.labels}
    pressed = dict(screen.keys)
    caps, wide, high = arrange([key for key, _ in screen.keys])
    keys = [
        {"x": cap.x, "y": cap.y, "width": cap.width, "cap": labels[cap.key][0], "above": labels[cap.key][1]}
        | {"pressed": pressed[cap.key]}
        for cap in caps
    ]
    return {
        "title": screen.title,
        "body": screen.body,
        "prompt": screen.prompt,
        "progress": screen.progress,
        "keys": keys,
        "wide": wide,
        "high": high,
    }


def _blank(screen: BlankScreen, number: Numbered) -> dict[str, Any]:
    return {"cross": screen.cross}


def _play(screen: PlayScreen, number: Numbered) -> dict[str, Any]:
    """What is around the picture; the picture itself only where it is held, since scenes have theirs."""
    labels = {key: (cap, above) for key, cap, above in screen.labels}
    return {
        "mission": screen.mission[:1].upper() + screen.mission[1:],
        "progress": screen.progress,
        "legend": [[*labels.get(key, (label(key), "")), action] for key, action in screen.legend],
        "episode": screen.episode,
        "step": screen.step,
        "mark": screen.mark,
        "said": screen.said,
        "steers": screen.steers,
        "steers_said": screen.steers_said,
    }


def _film(screen: FilmScreen, number: Numbered) -> dict[str, Any]:
    """The episode, which the page goes through by itself; all but one of its pictures follow."""
    return {
        "prompt": screen.prompt,
        "progress": screen.progress,
        "pictures": _reel(screen.pictures, screen.step, number),
        "step": screen.step,
        "back": screen.back,
        "forward": screen.forward,
        "film": list(screen.film),
    }


def _pair(screen: PairScreen, number: Numbered) -> dict[str, Any]:
    """Both films, which the page plays by itself; all but one picture of each follow."""
    return {
        "title": screen.title,
        "prompt": screen.prompt,
        "progress": screen.progress,
        "lefts": _reel(screen.lefts, screen.step, number),
        "rights": _reel(screen.rights, screen.step, number),
        "step": screen.step,
        "period": screen.period_ns,
        "again": screen.again,
    }


def _reel(pictures: Sequence[NDArray[np.uint8]], step: int, number: Numbered) -> list[int]:
    """The number of the picture that is seen, at its place among those that are drawn later."""
    seen = min(step, len(pictures) - 1)
    return [number(pictures[place]) if place == seen else TO_COME for place in range(len(pictures))]


def _page(screen: PageScreen, number: Numbered) -> dict[str, Any]:
    return {
        "title": screen.title,
        "body": screen.body,
        "page": screen.page,
        "prompt": screen.prompt,
        "progress": screen.progress,
        "buttons": _buttons(screen),
        "picture": None if screen.picture is None else number(screen.picture),
        "marks": [[mark.x, mark.y, mark.label] for mark in screen.marks],
    }


def _question(screen: QuestionScreen, number: Numbered) -> dict[str, Any]:
    item = screen.item
    match item:
        case Choices():
            asked: dict[str, Any] = {
                "form": "choices",
                "options": list(item.options),
                "chosen": sorted(item.chosen),
                "at": item.at,
                "many": item.many,
            }
        case Scale():
            asked = {
                "form": "scale",
                "options": list(item.points),
                "low": item.low,
                "high": item.high,
                "chosen": item.chosen,
            }
        case Slider():
            asked = {
                "form": "slider",
                "low": item.low,
                "high": item.high,
                "along": item.along,
                "value": item.value,
                "ticks": item.ticks,
            }
        case Entry():
            asked = {
                "form": "entry",
                "text": item.text,
                "caret": item.caret,
                "long": item.long,
                "unit": item.unit,
            }
    return {
        "title": screen.title,
        "ask": screen.ask,
        "item": asked,
        "prompt": screen.prompt,
        "progress": screen.progress,
        "note": screen.note,
        "buttons": _buttons(screen),
    }


def _buttons(screen: PageScreen | QuestionScreen) -> list[dict[str, Any]]:
    return [{"name": button.name, "label": button.label, "enabled": button.enabled} for button in screen.buttons]


DRAWN: Mapping[type, tuple[str, Callable[[Any, Numbered], dict[str, Any]]]] = {
    TextScreen: ("text", _text),
    BlankScreen: ("blank", _blank),
    PlayScreen: ("play", _play),
    PageScreen: ("page", _page),
    QuestionScreen: ("question", _question),
    PairScreen: ("pair", _pair),
    FilmScreen: ("film", _film),
}
