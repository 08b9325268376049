"""The forms that come with the package, in every language the interface has."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec

from minihuman.errors import ProtocolError
from minihuman.study.activities.drafts import Question

FORMS = ("nasa-tlx", "demographics")


class Form(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A title and questions."""

    title: str
    items: tuple[Question, ...]


def form(name: str, language: str) -> Form:
    """A form in a language.

    Raises:
        ProtocolError: if there is none in it.
    """
    tree = _tree(name)
    if language not in tree["words"]:
        languages = ", ".join(tree["words"])
        raise ProtocolError(
            f"the form {name!r} is not there in {language!r} but in {languages}; give its items yourself"
        )
    words = tree["words"][language]
    items = [{**item, **words["items"][item["name"]]} for item in tree["items"]]
    return msgspec.convert({"title": words["title"], "items": items}, Form)


@cache
def _tree(name: str) -> dict[str, Any]:
    text = files("minihuman.study").joinpath("forms_shipped", f"{name}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
