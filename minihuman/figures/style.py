"""The style of our figures and how they are saved: the same data gives the same bytes, without dates or versions.

Sizes and text fit a journal's column. Colours are Okabe and Ito's eight, distinguishable with every common kind of
colour blindness; time runs along cividis, which reads the same with and without colour vision and in grey print.
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
    """Set Matplotlib for the figures drawn inside, whatever the user's own settings are; put them back at the end."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def new_figure(*, width_cm: float = COLUMN_CM, height_cm: float) -> Figure:
    """Make an empty figure of that size, its layout worked out when it is saved."""
    return Figure(figsize=(width_cm / 2.54, height_cm / 2.54), layout="constrained")


def label_panel(ax: Axes, place: int) -> None:
    """Write a panel's letter outside its upper left corner: A for the first."""
    letter = chr(ord("A") + place)
    ax.annotate(
        letter, (0, 1), (-10, 5), "axes fraction", textcoords="offset points", ha="right", weight="bold", size=9
    )


_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}


def save_png(figure: Figure, path: Path, *, dpi: int = 150) -> Path:
    """Write a picture to be looked at, making the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with figure_style():
        _lay_out(figure, dpi=dpi)
        FigureCanvasAgg(figure).print_figure(str(path), metadata=_METADATA["png"], dpi=dpi)
    return path


def save_figure(figure: Figure, stem: Path, *, digest: str = "") -> tuple[Path, Path]:
    """Write ``stem``.png at 300 dots an inch and ``stem``.pdf, making the folder; the PNG comes first.

    A ``digest`` of what they show is in their metadata, under "Keywords".
    """
    stem.parent.mkdir(parents=True, exist_ok=True)
    png = stem.with_name(stem.name + ".png")
    pdf = stem.with_name(stem.name + ".pdf")
    keywords = {"Keywords": f"minihuman {digest}"} if digest else {}
    with figure_style():
        _lay_out(figure, dpi=300)  # the places worked out for the PNG are the PDF's
        FigureCanvasAgg(figure).print_figure(str(png), metadata=_METADATA["png"] | keywords, dpi=300)
        with _slim_fonts():
            FigureCanvasPdf(figure).print_figure(str(pdf), metadata=_METADATA["pdf"] | keywords)
    return png, pdf


_SHAPING_TABLES = ("GDEF", "GPOS", "GSUB", "MATH", "kern")  # a PDF says itself which glyph is where


@contextmanager
def _slim_fonts() -> Iterator[None]:
    """Embed fonts without the tables that no PDF reader uses: reading them took half the time of writing a PDF.

    They are gone before a font is made smaller, which reads them before it asks what to drop. Matplotlib loads fonts by
    this function of fontTools. If it should not any more, files are larger and written more slowly, and nothing else
    changes.
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
    """Work out once where everything is; a figure that still has a layout engine is drawn twice for each file.

    "fi" and the like stay two letters, as Matplotlib before 3.11 drew them: a PDF can be searched for them, and does
    not need a second subset of the face for a sign that stands for two.
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
