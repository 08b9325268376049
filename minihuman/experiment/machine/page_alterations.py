"""Notes that a browser, an extension or a setting changed what a session's page shows, or how it is used."""

from typing import Literal

from minihuman.experiment.machine.events import Noted

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
    if note.kind == "page" and note.text.startswith(_BEGINNING):
        return note.text.removeprefix(_BEGINNING)
    return ""
