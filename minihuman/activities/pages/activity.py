"""Pages: a text read page by page. A consent text must be read to its end before the participant can agree."""

import io
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.activities.pages.early_plans import find_early_pages
from minihuman.activities.pages.page_reader import BACK_KEYS, FORWARD_KEYS, PageReader, build_page_shown
from minihuman.activities.pages.plan import ExampleSpec, PagePlan
from minihuman.activities.pages.screens import build_page_screen
from minihuman.experiment.machine.activity import (
    ENTER_KEYS,
    Activity,
    ActivityKind,
    PartEnding,
    SessionContext,
    needs_no_server,
)
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.machine.inputs import Input, KeyDown, PointerPressed, ScreenShown
from minihuman.experiment.machine.points import fill_score_fields
from minihuman.experiment.machine.running_episode import catch_world_errors
from minihuman.experiment.machine.screens import PageScreen, PictureLabel
from minihuman.experiment.machine.transitions import Phase

EXAMPLE_SIZE_PX = (960, 720)  # of an example's picture in a session without a picture size


_PROMPTS: dict[StrEnum, str] = {  # of the last page
    Phase.CONSENT: "consent.prompt",
    Phase.CLOSING: "closing.prompt",
    Phase.PAGE: "go_on",
}


def _find_phase(plan: PagePlan) -> Phase:
    """Return the phase of a text: consent, the session's closing, or a plain page."""
    if plan.agree:
        return Phase.CONSENT
    if plan.closing:
        return Phase.CLOSING
    return Phase.PAGE


def _find_direction(key: str) -> int:
    """Return by how many pages a key turns: 1, -1, or 0 for any other key."""
    if key in FORWARD_KEYS:
        return 1
    if key in BACK_KEYS:
        return -1
    return 0


class PagesActivity(Activity):
    """An activity that shows a text page by page; Enter on the last page ends it."""

    can_copy = True

    def begin(self) -> None:
        """Open the first page, prepare the pages' pictures, and log the phase."""
        plan: PagePlan = self.part.plan
        self.phase = _find_phase(plan)
        self._reader = PageReader(len(plan.pages))
        self._pictures = {
            page: np.asarray(Image.open(io.BytesIO(png)).convert("RGB")) for page, png in enumerate(plan.pictures)
        }
        self._marks: tuple[PictureLabel, ...] = ()
        self._open: PageScreen | None = None
        if plan.example is not None:
            self._pictures[0], self._marks = _draw_example(self.context, plan.example)
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    def receive(self, happened: Input) -> None:
        """Handle an input: turn a page, leave the last page, or decline."""
        match happened:
            case ScreenShown():
                self.context.emit(build_page_shown(self.number, self._reader, happened))
            case KeyDown(key=key):
                has_moved = self._turn(_find_direction(key), by_enter=key in ENTER_KEYS)
                self.context.emit_key(happened, "accepted" if has_moved else "unmapped", self.phase)
                self._note_agreement()
            case PointerPressed(target="go_on"):
                self._turn(1, by_enter=True)
                self._note_agreement()
            case PointerPressed(target="back"):
                self._turn(-1, by_enter=False)
            case PointerPressed(target="decline") if self.part.plan.agree:
                self.ended = PartEnding("failed", reason="declined", detail="the participant did not agree")

    def _turn(self, direction: int, *, by_enter: bool) -> bool:
        """Turn one page forward (1) or back (-1), and return whether that had an effect; 0 turns no page.

        On the last page, Enter or its button ends the part; any other key has no effect.
        """
        if not direction:
            return False
        if self._reader.turn(direction):
            return True
        if direction > 0 and by_enter:
            self.ended = PartEnding()
            return True
        return False

    def _note_agreement(self) -> None:
        """Log the participant's agreement to the text, if the part asks for it and has just ended."""
        plan: PagePlan = self.part.plan
        if self.ended and plan.agree:
            text = f"agreed to the text with SHA-256 {plan.sha256}"
            self.context.emit(Noted(self.context.now_ns, "consent", text))

    def screen(self) -> PageScreen:
        """Return the screen of the open page, which is built when the page is opened."""
        if self._open is None or self._open.page != self._reader.page + 1:
            self._open = self._screen()
        return self._open

    def _screen(self) -> PageScreen:
        """Build the screen of the open page."""
        plan: PagePlan = self.part.plan
        words = self.context.words
        reader = self._reader
        decline_label = ""
        button = words["button.go_on"]
        if plan.agree:
            decline_label = words["consent.decline"]
            button = words["consent.button"]
        body = plan.pages[reader.page] if plan.pages else ""
        return build_page_screen(
            words,
            title=plan.title,
            decline_label=decline_label,
            body=fill_score_fields(self.context, body),
            page=reader.page,
            pages=reader.pages,
            last_prompt=words[_PROMPTS[self.phase]],
            last_button=button,
            picture=self._pictures.get(reader.page),
            marks=self._marks if reader.page == 0 else (),
        )


def _draw_example(context: SessionContext, example: ExampleSpec) -> tuple[NDArray[np.uint8], tuple[PictureLabel, ...]]:
    """Draw an example's world from above; return the picture and the labels of its marked objects.

    A world without a map has no labels.
    """
    world = context.world(example.world, example.options)
    with catch_world_errors():
        world.reset(example.seed)
        picture = world.frame("full", context.picture_px or EXAMPLE_SIZE_PX)
        floor = world.map()
        pose = world.pose()
    if floor is None:
        return picture, ()
    x_min, z_min, x_max, z_max = floor.bounds
    positions = {thing.name: (thing.x, thing.z) for thing in reversed(floor.things)}  # of equal names, the first counts
    if pose is not None:
        positions["agent"] = (pose.x, pose.z)
    labels = []
    for name, label in example.marks.items():
        if name in positions:
            x, z = positions[name]
            # positions as shares of the map's width and height
            labels.append(PictureLabel((x - x_min) / (x_max - x_min), (z - z_min) / (z_max - z_min), label))
    return picture, tuple(labels)


PAGE = ActivityKind(
    "page",
    PagePlan,
    PagesActivity,
    tables="minihuman.activities.pages.tables:PAGE_TABLES",
    find_early_parts=find_early_pages,
    find_server_needs=needs_no_server,
    is_for_players=True,
)
