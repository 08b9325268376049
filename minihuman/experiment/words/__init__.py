"""Interface texts: one TOML file per language. A protocol's `[words]` table can replace any of them."""

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from minihuman.experiment.keys import key_caption, key_label
from minihuman.experiment.machine.screens import TextLocale

ENGLISH = "en"
LANGUAGES = ("en", "de", "fr", "es", "zh", "ja", "ar", "he")
# studies in a language of their own were written before these: English stands in, and `check` names them
LATER_WORDS = ("outcome.ended", "over.kept_in_part")


@cache
def load_words(language: str) -> Mapping[str, str]:
    """Load every interface text of a language, by key ("go_on", "outcome.goal").

    Raises:
        KeyError: if the language is not included.
    """
    if language not in LANGUAGES:
        raise KeyError(language)
    tree = tomllib.loads(files(__package__).joinpath(f"{language}.toml").read_text(encoding="utf-8"))
    return flatten_words(tree)


def flatten_words(tree: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Flatten nested tables of texts into one table with keys joined by dots."""
    words: dict[str, str] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            words |= flatten_words(value, f"{prefix}{key}.")
        else:
            words[f"{prefix}{key}"] = value
    return words


class InterfaceWords:
    """The interface texts of one session: a language's texts, with the protocol's replacements.

    Args:
        language: the language of the texts; one that is not included needs all texts in ``instead``.
        instead: texts that replace the language's, by key.
        fonts: font files that are used for the characters they contain.
    """

    def __init__(
        self, language: str = ENGLISH, instead: Mapping[str, str] | None = None, fonts: tuple[str, ...] = ()
    ) -> None:
        self.language = language
        self._fonts = fonts
        base = load_words(language) if language in LANGUAGES else load_words(ENGLISH)
        self._words = {**base, **(instead or {})}

    def __getitem__(self, key: str) -> str:
        """Return the text of a key that every language has."""
        return self._words[key]

    def find(self, key: str, default: str) -> str:
        """Return the text of a key that a plug-in may have added; ``default`` if there is none."""
        return self._words.get(key, default)

    def fill(self, key: str, **fields: Any) -> str:
        """Return the text of a key with its fields filled in."""
        return self._words[key].format(**fields)

    @property
    def rtl(self) -> bool:
        """Whether text runs from right to left."""
        return self._words["direction"] == "rtl"

    @property
    def locale(self) -> TextLocale:
        """The language, direction, fonts and theme in which the texts are shown."""
        return TextLocale(self.language, self.rtl, self._fonts, self.find("theme", "dark"))

    def action(self, name: str) -> str:
        """Return the name of an action in this language, or the world's own name for it."""
        return self._words.get(f"action.{name}", name.replace("_", " "))

    def mission(self, mission: str) -> str:
        """Translate a world's mission; "" if this language has no translation."""
        known = self._words.get(f"mission.{mission}")
        if known is not None:
            return known
        if self.language == ENGLISH:
            return mission
        return ""

    def labels(self, keys: tuple[str, ...]) -> tuple[tuple[str, str, str], ...]:
        """Return for each key its name, its label, and a caption that distinguishes keys with the same label."""
        return tuple(
            (key, self._words.get(f"key.{key}", key_label(key)), self._words.get(f"caption.{key_caption(key)}", ""))
            for key in keys
        )
