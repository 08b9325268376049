"""Notes that a browser, an extension or a setting changed what a session's page shows, or how it is used."""

from collections.abc import Iterable
from typing import Literal

from minihuman.experiment.machine.events import Event, Noted
from minihuman.experiment.machine.transitions import Phase

_NOTE_PREFIX = "the page was altered: "
AlterationKind = Literal[
    "translation",  # the browser says that it translated the page
    "text",  # the text of a screen is not what the session shows
    "zoom",
    "forced_colors",
    "font_size",  # the browser's own, other than 16 px
    "pointer",  # a second kind of pointing device is used
]


def format_alteration(kind: AlterationKind, detail: str) -> str:
    """Return the text of a note about an alteration; ``detail`` says what was altered and may be ""."""
    return f"{_NOTE_PREFIX}{kind} {detail}".rstrip()


def read_alteration(note: Noted) -> str:
    """Return the kind and detail of the alteration that a note reports, as one text; "" for any other note."""
    match note:
        case Noted(kind="page", text=text) if text.startswith(_NOTE_PREFIX):
            return text.removeprefix(_NOTE_PREFIX)
    return ""


def list_page_alterations(events: Iterable[Event]) -> list[str]:
    """Return the alterations of a browser's page that a session's notes report, each once, in alphabetical order.

    "consent text" is among them if a text was altered or translated while the consent text was shown. Events that are
    no notes are skipped.
    """
    alterations = set()
    phase = ""
    for event in events:
        if not isinstance(event, Noted):
            continue
        if event.kind == "phase":
            phase = event.text
            continue
        alteration = read_alteration(event)
        if alteration:
            alterations.add(alteration)
            if phase == Phase.CONSENT and alteration.startswith(("text", "translation")):
                alterations.add("consent text")
    return sorted(alterations)
