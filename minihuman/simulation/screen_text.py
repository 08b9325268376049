"""Describes a screen in words, for participants that read it instead of seeing it."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from minihuman.experiment.machine.screens import PageScreen, PlayScreen, QuestionScreen, Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.specs import ModelSpec


def join_texts(*texts: str) -> str:
    """Join texts with blank lines between them, leaving out empty texts."""
    return "\n\n".join(text.strip() for text in texts if text.strip())


def list_screen_texts(screen: Screen, session: SessionMachine, spec: ModelSpec) -> Iterator[str]:
    """Yield the texts of a screen, in reading order; they may be empty.

    A world in play is described in words unless the modality of ``spec``, the model's settings, is "picture".
    """
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
            yield from filter(None, [screen.progress, screen.title, screen.question, screen.item.description])
            yield screen.note


def list_observation(session: SessionMachine) -> Any:
    """Return the observation of the world that is played, with its arrays as lists; None if it is not a dict.

    It is also None if no episode is running.
    """
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
