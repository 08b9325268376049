"""A field in the page is the browser's: what it shows is in the log, the tables and the exports, point by point."""

import csv
import json
import time
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Answered, KeyPressed, TextChanged, TextTyped
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.protocols import asking
from tests.web.serving import serving

pytestmark = [needs("chromium"), pytest.mark.program]
FIELD = "[data-target=field]"
PERSIAN = "می\N{ZERO WIDTH NON-JOINER}خواهم"
FRENCH = "Quoi\N{NO-BREAK SPACE}?"
HINDI = "क्\N{ZERO WIDTH JOINER}ष"
_PASTE = """text => {
  const field = document.querySelector("[data-target=field]");
  field.focus();
  document.execCommand("insertText", false, text);
}"""
_CORRECT = """() => {  // as a spelling extension does, without an event
  const field = document.querySelector("[data-target=field]");
  field.value = field.value.replace("teh", "the");
}"""


def read_texts(log: Path) -> list[TextChanged]:
    return [event for event in read_events(log) if isinstance(event, TextChanged)]


def settled(person: Somebody, folder: Path) -> str:
    """Wait until the log has what the field shows; return that."""
    until_s = time.monotonic() + PATIENCE_S
    while True:
        text = str(person.page.input_value(FIELD))
        [log] = folder.rglob("*.mcap.part")
        texts = read_texts(log)
        if texts and texts[-1].text == text:
            return text
        assert time.monotonic() < until_s, f"{text!r} is not in the log"
        person.page.wait_for_timeout(50)


def find_in_order(texts: list[TextChanged], wanted: list[str]) -> list[TextChanged]:
    """The events with these texts, one after the other; a busy browser reports others that were there between them."""
    events = iter(texts)
    return [next(event for event in events if event.text == text) for text in wanted]


def test_what_a_field_shows_after_each_act_of_editing_is_in_the_log_and_the_tables(tmp_path: Path) -> None:
    shown = []
    with serving(asking(tmp_path, "long_text", "text"), tmp_path) as served, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        page = person.page
        line = page.context.new_cdp_session(page)
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        page.wait_for_selector(FIELD)
        page.keyboard.type("teh cat")
        shown.append(settled(person, tmp_path))
        page.evaluate(_CORRECT)
        shown.append(settled(person, tmp_path))
        page.keyboard.press("Control+a")
        page.keyboard.press("Control+c")
        page.keyboard.press("End")
        page.keyboard.press("Enter")
        page.keyboard.press("Control+v")
        shown.append(settled(person, tmp_path))
        page.keyboard.press("Shift+Control+ArrowLeft")
        line.send("Input.insertText", {"text": f"{PERSIAN} {FRENCH} {HINDI} 👩\N{ZERO WIDTH JOINER}🚀  "})
        shown.append(settled(person, tmp_path))
        page.keyboard.type("taken back")
        for _ in range(len("taken back")):
            page.keyboard.press("Backspace")
        assert settled(person, tmp_path) == shown[-1]
        page.dblclick(FIELD, position={"x": 20, "y": 20})
        page.keyboard.press("Delete")
        page.keyboard.press("Control+z")
        page.keyboard.press("Control+Shift+z")
        shown.append(settled(person, tmp_path))
        page.keyboard.press("Control+End")
        line.send("Input.imeSetComposition", {"text": "に", "selectionStart": 1, "selectionEnd": 1})
        page.wait_for_timeout(700)  # nothing of it is reported
        line.send("Input.imeSetComposition", {"text": "にほん", "selectionStart": 3, "selectionEnd": 3})
        line.send("Input.insertText", {"text": "日本"})
        shown.append(settled(person, tmp_path))
        page.reload()
        page.wait_for_selector(FIELD)
        page.wait_for_timeout(300)
        assert page.input_value(FIELD) == shown[-1]
        page.click(FIELD)
        page.keyboard.press("Control+End")
        page.keyboard.type("!")
        page.keyboard.press("Tab")  # at once, before it settled
        shown.append(f"{shown[-1]}!")
        page.wait_for_selector(f"textarea.line{FIELD}")
        page.evaluate(_PASTE, "two\nlines ")
        single = page.input_value(FIELD)
        page.keyboard.press("Enter")
        person.to_end()
        assert person.errors == []
    [log] = tmp_path.rglob("*.mcap")
    events = list(read_events(log))
    texts = find_in_order([event for event in read_texts(log) if event.item == "long_text"], shown)
    assert [event.changes for event in texts[:3]] == [("typed",), ("script",), ("typed", "pasted")]
    assert "undone" in texts[4].changes
    assert "composed" in texts[5].changes
    answers = [event for event in events if isinstance(event, Answered)]
    assert [event.words for event in answers] == [shown[-1], single]
    assert [json.loads(event.value) for event in answers] == [shown[-1], single]
    keys = {event.key for event in events if isinstance(event, KeyPressed)}
    assert keys <= {"tab", "enter"}, keys
    assert not [event for event in events if isinstance(event, TextTyped)]
    assert list(find_log_differences(log, World)) == []
    assert _export_answers(log, tmp_path / "csv") == [shown[-1], single]


def _export_answers(log: Path, folder: Path) -> list[str]:
    from minihuman import export

    export("csv", log, folder)
    [path] = folder.rglob("answers.csv")
    with path.open(encoding="utf-8", newline="") as rows:
        return [row["answer"] for row in csv.DictReader(rows)]


def test_a_text_that_is_too_long_is_said_to_be_so_at_once_and_is_not_cut(tmp_path: Path) -> None:
    protocol = asking(tmp_path, "text")
    protocol.write_text(protocol.read_text().replace('ask = "text?"', 'ask = "text?"\nlongest = 5'))
    with serving(protocol, tmp_path) as served, browsing() as sit_down:
        page = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}").page
        page.wait_for_selector(FIELD)
        page.keyboard.type("sixsix")
        page.wait_for_selector(".limit:not([hidden])")
        assert "5" in page.inner_text(".limit")
        page.keyboard.press("Enter")
        page.wait_for_timeout(300)
        assert page.input_value(FIELD) == "sixsix"
        page.keyboard.press("Backspace")
        page.wait_for_selector(".limit", state="hidden")
