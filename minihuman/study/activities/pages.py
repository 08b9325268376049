"""Pages: a text to read, page by page, forward and back; one that is to be agreed to is read to its end first."""

import io
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.study import texts
from minihuman.study.activities.port import Activity, Ended, Kind
from minihuman.study.events import Noted, PageShown
from minihuman.study.inputs import Input, KeyDown, PointerPressed, Shown
from minihuman.study.phases import Phase
from minihuman.study.play import world_calls
from minihuman.study.screens import PageScreen, Pointed
from minihuman.study.stage import ENTER, Stage

FORWARD = (*ENTER, "right", "page_down", "space")
BACK = ("left", "page_up", "backspace")
EXAMPLE_PX = (960, 720)


class Example(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A picture of a world, with words at some of its things."""

    world: str
    options: dict[str, Any] = {}
    seed: int = 0
    marks: dict[str, str] = {}  # "agent" or a thing's name -> what is written beside it


class PagePlan(msgspec.Struct, frozen=True):
    """A text in pages, broken by measured height when the plan was made."""

    title: str
    pages: tuple[str, ...]
    agree: bool = False  # Enter on the last page means agreement
    sha256: str = ""  # of the whole text that is agreed to
    closing: bool = False  # the session's last words
    pictures: tuple[bytes, ...] = ()  # PNG, one a page from the first; more pages than pictures have none
    example: Example | None = None  # drawn on the first page


class Reader:
    """Which page is open, and which were: shared by every text that has pages."""

    def __init__(self, pages: int) -> None:
        self.pages = max(1, pages)
        self.page = 0
        self.furthest = 0

    @property
    def at_end(self) -> bool:
        """Whether the last page is open."""
        return self.page == self.pages - 1

    def turn(self, by: int) -> bool:
        """Open the next or the previous page; False if there is none."""
        page = self.page + by
        if not 0 <= page < self.pages:
            return False
        self.page = page
        self.furthest = max(self.furthest, page)
        return True


class Pages(Activity):
    """Shows a text; on its last page Enter goes on."""

    def begin(self) -> None:
        """Open the first page."""
        plan: PagePlan = self.part.plan
        self.phase = Phase.CONSENT if plan.agree else Phase.CLOSING if plan.closing else Phase.PAGE
        self._reader = Reader(len(plan.pages))
        self._pictures = {number: _decoded(png) for number, png in enumerate(plan.pictures)}
        self._marks: tuple[Pointed, ...] = ()
        self._open: PageScreen | None = None
        if plan.example is not None:
            self._pictures[0], self._marks = _drawn(self.stage, plan.example)
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))

    def receive(self, happened: Input) -> None:
        """Turn a page, or go on from the last."""
        match happened:
            case Shown():
                self.stage.say(page_shown(self.number, self._reader, happened))
            case KeyDown(key=key):
                verdict = self._moved(1 if key in FORWARD else -1 if key in BACK else 0, by_enter=key in ENTER)
                self.stage.say_key(happened, "accepted" if verdict else "unmapped", self.phase)
                self._note_agreement()
            case PointerPressed(target="go_on"):
                self._moved(1, by_enter=True)
                self._note_agreement()
            case PointerPressed(target="back"):
                self._moved(-1, by_enter=False)
            case PointerPressed(target="decline") if self.part.plan.agree:
                self.ended = Ended("failed", reason="declined", detail="the participant did not agree")

    def _moved(self, by: int, *, by_enter: bool) -> bool:
        """Whether it led anywhere. The last page is left by Enter or its button only, never by an arrow too many."""
        if not by:
            return False
        if self._reader.turn(by):
            return True
        if by > 0 and by_enter:
            self.ended = Ended()
            return True
        return False

    def _note_agreement(self) -> None:
        plan: PagePlan = self.part.plan
        if self.ended and plan.agree:
            text = f"agreed to the text with SHA-256 {plan.sha256}"
            self.stage.say(Noted(self.stage.now_ns, "consent", text))

    def screen(self) -> PageScreen:
        """The open page."""
        if self._open is None or self._open.page != self._reader.page + 1:
            self._open = self._screen()
        return self._open

    def _screen(self) -> PageScreen:
        plan: PagePlan = self.part.plan
        words, reader = self.stage.words, self._reader
        last = "consent.prompt" if plan.agree else "closing.prompt" if plan.closing else "go_on"
        return texts.page(
            words,
            title=plan.title,
            declining=words["consent.decline"] if plan.agree else "",
            body=texts.with_score(self.stage, plan.pages[reader.page] if plan.pages else ""),
            page=reader.page,
            pages=reader.pages,
            last=words[last],
            button=words["consent.button"] if plan.agree else words["button.go_on"],
            picture=self._pictures.get(reader.page),
            marks=self._marks if reader.page == 0 else (),
        )


def page_shown(part: int, reader: Reader, shown: Shown) -> PageShown:
    """Say that the open page reached the display."""
    return PageShown(shown.t_ns, part, reader.page + 1, reader.pages, shown.submit_ns, shown.flip_ns)


def _decoded(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def _drawn(stage: Stage, example: Example) -> tuple[NDArray[np.uint8], tuple[Pointed, ...]]:
    """The world from above, and where in it the marked things are."""
    world = stage.world(example.world, example.options)
    with world_calls():
        world.reset(example.seed)
        picture = world.frame("full", stage.picture_px or EXAMPLE_PX)
        floor, pose = world.map(), world.pose()
    if floor is None:
        return picture, ()
    x0, z0, x1, z1 = floor.bounds
    places = {thing.name: (thing.x, thing.z) for thing in reversed(floor.things)}
    if pose is not None:
        places["agent"] = (pose.x, pose.z)
    return picture, tuple(
        Pointed((places[name][0] - x0) / (x1 - x0), (places[name][1] - z0) / (z1 - z0), label)
        for name, label in example.marks.items()
        if name in places
    )


PAGE = Kind("page", PagePlan, Pages)
