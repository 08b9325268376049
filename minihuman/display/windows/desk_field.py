"""A text field that a window edits by its inputs, and whose whole text it reports to the session.

The window handles caret, selection, clipboard and undo by itself, as a browser does for its fields. Keys that go into
the field reach the session neither as keys nor as letters, so the log contains none of them.
"""

import abc
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from minihuman.display.drawing.screen import locate_in_field
from minihuman.display.drawing.sheet import Size
from minihuman.display.drawing.text_fields import FieldView
from minihuman.display.windows.text_editor import TextEditor
from minihuman.experiment.machine.inputs import (
    FocusChanged,
    Input,
    KeyDown,
    KeyUp,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    ScreenShown,
    TextChange,
    TextEdited,
    TextInput,
)
from minihuman.experiment.machine.screens import QuestionScreen, Screen, TextField

SETTLE_NS = 500_000_000  # from the last change of a text to its report
_DOUBLE_CLICK_NS = 400_000_000
_SESSION_KEYS = ("tab", "escape", "f8", "f9", "f12")  # keys that never go into a field
_SESSION_KEYS_OF_A_LINE = ("enter", "kp_enter", "page_up")  # nor do these into a field of one line
_SHIFT_KEYS = ("left_shift", "right_shift")
_COMMAND_KEYS = ("left_ctrl", "right_ctrl", "left_meta", "right_meta")


class Clipboard(abc.ABC):
    """The system's clipboard."""

    @abc.abstractmethod
    def read(self) -> str:
        """Return the clipboard's text; "" if it has none."""

    @abc.abstractmethod
    def write(self, text: str) -> None:
        """Replace the clipboard's text."""


class OwnClipboard(Clipboard):
    """A clipboard within the window, for a toolkit that does not reach the system's."""

    def __init__(self) -> None:
        self._text = ""

    def read(self) -> str:
        """Return the text that was written last."""
        return self._text

    def write(self, text: str) -> None:
        """Keep a text."""
        self._text = text


@dataclass(frozen=True, slots=True)
class _Question:
    """The properties that distinguish one field from another."""

    title: str
    question: str
    name: str


class DeskField:
    """The field of the present screen, if it has one that the window edits.

    Args:
        clipboard: the system's clipboard.
    """

    def __init__(self, clipboard: Clipboard) -> None:
        self._clipboard = clipboard
        self._screen: QuestionScreen | None = None  # as the session gave it
        self._question: _Question | None = None
        self._editor = TextEditor("", is_long=False, rtl=False)
        self._reported = ""  # the text that the session has
        self._press_count = 0
        self._began_ns: int | None = None  # of the changes that were not reported
        self._due_ns = 0
        self._modifiers: set[str] = set()  # modifier keys that are down
        self._own_keys: set[str] = set()  # keys that are down and went into the field
        self._waiting: list[Input] = []
        self._is_dragging = False
        self._pressed_ns = -(1 << 62)
        self._was_composed = False  # whether the next letters come from an input method

    @property
    def is_active(self) -> bool:
        """Whether the present screen has a field that the window edits."""
        return self._screen is not None

    @property
    def has_waiting(self) -> bool:
        """Whether inputs wait for the screen that a press led to."""
        return bool(self._waiting)

    @property
    def due_ns(self) -> int | None:
        """The time at which the text is to be reported; None if it has not changed since the last report."""
        if self._began_ns is None or self._screen is None:
            return None
        return self._due_ns

    def open(self, screen: Screen) -> Screen:
        """Begin to edit the field of a screen, and return the screen with the field's present text.

        A screen without a field that the window edits is returned unchanged, and ends the editing of an earlier one.
        """
        self._screen = None
        if not isinstance(screen, QuestionScreen) or not isinstance(screen.item, TextField) or not screen.item.native:
            return screen
        question = _Question(screen.title, screen.question, screen.item.name)
        if question != self._question or screen.item.text != self._reported:
            self._question = question
            self._reported = screen.item.text
            self._editor = TextEditor(screen.item.text, is_long=screen.item.long, rtl=screen.locale.rtl)
            self._began_ns = None
            self._press_count = 0
        self._screen = screen
        return self.view(screen)

    def view(self, screen: QuestionScreen) -> QuestionScreen:
        """Return a screen with its field as it is now, and with a note if the text is too long."""
        assert isinstance(screen.item, TextField)
        edited = self._editor.edited
        composition = self._editor.composition
        text = edited.text[: edited.caret] + composition + edited.text[edited.caret :]
        anchor = edited.anchor
        if composition:
            anchor = edited.caret
        field = FieldView(
            text=text,
            caret=edited.caret + len(composition),
            long=screen.item.long,
            unit=screen.item.unit,
            anchor=anchor,
            is_composing=bool(composition),
        )
        note = screen.note
        if screen.item.longest and len(edited.text) > screen.item.longest:
            note = screen.item.limit_note
        return replace(screen, item=field, note=note)

    def show_current(self) -> QuestionScreen:
        """Return the present screen with the field as it is now."""
        assert self._screen is not None, "a screen with a field is shown"
        return self.view(self._screen)

    def show_composition(self, text: str) -> None:
        """Show what an input method is composing; "" ends it."""
        self._editor.composition = text
        self._was_composed = self._was_composed or bool(text)

    def apply_inputs(self, inputs: Iterable[Input], size_px: Size) -> list[Input]:
        """Apply inputs to the field, and return the inputs that are for the session.

        The text of the field is reported before the next input that is for the session. A press can lead to another
        screen, so the inputs after it wait for the next call.
        """
        remaining: list[Input] = []
        coming = [*self._waiting, *inputs]
        self._waiting = []
        for index, happened in enumerate(coming):
            self._follow_modifiers(happened)
            if self._apply_input(happened, size_px):
                continue
            if self.is_active and not isinstance(happened, KeyUp | ScreenShown | PointerReleased):
                remaining += self.report_text(happened.t_ns)
            remaining.append(happened)
            if self.is_active and isinstance(happened, KeyDown | PointerPressed):
                self._waiting = coming[index + 1 :]
                break
        return remaining

    def _follow_modifiers(self, happened: Input) -> None:
        """Record which modifier keys are down."""
        if isinstance(happened, KeyDown) and happened.key in (*_SHIFT_KEYS, *_COMMAND_KEYS):
            self._modifiers.add(happened.key)
        elif isinstance(happened, KeyUp):
            self._modifiers.discard(happened.key)
        elif isinstance(happened, FocusChanged):
            self._modifiers.clear()

    def _apply_input(self, happened: Input, size_px: Size) -> bool:
        """Apply an input to the field; return False if the input is for the session."""
        if isinstance(happened, KeyUp) and happened.key in self._own_keys:
            self._own_keys.discard(happened.key)
            return True
        if not self.is_active:
            return False
        match happened:
            case TextInput():
                change: TextChange = "composed" if self._was_composed else "typed"
                self._was_composed = False
                self._apply_edit(happened.t_ns, lambda: self._editor.insert(happened.text, change))
            case KeyDown():
                return self._take_key(happened)
            case PointerPressed(target="field") if happened.cause == "finger":
                self._press_pointer(happened, size_px)
            case PointerMoved() if self._is_dragging:
                self._editor.move_to(self._locate(happened.x, happened.y, size_px), is_shift=True)
            case PointerReleased() if self._is_dragging:
                self._is_dragging = False
            case _:
                return False
        return True

    def _take_key(self, press: KeyDown) -> bool:
        """Apply a key press to the field; return False if the key is for the session."""
        is_command = bool(self._modifiers.intersection(_COMMAND_KEYS)) or press.cause == "shortcut"
        if press.cause == "held_before_focus" or press.key in _SESSION_KEYS:
            return False
        if press.key in _SESSION_KEYS_OF_A_LINE and not self._editor.is_long and not is_command:
            return False
        self._own_keys.add(press.key)
        if not press.repeat:
            self._press_count += 1
        if self._editor.composition:  # the key belongs to the input method
            return True
        self._apply_edit(press.t_ns, lambda: self._press_key(press.key, is_command=is_command))
        return True

    def _press_key(self, key: str, *, is_command: bool) -> None:
        """Carry out a shortcut, or let the key move the caret, delete or, in a long text, begin a new line."""
        is_shift = bool(self._modifiers.intersection(_SHIFT_KEYS))
        if is_command and key in ("a", "c", "x", "v", "y", "z"):
            self._apply_command(key, is_shift=is_shift)
        elif key in ("up", "down"):
            self._editor.press_key("home" if key == "up" else "end", is_shift=is_shift)
        else:
            self._editor.press_key(key, is_shift=is_shift, is_word=is_command)

    def _apply_command(self, key: str, *, is_shift: bool) -> None:
        """Carry out a shortcut: select all, copy, cut, paste, undo or redo."""
        editor = self._editor
        match key:
            case "a":
                editor.select_all()
            case "c" | "x":
                if editor.edited.selected_text:
                    self._clipboard.write(editor.edited.selected_text)
                    if key == "x":
                        editor.cut()
            case "v":
                editor.insert(self._clipboard.read(), "pasted")
            case "y":
                editor.redo()
            case _ if is_shift:
                editor.redo()
            case _:
                editor.undo()

    def _press_pointer(self, press: PointerPressed, size_px: Size) -> None:
        """Move the caret to the pressed position or, at a double click, select the word there."""
        position = self._locate(press.x, press.y, size_px)
        if press.t_ns - self._pressed_ns < _DOUBLE_CLICK_NS:
            self._editor.select_word(position)
        else:
            self._editor.move_to(position, is_shift=bool(self._modifiers.intersection(_SHIFT_KEYS)))
        self._pressed_ns = press.t_ns
        self._is_dragging = True

    def _locate(self, x: float, y: float, size_px: Size) -> int:
        """Return the position in the text that is nearest to a point, given in shares of the screen."""
        return min(len(self._editor.text), locate_in_field(self.show_current(), size_px, x, y))

    def _apply_edit(self, t_ns: int, edit: Callable[[], None]) -> None:
        """Apply an edit; if it changes the text, record when changes began and when they are to be reported."""
        before = self._editor.text
        edit()
        if self._editor.text != before:
            if self._began_ns is None:
                self._began_ns = t_ns
            self._due_ns = t_ns + SETTLE_NS

    def report_text(self, t_ns: int) -> list[Input]:
        """Return an input that reports the text, in a list; [] if the session has the same text already."""
        began_ns = self._began_ns
        if began_ns is None or self._editor.text == self._reported:
            self._began_ns = None
            return []
        self._began_ns = None
        self._reported = self._editor.text
        keys = self._press_count
        self._press_count = 0
        name = ""
        if self._question is not None:
            name = self._question.name
        return [TextEdited(t_ns, self._reported, self._editor.take_changes(), keys, began_ns, name)]
