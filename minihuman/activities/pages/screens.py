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
    last_prompt: str,
    last_button: str,
    picture: NDArray[np.uint8] | None = None,
    marks: tuple[PictureLabel, ...] = (),
    decline_label: str = "",
) -> PageScreen:
    """Build the screen of one page of a text.

    Args:
        words: the interface's texts.
        title: the text's title.
        body: the page's text.
        page: the page's index, from 0.
        pages: the number of pages.
        last_prompt: the prompt of the last page.
        last_button: the label of the button that leaves the last page.
        picture: the page's picture, uint8[H, W, 3]; None for no picture.
        marks: the labels on the picture.
        decline_label: the label of the button that declines; "" shows no such button.
    """
    buttons: list[Button] = []
    if page:
        buttons.append(Button("back", words["button.back"]))
    if decline_label:
        buttons.append(Button("decline", decline_label))
    if page == pages - 1:
        prompt = last_prompt
        buttons.append(Button("go_on", last_button))
    else:
        prompt = words["page.prompt"]
        buttons.append(Button("go_on", words["button.next"]))
    progress = words.fill("page.progress", page=page + 1, pages=pages) if pages > 1 else ""
    return PageScreen(title, body, page + 1, pages, prompt, tuple(buttons), progress, picture, marks, words.locale)
