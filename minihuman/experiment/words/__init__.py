"""Words of the interface: one TOML file per language. A protocol's `[words]` table can replace any of them."""

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
    """Every word of a language, by its key ("go_on", "outcome.goal").

    Raises:
        KeyError: if there is no such language.
    """
    if language not in LANGUAGES:
        raise KeyError(language)
    tree = tomllib.loads(files(__package__).joinpath(f"{language}.toml").read_text(encoding="utf-8"))
    return flatten_words(tree)


def flatten_words(tree: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Words in tables as one table, keys joined by dots."""
    words: dict[str, str] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            words |= flatten_words(value, f"{prefix}{key}.")
        else:
            words[f"{prefix}{key}"] = value
    return words


class InterfaceWords:
    """The words of one session: a language's, with what the protocol puts in their place.

    Args:
        language: whose words; one that is not ours needs all of them in ``instead``.
        instead: words that replace the language's.
        fonts: files of faces that they are written in where these have the characters.
    """

    def __init__(
        self, language: str = ENGLISH, instead: Mapping[str, str] | None = None, fonts: tuple[str, ...] = ()
    ) -> None:
        self.language = language
        self._fonts = fonts
        base = load_words(language) if language in LANGUAGES else load_words(ENGLISH)
        self._words = {**base, **(instead or {})}

    def __getitem__(self, key: str) -> str:
        """The word of a key that every language has."""
        return self._words[key]

    def find(self, key: str, default: str) -> str:
        """The word of a key that a plug-in may have added; ``default`` where there is none."""
        return self._words.get(key, default)

    def fill(self, key: str, **fields: Any) -> str:
        """A word with its fields filled in."""
        return self._words[key].format(**fields)

    @property
    def rtl(self) -> bool:
        """Whether text runs from right to left."""
        return self._words["direction"] == "rtl"

    @property
    def locale(self) -> TextLocale:
        """How they are written."""
        return TextLocale(self.language, self.rtl, self._fonts, self.find("theme", "dark"))

    def action(self, name: str) -> str:
        """What an action is called; its name in the world where there is no word for it."""
        return self._words.get(f"action.{name}", name.replace("_", " "))

    def mission(self, mission: str) -> str:
        """What a world says is to be done, in this language; "" where there are no words for it but English ones."""
        known = self._words.get(f"mission.{mission}")
        if known is not None:
            return known
        if self.language == ENGLISH:
            return mission
        return ""

    def labels(self, keys: tuple[str, ...]) -> tuple[tuple[str, str, str], ...]:
        """For each key: its name, what its cap says, and what tells it from another with the same cap."""
        return tuple(
            (key, self._words.get(f"key.{key}", key_label(key)), self._words.get(f"caption.{key_caption(key)}", ""))
            for key in keys
        )
