"""A field at the desk: what is shown is what the session gets, whole, once it settled; keys in it reach no session."""

from dataclasses import replace

import numpy as np
import pytest

from minihuman.display.drawing.screen import compose_screen, find_spot
from minihuman.display.drawing.text_fields import FieldView
from minihuman.display.windows.desk_field import SETTLE_NS, DeskField, OwnClipboard
from minihuman.display.windows.text_editor import TextEditor
from minihuman.experiment.machine.inputs import (
    FocusChanged,
    Input,
    KeyDown,
    KeyUp,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    TextEdited,
    TextInput,
)
from minihuman.experiment.machine.screens import QuestionScreen, TextField, TextLocale
from tests.windows.test_blocking import Kept, Steady

SIZE_PX = (640, 360)
LONG = QuestionScreen(
    "Title", "What?", TextField("", 0, True, native=True, name="why", longest=30, limit_note="short!"), ""
)
LINE = replace(LONG, item=replace(LONG.item, long=False))
PERSIAN = "می\N{ZERO WIDTH NON-JOINER}خواهم"
FRENCH = "Quoi\N{NO-BREAK SPACE}?"


class Typist:
    """Types into a field as a window's inputs say it, and keeps what reaches the session."""

    def __init__(self, screen: QuestionScreen = LONG) -> None:
        self.clipboard = OwnClipboard()
        self.field = DeskField(self.clipboard)
        self.field.open(screen)
        self.session: list[Input] = []
        self.now_ns = 1_000

    def give(self, *inputs: Input) -> None:
        self.session += self.field.apply_inputs(inputs, SIZE_PX)

    def type(self, text: str) -> None:
        for letter in text:
            self.now_ns += 1_000
            self.give(KeyDown(self.now_ns, letter), TextInput(self.now_ns, letter), KeyUp(self.now_ns, letter))

    def press(self, *keys: str) -> None:
        self.now_ns += 1_000
        for key in keys:
            cause = "shortcut" if "left_ctrl" in keys[:-1] and key == keys[-1] else "finger"
            self.give(KeyDown(self.now_ns, key, cause=cause))
        for key in reversed(keys):
            self.give(KeyUp(self.now_ns, key))

    @property
    def text(self) -> str:
        item = self.field.show_current().item
        assert isinstance(item, TextField)
        return item.text

    def settle(self) -> TextEdited:
        [edited] = self.field.report_text(self.now_ns)
        assert isinstance(edited, TextEdited)
        return edited


def test_what_was_typed_is_reported_whole_and_no_key_of_it_reaches_the_session() -> None:
    typist = Typist()
    typist.type(PERSIAN)
    typist.press("enter")
    typist.type(FRENCH)
    assert typist.session == []
    edited = typist.settle()
    assert edited.text == typist.text == f"{PERSIAN}\n{FRENCH}"
    assert (edited.changes, edited.keys, edited.began_ns) == (("typed",), len(PERSIAN) + 1 + len(FRENCH), 2_000)
    assert typist.field.report_text(typist.now_ns) == []


def test_what_ends_the_question_comes_after_the_text() -> None:
    typist = Typist(LINE)
    typist.type("ab")
    typist.press("enter")
    kinds = [type(happened) for happened in typist.session]
    assert kinds == [TextEdited, KeyDown, KeyUp]
    typist = Typist()
    typist.type("a")
    typist.give(FocusChanged(typist.now_ns, False))
    assert [type(happened) for happened in typist.session] == [TextEdited, FocusChanged]


def test_selection_clipboard_and_undo_work_as_elsewhere() -> None:
    typist = Typist()
    typist.type("one two")
    typist.press("left_ctrl", "left_shift", "left")
    typist.press("left_ctrl", "x")
    assert (typist.text, typist.clipboard.read()) == ("one ", "two")
    typist.press("left_ctrl", "home")
    typist.press("left_ctrl", "v")
    assert typist.text == "twoone "
    typist.press("left_ctrl", "z")
    typist.press("left_ctrl", "z")
    assert typist.text == "one two"
    typist.press("left_ctrl", "y")
    assert typist.text == "one "
    typist.press("left_ctrl", "a")
    typist.type("z")
    assert typist.text == "z"
    assert typist.settle().changes == ("typed", "pasted", "undone")


def test_a_paste_of_several_lines_keeps_them_where_there_is_room_for_them() -> None:
    for screen, text in ((LONG, "a\nb\tc"), (LINE, "ab\tc")):
        typist = Typist(screen)
        typist.clipboard.write("a\r\nb\tc\x00")
        typist.press("left_ctrl", "v")
        assert typist.settle().text == typist.text == text


def test_what_an_input_method_composes_is_seen_and_is_text_once_it_is_done() -> None:
    typist = Typist()
    typist.type("a")
    typist.field.show_composition("にほ")
    assert typist.text == "aにほ"
    assert typist.settle().text == "a"
    typist.press("backspace")  # the input method's
    typist.field.show_composition("")
    typist.give(TextInput(typist.now_ns, "日本"))
    edited = typist.settle()
    assert (edited.text, edited.changes) == ("a日本", ("composed",))


def test_a_text_that_is_too_long_is_kept_and_said_to_be_so() -> None:
    typist = Typist()
    typist.type("x" * 31)
    assert typist.field.show_current().note == "short!"
    typist.press("backspace")
    assert typist.field.show_current().note == ""


def test_a_half_typed_answer_is_there_again_after_another_screen() -> None:
    typist = Typist()
    typist.type("half")
    typist.field.open(replace(LONG, question="Other?"))
    back = typist.field.open(LONG)
    assert isinstance(back.item, TextField)
    assert back.item.text == ""  # it had not settled, and the session asked something else
    typist.type("half")
    edited = typist.settle()
    typist.field.open(replace(LONG, question="Other?"))
    back = typist.field.open(replace(LONG, item=replace(LONG.item, text=edited.text)))
    assert isinstance(back.item, TextField)
    assert back.item.text == "half"


@pytest.mark.parametrize("rtl", [False, True])
def test_the_mouse_puts_the_caret_and_selects_where_it_points(rtl: bool) -> None:
    typist = Typist(replace(LONG, locale=TextLocale(rtl=rtl)))
    typist.type("aaaa bbbb")
    view = typist.field.show_current()
    places = [x for x in np.linspace(0, 1, 640) if find_spot(view, SIZE_PX, float(x), 0.5)[0] == "field"]
    first, last = (places[-1], places[0]) if rtl else (places[0], places[-1])
    typist.give(PointerPressed(10**9, first, 0.3, "field"))
    typist.give(PointerMoved(10**9, last, 0.3, "field"), PointerReleased(10**9, last, 0.3, "field"))
    typist.press("delete")
    assert typist.text == ""
    assert typist.session == []


def test_a_letter_goes_with_its_marks() -> None:
    editor = TextEditor("e\N{COMBINING ACUTE ACCENT}x👩\N{ZERO WIDTH JOINER}🚀", is_long=False, rtl=False)
    editor.press_key("backspace")
    assert editor.text == "e\N{COMBINING ACUTE ACCENT}x"
    editor.press_key("left")
    editor.press_key("backspace")
    assert editor.text == "x"


def test_a_window_shows_each_letter_at_once_and_reports_the_text_when_it_settled() -> None:
    window = Kept(Steady())
    window.show(LONG)
    window.coming = [KeyDown(1, "a"), TextInput(1, "a")]
    [edited] = window.wait(None)
    assert isinstance(edited, TextEdited)
    assert edited.text == "a"
    assert edited.t_ns >= SETTLE_NS
    shown = replace(LONG, item=FieldView("a", 1, True, anchor=1))
    assert np.array_equal(window.display, compose_screen(shown, window.size_px))


def test_what_is_typed_at_once_after_a_question_goes_into_the_next_ones_field() -> None:
    window = Kept(Steady())
    window.show(LONG)
    window.coming = [TextInput(1, "a"), KeyDown(2, "tab"), KeyUp(3, "tab"), KeyDown(4, "b"), TextInput(4, "b")]
    edited, tab = window.wait(None)
    assert isinstance(edited, TextEdited)
    assert (edited.text, edited.field) == ("a", "why")
    assert tab == KeyDown(2, "tab")
    window.show(replace(LONG, question="Who?", item=replace(LONG.item, name="who")))
    assert window.wait(None) == [KeyUp(3, "tab")]
    [edited] = window.wait(None)
    assert isinstance(edited, TextEdited)
    assert (edited.text, edited.field) == ("b", "who")
