"""Screenshots of every screen of a session, without a window.

The session is played twice: by a player that knows the way and reaches the end, and by one that does not, which shows
what participants see who make mistakes.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from minihuman.display.drawing.screen import compose_screen, picture_size_px
from minihuman.display.drawing.sheet import BACKGROUND, INK, Size
from minihuman.display.windows.window import VirtualClock
from minihuman.errors import SimulationError
from minihuman.experiment.machine.inputs import ScreenShown
from minihuman.experiment.machine.screens import BlankScreen, PlayScreen, Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_session import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World

_SEED = 1
_VISITS = (("optimal", 0), ("random", 10))  # who plays, and how many answers in ten are given without thinking
_SUM = re.compile(r"\u200e?[-\u2212]?\d[\d.,]*")
_THUMB_PX: Size = (320, 180)
_ACROSS = 5
_LABEL_PX = 22


class _Camera(SimulatedWindow):
    """A window that keeps the screens worth a picture: of play each block's first, and its last for each outcome.

    Args:
        kept: gets the screens with their phases' names.
        seen: what tells those from others; a screen like one of them is not kept.
        session: the session that it shows.
        clock: the session's.
        player: the name of who sits in front of it.
        wrong_in_ten: as ``SimulatedWindow``.
    """

    def __init__(
        self,
        kept: list[tuple[str, Screen]],
        seen: set[object],
        session: SessionMachine,
        clock: VirtualClock,
        *,
        player: str,
        wrong_in_ten: int,
    ) -> None:
        made = make_participant(player, np.random.default_rng(_SEED))
        super().__init__(made, session, clock, wrong_in_ten=wrong_in_ten)
        self._kept = kept
        self._watched = session
        self._seen = seen

    def show(self, screen: Screen) -> ScreenShown:
        """Keep a screen that is not like one before."""
        name = str(self._watched.phase)
        if isinstance(screen, PlayScreen):
            plan = self._watched.plan.episodes[screen.episode]
            kind: object = (plan.block_name, f"held {screen.mark}" if screen.mark or name == "hold" else "playing")
            name = f"{plan.block_name}-{name}"
        else:
            kind = (name, _words(screen, but_sums=name in ("feedback", "closing")))
        if kind not in self._seen and not (isinstance(screen, BlankScreen) and not screen.cross):
            self._seen.add(kind)
            self._kept.append((name, screen))
        return super().show(screen)


def render_screens(plan: SessionPlan, size_px: Size) -> list[tuple[str, Screen]]:
    """The screens of a session with their phases' names; one that comes again is kept once.

    Raises:
        Exception: what a world raised.
    """
    kept: list[tuple[str, Screen]] = []
    seen: set[object] = set()
    for player, wrong_in_ten in _VISITS:
        clock = VirtualClock()
        session = SessionMachine(plan, World, {}, picture_px=picture_size_px(size_px))
        camera = _Camera(kept, seen, session, clock, player=player, wrong_in_ten=wrong_in_ten)
        with suppress(SimulationError):  # a world without a planner: the second visit has to do
            run_session(session, camera, MemoryRecorder(), clock)
        if session.failure is not None:
            raise session.failure
    return kept


def save_screenshots(plan: SessionPlan, out: Path, size_px: Size = (1280, 720)) -> Iterator[Path]:
    """Write every screen as a PNG, numbered in the order in which they come, then all on one contact sheet."""
    out.mkdir(parents=True, exist_ok=True)
    pictures = []
    for number, (name, screen) in enumerate(render_screens(plan, size_px), 1):
        path = out / f"{number:03}-{name}.png"
        image = Image.fromarray(compose_screen(screen, size_px))
        image.save(path)
        pictures.append((path.stem, image.resize(_THUMB_PX)))
        yield path
    sheet = out / "contact-sheet.png"
    _contact_sheet(pictures).save(sheet)
    yield sheet


def _contact_sheet(pictures: list[tuple[str, Image.Image]]) -> Image.Image:
    wide, high = _THUMB_PX[0] + 8, _THUMB_PX[1] + _LABEL_PX + 8
    rows = -(-len(pictures) // _ACROSS)
    sheet = Image.new("RGB", (min(_ACROSS, max(1, len(pictures))) * wide, max(1, rows) * high), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    for place, (name, image) in enumerate(pictures):
        left, top = place % _ACROSS * wide + 4, place // _ACROSS * high + 4
        draw.text((left, top), name, fill=INK, font=ImageFont.load_default(14))
        sheet.paste(image, (left, top + _LABEL_PX))
    return sheet


def _words(screen: Screen, *, but_sums: bool) -> tuple[str, ...]:
    """What tells a screen from another: its title, text and page; not what counts down, fills or was earned."""
    words = tuple(str(getattr(screen, name, "")) for name in ("title", "body", "page", "question"))
    return tuple(_SUM.sub("0", text) for text in words) if but_sums else words
