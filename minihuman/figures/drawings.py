"""The figures of a report by what they are drawn from. Matplotlib, most of a second, is loaded when one is drawn."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from numpy.typing import NDArray

from minihuman.recorded.episode import Episode
from minihuman.statistics.survival import Waited

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure


def learning(
    curves: "Mapping[str, NDArray[np.float64]]", *, measure: str, limits: tuple[float, float] | None
) -> "Figure":
    """One measure's learning curves, as ``learning_figure``."""
    from minihuman.figures.learning import learning_figure

    return learning_figure(curves, measure=measure, limits=limits)


def waiting(groups: Mapping[str, Waited], *, label: str) -> "Figure":
    """One question's waiting curves, as ``waiting_figure``."""
    from minihuman.figures.waiting import waiting_figure

    return waiting_figure(groups, label=label)


def paths(blocks: Sequence[tuple[str, Sequence[Episode]]]) -> "Figure":
    """One session's paths, a titled group of columns for each block, as ``session_paths``."""
    from minihuman.figures.paths import blocks_figure

    return blocks_figure(blocks)


def steering(episodes: Sequence[Episode]) -> "Figure":
    """Who steered when, as ``steering_figure``."""
    from minihuman.figures.steering import steering_figure

    return steering_figure(episodes)


def ratings(episodes: Sequence[Episode]) -> "Figure":
    """What was rated, as ``ratings_figure``."""
    from minihuman.figures.rated import ratings_figure

    return ratings_figure(episodes)
