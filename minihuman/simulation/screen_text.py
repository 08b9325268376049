"""Describes a screen in words, for participants that read it instead of seeing it."""

from collections.abc import Iterator
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
    """Join texts by blank lines, without the empty ones."""
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


def _describe_item(item: Any) -> str:
    match item:
        case OptionList(options=options):
            return "\n".join(f"{number}. {option}" for number, option in enumerate(options, 1))
        case RatingScale(points=points, low=low, high=high):
            return join_texts(
                "\n".join(f"{number}. {point}" for number, point in enumerate(points, 1)), f"{low} ... {high}"
            )
        case RatingMatrix(rows=rows, points=points, low=low, high=high):
            cells = enumerate(((row, point) for row in rows for point in points), 1)
            return join_texts("\n".join(f"{n}. {row}: {point}" for n, (row, point) in cells), f"{low} ... {high}")
        case ShapeCanvas(shapes=shapes):
            answers = [shape for shape in shapes if shape.target]
            return "\n".join(f"{number}. {_describe_shape(shape)}" for number, shape in enumerate(answers, 1))
        case Slider(low=low, high=high):
            return f"{low} ... {high}"
        case TextField(unit=unit):
            return unit
    return ""


def _describe_shape(shape: CanvasShape) -> str:
    """Describe a shape by its label and its colour; a label alone where the colour is the theme's."""
    return " ".join(filter(None, [shape.label, shape.fill]))


def list_observation(session: SessionMachine) -> Any:
    """Return the world's observation with its arrays as lists; None unless a world with a dict is played."""
    if session.play is None:
        return None
    observation = session.play.world.observation
    if not isinstance(observation, dict):
        return None
    return {
        name: part.tolist() if isinstance(part, np.ndarray | np.generic) else part for name, part in observation.items()
    }
