"""Digests of the pictures of all screens in every shipped language, the same on every machine.

``python -m tests.typeset.screen_digests`` writes them anew, where a change of the pictures is meant.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.display import typefaces
from minihuman.display.drawing.screen import compose_screen
from minihuman.experiment.stimuli import Stimulus
from minihuman.experiment.words import LANGUAGES, load_words
from tests.typefaces import FOLDER
from tests.windows.test_type_size import SIZES_PX, all_screens, plan_in

FILE = Path(__file__).with_name("screen_digests.json")
_DIGITS = 8  # of each picture's SHA-256: enough to name the one that differs


def forget_typefaces() -> None:
    """Look for installed faces anew."""
    for remembered in (typefaces._find_font_files, typefaces._list_installed_typefaces, typefaces.select_typefaces):
        remembered.cache_clear()


def digest_screens(language: str) -> dict[str, str]:
    """Digest every screen of a session in a language, and a stimulus, in the shipped faces and the tests' alone."""
    return {name: hashlib.sha256(picture.tobytes()).hexdigest()[:_DIGITS] for name, picture in _draw_screens(language)}


def _draw_screens(language: str) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    for size_px in SIZES_PX:
        for number, screen in enumerate(all_screens(plan_in(language))):
            yield f"{number:02} {type(screen).__name__} {size_px[0]}x{size_px[1]}", compose_screen(screen, size_px)
    stimulus = Stimulus("rgb_array", text=load_words(language)["closing.title"], size=0.1, language=language)
    stimulus.reset(seed=1)
    yield "stimulus", stimulus.render()


def write_digests() -> None:
    typefaces._list_font_folders = lambda: iter([FOLDER / "fonts"])
    forget_typefaces()
    digests = {language: digest_screens(language) for language in LANGUAGES}
    FILE.write_text(json.dumps(digests, indent=0) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_digests()
