"""The style of our figures, and how they are saved: equal data give equal bytes, without dates or versions.

Sizes and text fit a journal's column. Colours are Okabe and Ito's eight, distinguishable with every common kind of
colour blindness. Time is drawn in cividis, which reads the same with and without colour vision and in grey print.
PNG files have 300 dots per inch.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from fontTools import subset
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.text import Text

from minihuman.log.model.session_log import CUT_OFF

COLUMN_CM = 8.5  # one column of a two-column page
PAGE_CM = 17.5  # both columns
_CM_PER_INCH = 2.54

WALL = "#3b3b3b"
FLOOR = "#f7f6f2"
MUTED = "#8a8a8a"
PARTNERS = ("#CC79A7", "#56B4E9", "#E69F00", "#009E73", "#F0E442", "#D55E00", "#999999")  # other bodies of a team
START = "#ffffff"
END = "#d55e00"
GOAL = "#009e73"
SERIES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000")
OUTCOME_COLOURS = {
    "goal": "#009e73",
    "timeout": "#e69f00",
    "failure": "#d55e00",
    "abandoned": "#cc79a7",
    "agent_failed": "#000000",
    "ended": "#56b4e9",
    CUT_OFF: "#8a8a8a",
}
OUTCOME_MARKERS = {
    "goal": "o",
    "timeout": "s",
    "failure": "X",
    "abandoned": "v",
    "agent_failed": "*",
    "ended": "D",
    CUT_OFF: "P",
}
TIME_COLOURS = "cividis"
OCCUPANCY_COLOURS = "BuPu"  # from pale to dark: the eye goes to what there is much of, in print and in greys, too

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 7.0,
    "axes.titlesize": 7.0,
    "figure.titlesize": 7.5,
    "figure.titleweight": "bold",
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
def figure_style() -> Iterator[None]:
    """Apply minihuman's Matplotlib settings to the figures drawn in this context, then restore the user's settings."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def new_figure(*, width_cm: float = COLUMN_CM, height_cm: float) -> Figure:
    """Return an empty figure of the given size, whose layout is computed when it is saved."""
    return Figure(figsize=(width_cm / _CM_PER_INCH, height_cm / _CM_PER_INCH), layout="constrained")


def label_panel(ax: Axes, index: int) -> None:
    """Write the letter of a panel outside its upper left corner, A for the first panel, whose index is 0."""
    letter = chr(ord("A") + index)
    ax.annotate(
        letter, (0, 1), (-10, 5), "axes fraction", textcoords="offset points", ha="right", weight="bold", size=9
    )


_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}


def save_png(figure: Figure, path: Path, *, dpi: int = 150) -> Path:
    """Write a figure as a PNG file for the screen, creating the folder if necessary; return the file's path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with figure_style():
        _lay_out(figure, dpi=dpi)
        FigureCanvasAgg(figure).print_figure(str(path), metadata=_METADATA["png"], dpi=dpi)
    return path


def save_figure(figure: Figure, stem: Path, *, digest: str = "") -> tuple[Path, Path]:
    """Write ``stem``.png at 300 dots per inch and ``stem``.pdf, creating the folder if necessary.

    The metadata of both files contain the ``digest`` of the figure's data under "Keywords", unless it is "".

    Returns:
        The paths of the PNG and the PDF file.
    """
    stem.parent.mkdir(parents=True, exist_ok=True)
    png = stem.with_name(stem.name + ".png")
    pdf = stem.with_name(stem.name + ".pdf")
    keywords = {"Keywords": f"minihuman {digest}"} if digest else {}
    with figure_style():
        _lay_out(figure, dpi=300)  # the PDF has the same layout as the PNG
        FigureCanvasAgg(figure).print_figure(str(png), metadata=_METADATA["png"] | keywords, dpi=300)
        with _slim_fonts():
            FigureCanvasPdf(figure).print_figure(str(pdf), metadata=_METADATA["pdf"] | keywords)
    return png, pdf


_SHAPING_TABLES = ("GDEF", "GPOS", "GSUB", "MATH", "kern")  # a PDF says itself which glyph is where


@contextmanager
def _slim_fonts() -> Iterator[None]:
    """Embed fonts without tables that no PDF reader uses; reading them took half the time of writing a PDF.

    The tables are removed before the font is subset, because subsetting reads them before it asks what to drop.
    Matplotlib loads fonts with this function of fontTools. If that ever changes, files become larger and are written
    more slowly, but nothing else changes.
    """
    load_font = subset.load_font

    def load_slim_font(*arguments: Any, **settings: Any) -> Any:
        font = load_font(*arguments, **settings)
        for table in _SHAPING_TABLES:
            if table in font:
                del font[table]
        return font

    subset.load_font = load_slim_font
    try:
        yield
    finally:
        subset.load_font = load_font


def _lay_out(figure: Figure, *, dpi: int) -> None:
    """Compute the layout of a figure once; a figure that keeps its layout engine is drawn twice for each file.

    Ligatures such as "fi" stay two letters, as Matplotlib before 3.11 drew them: the text of a PDF can then be
    searched, and the PDF needs no second subset of the font for ligatures.
    """
    for text in figure.findobj(Text):
        if hasattr(text, "set_fontfeatures"):
            text.set_fontfeatures(("-liga",))
    engine = figure.get_layout_engine()
    own_dpi = figure.dpi
    FigureCanvasAgg(figure)
    figure.dpi = dpi
    if engine is not None and figure.axes:
        engine.execute(figure)
    figure.set_layout_engine(None)
    figure.dpi = own_dpi
