"""Notes that a browser, an extension or a setting changed what a session's page shows, or how it is used."""

from collections.abc import Iterable
from typing import Literal

from minihuman.experiment.machine.events import Event, Noted
from minihuman.experiment.machine.transitions import Phase

_BEGINNING = "the page was altered: "
AlterationKind = Literal[
    "translation",  # the browser says that it translated the page
    "text",  # the text of a screen is not what the session shows
    "zoom",
    "forced_colors",
    "font_size",  # the browser's own, other than 16 px
    "pointer",  # a second kind of pointing device is used
]


def format_alteration(kind: AlterationKind, detail: str) -> str:
    """Return the text of a note about an alteration."""
    return f"{_BEGINNING}{kind} {detail}".rstrip()


def read_alteration(note: Noted) -> str:
    """Return the kind and detail of the alteration that a note is about; "" if it is about something else."""
    match note:
        case Noted(kind="page", text=text) if text.startswith(_BEGINNING):
            return text.removeprefix(_BEGINNING)
    return ""


def list_page_alterations(notes: Iterable[Event]) -> list[str]:
    """List the alterations of a browser's page, each once, in alphabetical order.

    "consent text" is among them if the text or its translation was altered while the consent text was shown.
    """
    alterations = set()
    phase = ""
    for note in notes:
        if isinstance(note, Noted) and note.kind == "phase":
            phase = note.text
        elif isinstance(note, Noted) and (alteration := read_alteration(note)):
            alterations.add(alteration)
            if phase == Phase.CONSENT and alteration.startswith(("text", "translation")):
                alterations.add("consent text")
    return sorted(alterations)
