"""What a world said in ``info``, as columns of a data set: numbers, or texts where it said anything else."""

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.log.model.session_log import EpisodeLog

InfoColumn = NDArray[np.float64] | list[str]


def list_info_values(episode: EpisodeLog, key: str) -> list[Any]:
    """List a kept key's values, one per step; None where the world did not say."""
    return [info.get(key) for info in episode.infos or ()]


def build_info_columns(episode: EpisodeLog) -> dict[str, InfoColumn]:
    """Build a column for each kept key: numbers, NaN where there is none, or texts, "" where there is none."""
    return {key: build_info_column(list_info_values(episode, key)) for key in episode.plan.record_info}


def build_info_column(values: Sequence[Any]) -> InfoColumn:
    """Build a column of numbers; of texts, JSON where they are none themselves, where a value is no number."""
    if all(value is None or isinstance(value, bool | int | float) for value in values):
        return np.array([math.nan if value is None else float(value) for value in values], np.float64)
    return format_info_texts(values)


def format_info_texts(values: Sequence[Any]) -> list[str]:
    """Format values as texts: JSON, but for those that are texts."""
    return [_format_text(value) for value in values]


def _format_text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    return json.dumps(value)


def add_reset(column: InfoColumn) -> InfoColumn:
    """Put a reset's row before those of the steps: a log keeps no ``info`` of a reset."""
    if isinstance(column, list):
        return ["", *column]
    return np.insert(column, 0, math.nan)
