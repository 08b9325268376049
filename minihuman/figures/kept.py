"""Figures as they were last drawn, kept beside the store: one that would come out the same is copied, not drawn again.

A figure follows from what its drawing is given, from the code that draws it and from the fonts that it is set in. A
digest of all three is what a kept file must have been made of.
"""

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec

import minihuman
from minihuman.data.caches import FIGURES
from minihuman.data.content import content_sha256
from minihuman.data.kept_files import KeptFiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")
_DRAWN_WITH = ("matplotlib", "numpy", "scipy", "pillow", "fonttools", "kiwisolver", "contourpy")


class KeptFigures:
    """The kept figures of one study.

    Args:
        study: its folder, which keeps them; where it is none, every figure is drawn.
    """

    def __init__(self, study: Path) -> None:
        self._files = KeptFiles(study / FIGURES, drawn_with()) if study.is_dir() else None

    def save(self, stem: Path, draw: "Callable[P, Figure]", *given: P.args, **named: P.kwargs) -> tuple[Path, Path]:
        """Write what ``draw`` draws of what it is given as ``stem``.png and ``stem``.pdf; the PNG comes first.

        Args:
            stem: where; its folder is made.
            draw: a function of a module, that looks at nothing but what it is given.
            given: to it; all that is in there tells this figure from others.
            named: the same.

        Raises:
            TypeError: if something is given that a digest cannot see into.
        """
        stem.parent.mkdir(parents=True, exist_ok=True)
        both = stem.with_name(f"{stem.name}.png"), stem.with_name(f"{stem.name}.pdf")
        of = [f"{draw.__module__}.{draw.__qualname__}", content_sha256((given, named))]
        if self._files is not None and all(self._files.take(path, of) for path in both):
            return both
        from minihuman.figures.files import faces_are_matplotlibs, save  # most of a second

        save(draw(*given, **named), stem)
        if self._files is not None and faces_are_matplotlibs():
            for path in both:
                self._files.keep(path, of)
        return both


@cache
def drawn_with() -> str:
    """A digest of what draws: all of this package's code, the libraries' versions, and Matplotlib's own fonts."""
    root = Path(minihuman.__file__).parent
    sources = [(str(path.relative_to(root)), path.read_bytes()) for path in sorted(root.rglob("*.py"))]
    [at] = find_spec("matplotlib").submodule_search_locations or [""]  # type: ignore[union-attr] # a dependency
    shipped = Path(at) / "mpl-data"
    files = [shipped / "matplotlibrc", *sorted((shipped / "fonts" / "ttf").glob("*.ttf"))]
    sizes = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    code = hashlib.sha256(b"".join(name.encode() + b"\n" + source for name, source in sources)).hexdigest()
    return content_sha256((code, [(name, version(name)) for name in _DRAWN_WITH], sizes, sys.version, sys.platform))
