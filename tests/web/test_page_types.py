"""The page's types are those of the messages."""

import re
from pathlib import Path

import msgspec
import pytest

import minihuman
from minihuman.experiment.machine import screens
from minihuman.web import messages, screen_values
from minihuman.web.page_types import PATH, format_page_types

PAGE_MODULES = [
    *sorted(PATH.parent.glob("*.js")),
    *sorted(Path(minihuman.__file__).parent.glob("activities/*/page.js")),
]


def test_the_types_of_the_page_are_generated_from_the_messages() -> None:
    assert PATH.read_text(encoding="utf-8") == format_page_types(), "run `python -m minihuman.web.page_types`"


def test_a_field_that_is_added_to_a_message_is_in_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    longer = msgspec.defstruct("CommandMessage", [("number", int), ("text", str, "")], tag="ask", tag_field="t")
    assert 'export interface CommandMessage {\n  t: "ask";\n  number: number;\n}' in format_page_types()
    monkeypatch.setattr("minihuman.web.page_types.ALIASES", {"ServerMessage": longer | messages.FilmFrame})
    assert (
        'export interface CommandMessage {\n  t: "ask";\n  number: number;\n  text: string;\n}' in format_page_types()
    )


def test_every_type_that_a_page_module_names_is_one_of_a_message() -> None:
    known = set(re.findall(r"^export (?:interface|type) (\w+)", PATH.read_text(encoding="utf-8"), re.MULTILINE))
    named: set[str] = set()
    for path in PAGE_MODULES:
        text = path.read_text(encoding="utf-8")
        for names in re.findall(r"@import \{ ([^}]+) \} from \"[./\w]*/messages\"", text):
            named |= {name.strip() for name in names.split(",")}
    assert len(named) > 20
    assert named <= known


def test_every_kind_of_screen_has_the_fields_that_its_type_says() -> None:
    button = screens.Button("go_on", "Go on")
    shown = [
        screens.TextScreen("title", "body", "prompt", keys=(("a", False),), labels=(("a", "A", ""),)),
        screens.BlankScreen(locale=screens.TextLocale(theme="light")),
        screens.PageScreen("title", "body", 1, 2, "prompt", (button,)),
        screens.QuestionScreen("title", "question", screens.Slider("low", "high", None, "", 4), "prompt", (button,)),
    ]
    for screen in shown:
        function = screen_values.CONVERTERS[type(screen)]
        form = function.__annotations__["return"]
        values = screen_values.convert_screen(screen, lambda picture: 0)
        assert values.keys() <= form.__annotations__.keys() | {"language", "rtl", "theme"}, form
        assert form.__required_keys__ <= values.keys(), form
