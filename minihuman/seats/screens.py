"""Every screen of a session as a picture, without a window: what a participant will see, played through once."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from minihuman.log.record.recorder import MemoryRecorder
from minihuman.players.choose import make_player
from minihuman.players.port import Player
from minihuman.seats.run import run_session
from minihuman.seats.simulated import SimulatedWindow
from minihuman.study.inputs import Shown
from minihuman.study.plan import SessionPlan
from minihuman.study.screens import BlankScreen, PlayScreen, Screen
from minihuman.study.session import Session
from minihuman.windows.compose import Size, compose, picture_size_px
from minihuman.windows.scripted import VirtualClock
from minihuman.windows.theme import BACKGROUND, INK
from minihuman.worlds.adapt.world import World

_SEED = 1
_PLAYER = "random"
_THUMB_PX: Size = (320, 180)
_ACROSS = 5
_LABEL_PX = 22


class _Camera(SimulatedWindow):
    """A window that keeps the screens worth a picture: of play the first and the last of each block's first episode."""

    def __init__(self, player: Player, session: Session, clock: VirtualClock) -> None:
        super().__init__(player, session, clock)
        self.kept: list[tuple[str, Screen]] = []
        self._watched = session
        self._seen: set[object] = set()

    def show(self, screen: Screen) -> Shown:
        """Keep a screen that is not like one before."""
        name = str(self._watched.phase)
        if isinstance(screen, PlayScreen):
            plan = self._watched.plan.episodes[screen.episode]
            kind: object = (plan.block_name, "held" if screen.mark or name == "hold" else "playing")
            name = f"{plan.block_name}-{name}"
        else:
            kind = (name, _words(screen))
        if kind not in self._seen and not (isinstance(screen, BlankScreen) and not screen.cross):
            self._seen.add(kind)
            self.kept.append((name, screen))
        return super().show(screen)


def screens_of(plan: SessionPlan, size_px: Size) -> list[tuple[str, Screen]]:
    """The screens of a session with their phases' names, played by chance; one that comes again is kept once.

    Raises:
        Exception: what a world raised.
    """
    clock = VirtualClock()
    session = Session(plan, World, {}, picture_px=picture_size_px(size_px))
    camera = _Camera(make_player(_PLAYER, np.random.default_rng(_SEED)), session, clock)
    run_session(session, camera, MemoryRecorder(), clock)
    if session.failure is not None:
        raise session.failure
    return camera.kept


def save_screens(plan: SessionPlan, out: Path, size_px: Size = (1280, 720)) -> Iterator[Path]:
    """Write every screen as a PNG, numbered in the order in which they come, then all on one contact sheet."""
    out.mkdir(parents=True, exist_ok=True)
    pictures = []
    for number, (name, screen) in enumerate(screens_of(plan, size_px), 1):
        path = out / f"{number:03}-{name}.png"
        image = Image.fromarray(compose(screen, size_px))
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


def _words(screen: Screen) -> tuple[str, ...]:
    """What tells a screen from another: its title, text and page; not what counts down or fills."""
    return tuple(str(getattr(screen, name, "")) for name in ("title", "body", "page", "ask"))
