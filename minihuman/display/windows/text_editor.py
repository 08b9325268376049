"""A text while it is edited: caret, selection, composition and undo, as in text fields of desktop systems.

Positions in the text are counted in code points. The module depends on no window, type or clipboard.
"""

import unicodedata
from dataclasses import dataclass, replace
from typing import get_args

from minihuman.experiment.machine.inputs import TextChange

_ORDER: tuple[TextChange, ...] = get_args(TextChange)  # in which changes are returned
_MAX_UNDO = 200
_JOINER = "\N{ZERO WIDTH JOINER}"
_LINE_FEED = "\n"


@dataclass(frozen=True, slots=True)
class EditedText:
    """A text with its caret; the selection lies between caret and anchor."""

    text: str = ""
    caret: int = 0
    anchor: int = 0

    @property
    def selection(self) -> tuple[int, int]:
        """The positions at which the selection begins and ends; both are the caret's if nothing is selected."""
        return min(self.caret, self.anchor), max(self.caret, self.anchor)

    @property
    def selected_text(self) -> str:
        """The selected text."""
        begin, end = self.selection
        return self.text[begin:end]


class TextEditor:
    """Edits a text by keys, insertions and positions of a pointer.

    Args:
        text: the text to begin with; the caret is at its end.
        is_long: whether the text can have several lines.
        rtl: whether text runs from right to left, so that the left arrow key moves on.
    """

    def __init__(self, text: str, *, is_long: bool, rtl: bool) -> None:
        self.edited = EditedText(text, len(text), len(text))
        self.composition = ""  # of an input method, drawn at the caret and not part of the text yet
        self.is_long = is_long
        self.changes: set[TextChange] = set()  # since they were last taken
        self._rtl = rtl
        self._undo: list[EditedText] = []
        self._redo: list[EditedText] = []
        self._is_typing = False  # what is typed in one go is undone in one go

    @property
    def text(self) -> str:
        """The text, without what an input method is composing."""
        return self.edited.text

    def take_changes(self) -> tuple[TextChange, ...]:
        """Return the kinds of changes to the text since the last call, and forget them."""
        changes = tuple(change for change in _ORDER if change in self.changes)
        self.changes.clear()
        return changes

    def insert(self, text: str, change: TextChange) -> None:
        """Replace the selection with a text, without its control characters and, in a field of one line, line breaks.

        Args:
            text: the text to insert.
            change: the kind of change, for `take_changes`.
        """
        kept = "".join(letter for letter in text.replace("\r\n", _LINE_FEED) if self._can_hold(letter))
        if not kept and not self.edited.selected_text:
            return
        begin, end = self.edited.selection
        whole = self.edited.text[:begin] + kept + self.edited.text[end:]
        self._apply_change(EditedText(whole, begin + len(kept), begin + len(kept)), change)

    def _can_hold(self, letter: str) -> bool:
        """Return whether a character can be in the text.

        Control characters (except tabs and, in a long text, line feeds) and lone surrogates cannot.
        """
        if letter == _LINE_FEED:
            return self.is_long
        return letter == "\t" or unicodedata.category(letter) not in ("Cc", "Cs")

    def press_key(self, key: str, *, is_shift: bool = False, is_word: bool = False) -> bool:
        """Move the caret, delete or, in a long text, begin a new line; return False for a key that does none of these.

        Args:
            key: the key's name.
            is_shift: whether the selection's anchor stays where it is, as with Shift.
            is_word: whether the key moves or deletes by words, as with Ctrl.
        """
        match key:
            case "backspace" | "delete":
                self._delete(self._find_step_end(key == "delete", is_word=is_word))
            case "left" | "right":
                self._move_step((key == "right") != self._rtl, is_shift=is_shift, is_word=is_word)
            case "home":
                self.move_to(0 if is_word else self._find_line_begin(), is_shift=is_shift)
            case "end":
                self.move_to(len(self.text) if is_word else self._find_line_end(), is_shift=is_shift)
            case "enter" | "kp_enter" if self.is_long:
                self.insert(_LINE_FEED, "typed")
            case _:
                return False
        return True

    def _move_step(self, is_onward: bool, *, is_shift: bool, is_word: bool) -> None:
        """Move the caret by a letter or a word; without Shift, move it from a selection to that end of it."""
        begin, end = self.edited.selection
        if begin != end and not is_shift:
            self.move_to(end if is_onward else begin)
        else:
            self.move_to(self._find_step_end(is_onward, is_word=is_word), is_shift=is_shift)

    def _find_step_end(self, is_onward: bool, *, is_word: bool) -> int:
        """Return the position one letter or, with ``is_word``, one word away from the caret."""
        if is_onward:
            find = _find_next
            letter_offset = 0  # the letter that a step crosses is at the caret
        else:
            find = _find_previous
            letter_offset = -1  # or just before it
        position = find(self.text, self.edited.caret)
        if is_word:
            while 0 < position < len(self.text) and _belongs_to_word(self.text[position + letter_offset]):
                position = find(self.text, position)
        return position

    def _delete(self, step_end: int) -> None:
        """Delete the selection or, if there is none, the text between the caret and ``step_end``."""
        begin, end = self.edited.selection
        if begin == end:
            begin, end = sorted((self.edited.caret, step_end))
        if begin != end:
            self._apply_change(EditedText(self.text[:begin] + self.text[end:], begin, begin), "typed")

    def _find_line_begin(self) -> int:
        return self.text.rfind(_LINE_FEED, 0, self.edited.caret) + 1

    def _find_line_end(self) -> int:
        end = self.text.find(_LINE_FEED, self.edited.caret)
        return len(self.text) if end < 0 else end

    def move_to(self, position: int, *, is_shift: bool = False) -> None:
        """Move the caret to a position; with ``is_shift``, the selection's anchor stays, else nothing is selected."""
        self._is_typing = False
        anchor = self.edited.anchor if is_shift else position
        self.edited = replace(self.edited, caret=position, anchor=anchor)

    def select_all(self) -> None:
        """Select the whole text."""
        self._is_typing = False
        self.edited = replace(self.edited, caret=len(self.text), anchor=0)

    def select_word(self, position: int) -> None:
        """Select the word at a position, as a double click does."""
        begin = end = position
        while begin > 0 and _belongs_to_word(self.text[begin - 1]):
            begin -= 1
        while end < len(self.text) and _belongs_to_word(self.text[end]):
            end += 1
        self._is_typing = False
        self.edited = replace(self.edited, caret=end, anchor=begin)

    def cut(self) -> str:
        """Remove the selected text and return it; "" if nothing is selected."""
        text = self.edited.selected_text
        if text:
            self._delete(self.edited.caret)
        return text

    def undo(self) -> None:
        """Undo the last change."""
        self._restore(self._undo, self._redo)

    def redo(self) -> None:
        """Redo the change that was undone last."""
        self._restore(self._redo, self._undo)

    def _restore(self, history: list[EditedText], opposite_history: list[EditedText]) -> None:
        """Go back to the latest text of a history, if it has one, and keep the present text in the opposite history."""
        if history:
            opposite_history.append(self.edited)
            self.edited = history.pop()
            self.changes.add("undone")
            self._is_typing = False

    def _apply_change(self, edited: EditedText, change: TextChange) -> None:
        """Replace the text, and keep the old one for undo, except between letters typed one after the other."""
        is_letter = change == "typed" and len(edited.text) == len(self.text) + 1
        if not (is_letter and self._is_typing):
            self._undo = [*self._undo[1 - _MAX_UNDO :], self.edited]
        self._is_typing = is_letter and edited.text[edited.caret - 1] != _LINE_FEED
        self._redo.clear()
        self.changes.add(change)
        self.edited = edited


def _belongs_to_word(letter: str) -> bool:
    """Return whether a character is part of a word: a letter, a digit, a combining mark or an underscore."""
    return letter.isalnum() or letter == "_" or unicodedata.category(letter).startswith("M")


def _extends_letter(text: str, position: int) -> bool:
    """Return whether the code point at a position is a mark on the letter before it, or is joined to that letter."""
    letter = text[position]
    is_mark = unicodedata.category(letter).startswith("M") or letter in (_JOINER, "\N{VARIATION SELECTOR-16}")
    return is_mark or text[position - 1] == _JOINER


def _find_next(text: str, position: int) -> int:
    """Return the position after the letter at a position and its combining marks."""
    position = min(len(text), position + 1)
    while position < len(text) and _extends_letter(text, position):
        position += 1
    return position


def _find_previous(text: str, position: int) -> int:
    """Return the position before the letter, with its combining marks, that ends at a position."""
    position = max(0, position - 1)
    while position > 0 and _extends_letter(text, position):
        position -= 1
    return position
