"""A world's ``info`` as columns of a dataset: numbers, or texts if any value is not a number."""

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.log.model.session_log import EpisodeLog

InfoColumn = NDArray[np.float64] | list[str]


def list_info_values(episode: EpisodeLog, key: str) -> list[Any]:
    """Return the values of a key of ``info``, one per step, None where the world gave none; [] if none was recorded."""
    return [info.get(key) for info in episode.infos or ()]


def build_info_columns(episode: EpisodeLog) -> dict[str, InfoColumn]:
    """Build a column of numbers or texts for each recorded key; a missing value is NaN or ""."""
    return {key: build_info_column(list_info_values(episode, key)) for key in episode.plan.record_info}


def build_info_column(values: Sequence[Any]) -> InfoColumn:
    """Build a column of numbers if all values are numbers, else of texts, with other values encoded as JSON."""
    if not all(value is None or isinstance(value, bool | int | float) for value in values):
        return format_info_texts(values)
    numbers = [math.nan if value is None else float(value) for value in values]
    return np.array(numbers, np.float64)


def format_info_texts(values: Sequence[Any]) -> list[str]:
    """Format values as texts: strings stay as they are, None becomes "", and other values become JSON."""
    return [_format_text(value) for value in values]


def _format_text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    return json.dumps(value)


def add_reset(column: InfoColumn) -> InfoColumn:
    """Insert an empty row for the reset before the rows of the steps, because a log records no ``info`` of a reset."""
    if isinstance(column, list):
        return ["", *column]
    return np.insert(column, 0, math.nan)
