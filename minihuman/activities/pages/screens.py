"""Screens of texts that are shown page by page."""

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.screens import Button, PageScreen, PictureLabel
from minihuman.experiment.words import InterfaceWords


def build_page_screen(
    words: InterfaceWords,
    *,
    title: str,
    body: str,
    page: int,
    pages: int,
    last: str,
    button: str,
    picture: NDArray[np.uint8] | None = None,
    marks: tuple[PictureLabel, ...] = (),
    decline_label: str = "",
) -> PageScreen:
    """Build the screen of one page of a text.

    ``last`` is the prompt of the last page, ``button`` the label of the button that leaves it, and ``decline_label``
    the label of the button that declines; "" shows no such button.
    """
    buttons: list[Button] = []
    if page:
        buttons.append(Button("back", words["button.back"]))
    if decline_label:
        buttons.append(Button("decline", decline_label))
    if page == pages - 1:
        prompt = last
        buttons.append(Button("go_on", button))
    else:
        prompt = words["page.prompt"]
        buttons.append(Button("go_on", words["button.next"]))
    progress = words.fill("page.progress", page=page + 1, pages=pages) if pages > 1 else ""
    return PageScreen(title, body, page + 1, pages, prompt, tuple(buttons), progress, picture, marks, words.locale)
