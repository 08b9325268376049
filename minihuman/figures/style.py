"""How our figures look: sizes, colours and text that can be read in a journal's column.

Colours are Okabe and Ito's eight, told apart with every common kind of colour blindness; time runs along cividis,
which reads the same with and without colour vision and in grey print.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from minihuman.recorded.episode import CUT_OFF

COLUMN_CM = 8.5  # one column of a two-column page
PAGE_CM = 17.5  # both columns

WALL = "#3b3b3b"
FLOOR = "#f7f6f2"
QUIET = "#8a8a8a"
START = "#ffffff"
END = "#d55e00"
GOAL = "#009e73"
SERIES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000")
OUTCOME_COLOURS = {
    "goal": "#009e73",
    "timeout": "#e69f00",
    "failure": "#d55e00",
    "abandoned": "#cc79a7",
    CUT_OFF: "#8a8a8a",
}
OUTCOME_MARKERS = {"goal": "o", "timeout": "s", "failure": "X", "abandoned": "v", CUT_OFF: "P"}
TIME_COLOURS = "cividis"

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 7.0,
    "axes.titlesize": 7.0,
    "axes.labelsize": 7.0,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6.5,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.2,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.dpi": 100,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,
    "svg.hashsalt": "minihuman",
}


@contextmanager
def our_style() -> Iterator[None]:
    """Matplotlib's settings for the figures drawn inside, whatever the user's own are; put back on the way out."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def blank(*, width_cm: float = COLUMN_CM, height_cm: float) -> Figure:
    """An empty figure of that size, its layout worked out when it is saved."""
    return Figure(figsize=(width_cm / 2.54, height_cm / 2.54), layout="constrained")
