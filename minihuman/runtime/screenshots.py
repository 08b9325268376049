"""Screenshots of every screen of a participant's sessions, without a window.

A session is played twice: by a player that follows the shortest path to the end, and by one that presses random keys,
which shows the screens of participants who make mistakes. If a world has no planner, another player that presses random
keys replaces the first one.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
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
from minihuman.runtime.session_loop import describe_world_failure, run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World

_SEED = 1
_VISITS = (("optimal", 0), ("random", 10))  # the player, and how many of its answers in ten are random
_WITHOUT_PLANNER = ("random", 0)  # replaces the first in a world without a planner
_AMOUNT = re.compile(r"\u200e?[-\u2212]?\d[\d.,]*")
_THUMB_PX: Size = (320, 180)
_SHEET_COLUMNS = 5
_LABEL_PX = 22
_LABEL_FONT_PX = 14
_MARGIN_PX = 4  # around each cell of the sheet


class _Camera(SimulatedWindow):
    """A window that collects distinct screens; during play, one screen per block and one per block's outcome.

    Args:
        screens: receives the screens with the names of their phases.
        screen_kinds: the descriptions of the screens kept so far; a screen with the same description is not kept again.
        parts: receives the number of each part that shows a screen.
        session: the session that is shown.
        clock: the session's clock.
        player: the name of the simulated participant.
        wrong_in_ten: how many in ten answers are random, as in ``SimulatedWindow``.
    """

    def __init__(
        self,
        screens: list[tuple[str, Screen]],
        screen_kinds: set[object],
        parts: set[int],
        session: SessionMachine,
        clock: VirtualClock,
        *,
        player: str,
        wrong_in_ten: int,
    ) -> None:
        participant = make_participant(player, np.random.default_rng(_SEED))
        super().__init__(participant, session, clock, wrong_in_ten=wrong_in_ten)
        self._screens = screens
        self._watched = session
        self._screen_kinds = screen_kinds
        self._parts = parts

    def show(self, screen: Screen) -> ScreenShown:
        """Keep a screen whose description differs from those of all screens kept so far."""
        name = str(self._watched.phase)
        self._parts.add(self._watched.part.number)
        if isinstance(screen, PlayScreen):
            plan = self._watched.plan.episodes[screen.episode]
            state = f"held {screen.mark}" if screen.mark or name == "hold" else "playing"
            kind: object = (plan.block_name, state)
            name = f"{plan.block_name}-{name}"
        else:
            kind = (name, _list_texts(screen, masks_amounts=name in ("feedback", "closing")))
        is_empty = isinstance(screen, BlankScreen) and not screen.cross
        if kind not in self._screen_kinds and not is_empty:
            self._screen_kinds.add(kind)
            self._screens.append((name, screen))
        return super().show(screen)


def render_screens(plans: Sequence[SessionPlan], size_px: Size) -> tuple[list[tuple[str, Screen]], tuple[str, ...]]:
    """Play sessions and collect their distinct screens, with the names of their phases.

    ``size_px`` is the width and height for which the screens are made.

    Returns:
        The screens, and the names of the parts that no player reached.

    Raises:
        WorldError: if a world failed.
    """
    screens: list[tuple[str, Screen]] = []
    screen_kinds: set[object] = set()
    missing: list[str] = []
    for plan in plans:
        parts: set[int] = set()
        visits = list(_VISITS)
        for player, wrong_in_ten in visits:
            clock = VirtualClock()
            session = SessionMachine(plan, World, {}, picture_px=picture_size_px(size_px))
            camera = _Camera(screens, screen_kinds, parts, session, clock, player=player, wrong_in_ten=wrong_in_ten)
            try:
                run_session(session, camera, MemoryRecorder(), clock)
            except SimulationError:  # a world without a planner
                if player == _VISITS[0][0]:
                    visits.append(_WITHOUT_PLANNER)  # the loop goes on to it, as the list grows
            if session.failure is not None:
                raise describe_world_failure(session, None) from session.failure
        missing += [part.name for number, part in enumerate(plan.parts) if number not in parts]
    return screens, tuple(dict.fromkeys(missing))  # each once, though several sessions may have the part


@dataclass(frozen=True, slots=True)
class Screenshots:
    """The pictures of a participant's sessions.

    Attributes:
        screens: a PNG of each screen, numbered in the order in which the screens appear.
        sheet: the contact sheet with all screens.
        missing: the parts that no simulated participant reached.
    """

    screens: tuple[Path, ...]
    sheet: Path
    missing: tuple[str, ...]


def save_screenshots(plans: Sequence[SessionPlan], out: Path, size_px: Size = (1280, 720)) -> Screenshots:
    """Write every screen of the sessions as a PNG of ``size_px``, width and height, and a contact sheet of them all."""
    out.mkdir(parents=True, exist_ok=True)
    screens, missing = render_screens(plans, size_px)
    pictures = []
    paths = []
    for number, (name, screen) in enumerate(screens, 1):
        path = out / f"{number:03}-{name}.png"
        image = Image.fromarray(compose_screen(screen, size_px))
        image.save(path)
        pictures.append((path.stem, image.resize(_THUMB_PX)))
        paths.append(path)
    sheet = out / "contact-sheet.png"
    _draw_contact_sheet(pictures).save(sheet)
    return Screenshots(tuple(paths), sheet, missing)


def _draw_contact_sheet(pictures: list[tuple[str, Image.Image]]) -> Image.Image:
    """Draw all pictures on one sheet, each below its name."""
    thumb_width, thumb_height = _THUMB_PX
    cell_width = thumb_width + 2 * _MARGIN_PX
    cell_height = thumb_height + _LABEL_PX + 2 * _MARGIN_PX
    columns = min(_SHEET_COLUMNS, max(1, len(pictures)))
    rows = max(1, math.ceil(len(pictures) / _SHEET_COLUMNS))
    sheet = Image.new("RGB", (columns * cell_width, rows * cell_height), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    for index, (name, image) in enumerate(pictures):
        row, column = divmod(index, _SHEET_COLUMNS)
        x_px = column * cell_width + _MARGIN_PX
        y_px = row * cell_height + _MARGIN_PX
        draw.text((x_px, y_px), name, fill=INK, font=ImageFont.load_default(_LABEL_FONT_PX))
        sheet.paste(image, (x_px, y_px + _LABEL_PX))
    return sheet


def _list_texts(screen: Screen, *, masks_amounts: bool) -> tuple[str, ...]:
    """Return a screen's title, text, page and question, with all amounts replaced by 0 if ``masks_amounts`` is true."""
    words = tuple(str(getattr(screen, name, "")) for name in ("title", "body", "page", "question"))
    if masks_amounts:
        return tuple(_AMOUNT.sub("0", text) for text in words)
    return words
