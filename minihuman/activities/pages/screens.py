"""The screens of texts in pages."""

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
    """A page of a text; ``last`` is the last page's prompt, ``button`` what its button says.

    ``decline_label`` is the label of the button that declines; "" shows no such button.
    """
    at_end = page == pages - 1
    buttons: tuple[Button, ...] = (Button("back", words["button.back"]),) if page else ()
    buttons += (Button("decline", decline_label),) if decline_label else ()
    buttons += (Button("go_on", button if at_end else words["button.next"]),)
    if pages > 1:
        progress = words.fill("page.progress", page=page + 1, pages=pages)
    else:
        progress = ""
    prompt = last if at_end else words["page.prompt"]
    return PageScreen(title, body, page + 1, pages, prompt, buttons, progress, picture, marks, words.locale)
