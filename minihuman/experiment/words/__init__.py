"""Interface texts: one TOML file per language, and a ``words.toml`` in the folder of each kind of question.

A protocol's `[words]` table can replace any of them.
"""

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from minihuman.errors import ProtocolError
from minihuman.experiment.keys import key_caption, key_label
from minihuman.experiment.machine.screens import TextLocale
from minihuman.plugins import QUESTION_GROUP, list_plugin_names, read_plugin_file, remember_by_name

ENGLISH = "en"
LANGUAGES = ("en", "de", "fr", "es", "zh", "ja", "ar", "he")
# texts that earlier studies in a language of their own lack; English replaces them, and `check` warns of them
LATER_WORDS = ("outcome.ended", "over.kept_in_part", "note.too_long")


@cache
def load_words(language: str) -> Mapping[str, str]:
    """Return every interface text of a language, by key ("go_on", "outcome.goal"), including those of question kinds.

    Raises:
        KeyError: if the language is not included.
    """
    if language not in LANGUAGES:
        raise KeyError(language)
    tree = tomllib.loads(files(__package__).joinpath(f"{language}.toml").read_text(encoding="utf-8"))
    words = flatten_words(tree)
    for kind in list_plugin_names(QUESTION_GROUP, built_in=True):
        words = {**_read_kind_words(kind).get(language, {}), **words}
    return words


def load_kind_words(kind: str, language: str) -> Mapping[str, str]:
    """Return, by key, the interface texts of a kind of question in a language, in English if one is not translated."""
    words_by_language = _read_kind_words(kind)
    return {**words_by_language.get(ENGLISH, {}), **words_by_language.get(language, {})}


def list_missing_kind_words(kind: str, language: str) -> tuple[str, ...]:
    """Return the keys of the interface texts that a kind of question has in English but not in a language."""
    words_by_language = _read_kind_words(kind)
    return tuple(key for key in words_by_language.get(ENGLISH, {}) if key not in words_by_language.get(language, {}))


@remember_by_name
def _read_kind_words(kind: str) -> Mapping[str, Mapping[str, str]]:
    """Return the interface texts of a kind of question, by language and key; empty if its folder has no ``words.toml``.

    Raises:
        ProtocolError: if the file is not a table of texts for each language.
    """
    toml = read_plugin_file(QUESTION_GROUP, kind, "words.toml")
    if toml is None:
        return {}
    try:
        tree = tomllib.loads(toml)
    except tomllib.TOMLDecodeError as error:
        raise ProtocolError(f"words.toml of question kind {kind!r} is not valid TOML: {error}") from None
    words_by_language = {}
    for language, tables in tree.items():
        words = flatten_words(tables) if isinstance(tables, dict) else {"": tables}
        for key, text in words.items():
            if not key or not isinstance(text, str):
                path = f"{language}.{key}".removesuffix(".")
                raise ProtocolError(
                    f"words.toml of question kind {kind!r}: {path} is {text!r}; write a text in quotes, in a table "
                    f"of its language, as [{ENGLISH}.prompt]"
                )
        words_by_language[language] = words
    return words_by_language


def flatten_words(tree: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Return nested tables of texts as one table, whose keys are ``prefix`` and the nested keys joined by dots."""
    words: dict[str, str] = {}
    for key, table_or_text in tree.items():
        if isinstance(table_or_text, dict):
            words |= flatten_words(table_or_text, f"{prefix}{key}.")
        else:
            words[f"{prefix}{key}"] = table_or_text
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
        """Return the text of a key, which must exist."""
        return self._words[key]

    def find(self, key: str, default: str) -> str:
        """Return the text of a key that need not exist; ``default`` if it does not."""
        return self._words.get(key, default)

    def with_kind(self, kind: str) -> "InterfaceWords":
        """Return these texts, completed by those of a kind of question where they lack a key."""
        kind_words = load_kind_words(kind, self.language)
        if kind_words.keys() <= self._words.keys():
            return self
        return InterfaceWords(self.language, {**kind_words, **self._words}, self._fonts)

    def fill(self, key: str, **fields: Any) -> str:
        """Return the text of a key, which must exist, with its fields filled in."""
        return self._words[key].format(**fields)

    @property
    def rtl(self) -> bool:
        """Return whether text runs from right to left."""
        return self._words["direction"] == "rtl"

    @property
    def locale(self) -> TextLocale:
        """Return the language, direction, fonts and theme in which windows and pages show the texts."""
        return TextLocale(self.language, self.rtl, self._fonts, self.find("theme", "dark"))

    def action(self, name: str) -> str:
        """Return an action's name in this language; without a translation, ``name`` with spaces for underscores."""
        return self._words.get(f"action.{name}", name.replace("_", " "))

    def mission(self, mission: str) -> str:
        """Return the translation of a world's mission, which is in English; "" if this language has none."""
        translation = self._words.get(f"mission.{mission}")
        if translation is not None:
            return translation
        if self.language == ENGLISH:
            return mission
        return ""

    def labels(self, keys: tuple[str, ...]) -> tuple[tuple[str, str, str], ...]:
        """Return the name, label and caption of each key; the caption distinguishes equal labels, else it is ""."""
        return tuple(
            (key, self._words.get(f"key.{key}", key_label(key)), self._words.get(f"caption.{key_caption(key)}", ""))
            for key in keys
        )
