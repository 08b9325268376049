"""Describes a screen in words, for participants that read it instead of seeing it."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from minihuman.experiment.machine.screens import (
    CanvasShape,
    OptionList,
    PageScreen,
    PlayScreen,
    QuestionScreen,
    RatingMatrix,
    RatingScale,
    Screen,
    ShapeCanvas,
    Slider,
    TextField,
)
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.specs import ModelSpec


def join_texts(*texts: str) -> str:
    """Join texts with blank lines between them, leaving out empty texts."""
    return "\n\n".join(text.strip() for text in texts if text.strip())


def describe_screen(screen: Screen, session: SessionMachine, spec: ModelSpec) -> Iterator[str]:
    """Yield the screen's texts, in reading order."""
    match screen:
        case PlayScreen():
            yield from filter(None, [screen.progress, screen.mission[:1].upper() + screen.mission[1:]])
            if screen.legend:
                yield ", ".join(f"{key} = {action}" for key, action in screen.legend)
            if spec.modality != "picture" and session.play is not None:
                yield session.play.world.text()
        case PageScreen():
            yield screen.prompt
        case QuestionScreen():
            yield from filter(None, [screen.progress, screen.title, screen.question, _describe_item(screen.item)])
            yield screen.note


def _number_lines(texts: Iterable[str]) -> str:
    """Return texts as lines that are numbered from 1."""
    return "\n".join(f"{number}. {text}" for number, text in enumerate(texts, 1))


def _describe_item(item: Any) -> str:
    """Describe the answers that a question's widget offers."""
    match item:
        case OptionList(options=options):
            return _number_lines(options)
        case RatingScale(points=points, low=low, high=high):
            return join_texts(_number_lines(points), f"{low} ... {high}")
        case RatingMatrix(rows=rows, points=points, low=low, high=high):
            cells = [f"{row}: {point}" for row in rows for point in points]
            return join_texts(_number_lines(cells), f"{low} ... {high}")
        case ShapeCanvas(shapes=shapes):
            return _number_lines(_describe_shape(shape) for shape in shapes if shape.target)
        case Slider(low=low, high=high):
            return f"{low} ... {high}"
        case TextField(unit=unit):
            return unit
    return ""


def _describe_shape(shape: CanvasShape) -> str:
    """Describe a shape by its label and, if it has a colour of its own, by the colour."""
    return " ".join(filter(None, [shape.label, shape.fill]))


def list_observation(session: SessionMachine) -> Any:
    """Return the observation of the world that is played, with its arrays as lists; None if it is not a dict."""
    if session.play is None:
        return None
    observation = session.play.world.observation
    if not isinstance(observation, dict):
        return None
    lists = dict(observation)
    for name, part in observation.items():
        if isinstance(part, np.ndarray | np.generic):
            lists[name] = part.tolist()
    return lists
