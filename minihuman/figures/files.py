"""Figures to files: the same data gives the same bytes, with no dates and no program versions inside."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont
from matplotlib.text import Text

from minihuman.figures.style import our_style

_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}


def save_png(figure: Figure, path: Path, *, dpi: int = 150) -> Path:
    """Write a picture to be looked at, making the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with our_style():
        _lay_out(figure, dpi=dpi)
        FigureCanvasAgg(figure).print_figure(str(path), metadata=_METADATA["png"], dpi=dpi)
    return path


def save(figure: Figure, stem: Path) -> tuple[Path, Path]:
    """Write ``stem``.png at 300 dots an inch and ``stem``.pdf, making the folder; the PNG comes first."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    png, pdf = stem.with_name(stem.name + ".png"), stem.with_name(stem.name + ".pdf")
    with our_style():
        _lay_out(figure, dpi=300)  # the places worked out for the PNG are the PDF's
        FigureCanvasAgg(figure).print_figure(str(png), metadata=_METADATA["png"], dpi=300)
        FigureCanvasPdf(figure).print_figure(str(pdf), metadata=_METADATA["pdf"])
    return png, pdf


def faces_are_matplotlibs() -> bool:
    """Whether text is set in the faces that come with Matplotlib, not in others of their name on this machine."""
    with our_style():
        faces = [Path(findfont(FontProperties(weight=weight))) for weight in ("normal", "bold")]
    return all(face.is_relative_to(mpl.get_data_path()) for face in faces)


def _lay_out(figure: Figure, *, dpi: int) -> None:
    """Work out once where everything is; a figure that still has a layout engine is drawn twice for each file.

    "fi" and the like stay two letters, as Matplotlib before 3.11 drew them: a PDF can be searched for them, and does
    not need a second subset of the face for a sign that stands for two.
    """
    for text in figure.findobj(Text):
        if hasattr(text, "set_fontfeatures"):
            text.set_fontfeatures(("-liga",))
    engine, own_dpi = figure.get_layout_engine(), figure.dpi
    FigureCanvasAgg(figure)
    figure.dpi = dpi
    if engine is not None and figure.axes:
        engine.execute(figure)
    figure.set_layout_engine(None)
    figure.dpi = own_dpi
