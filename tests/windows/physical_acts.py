"""A hand at the keyboard and the mouse before a screen with two windows, and the acts that it can do.

The X server makes the acts (XTEST), under a window manager; a second keyboard is the server's own. A touch screen is
none of its devices: touches are made in browsers, by `tests/web/test_swipes.py` and `tests/web/test_phone.py`.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from Xlib import XK, X
from Xlib.ext import xtest

from tests.desktop import Desktop
from tests.xserver import Typist

LOOK_S = 0.25  # until an act has reached every window
REPEAT_S = 0.9  # until the system repeats a key that is held
FORGET_S = 2.1  # within 2 s Chromium calls a press a repeat of one whose release it did not see


class Hand:
    """A hand before a screen with two windows: the study's, and another."""

    def __init__(self, desk: Desktop, part_of_title: str, look: Callable[[float], None]) -> None:
        self.typist = Typist(desk.name)
        self.injected: list[tuple[str, int]] = []  # keys that went down, and when, by the monotonic clock
        display: Any = self.typist._display
        self._display = display
        self._look = look
        self._desk = desk
        self._study = display.create_resource_object("window", desk.find(part_of_title))
        self._other = display.screen().root.create_window(1100, 600, 200, 100, 0, X.CopyFromParent)
        self._other.map()
        display.sync()
        while self._other.get_attributes().map_state != X.IsViewable:
            self.look()

    def look(self, seconds: float = LOOK_S) -> None:
        """Wait, as people do between acts."""
        self._look(seconds)

    def leave(self) -> None:
        """Go to the other window."""
        self._focus(self._other)

    def come(self) -> None:
        """Come to the study's window."""
        self._focus(self._study)

    def _focus(self, window: Any) -> None:
        self._display.set_input_focus(window, X.RevertToParent, X.CurrentTime)
        self._display.sync()
        self.look()

    def tap(self, key: str) -> None:
        self.tap_fast(key)

    def tap_fast(self, *keys: str) -> None:
        """Tap keys with nothing between them."""
        for key in keys:
            self.injected.append((key, time.monotonic_ns()))
            self.typist.tap(key)
        self.look()

    def down(self, key: str) -> None:
        self.injected.append((key, time.monotonic_ns()))
        self.typist.press(key)
        self.look()

    def up(self, key: str) -> None:
        self.typist.release(key)
        self.look()

    def down_second(self, key: str) -> None:
        """Press a key of the second keyboard."""
        self.injected.append((key, time.monotonic_ns()))
        self.typist.fake_second(key, down=True)
        self.look()

    def up_second(self, key: str) -> None:
        self.typist.fake_second(key, down=False)
        self.look()

    def tap_place(self, key: str) -> None:
        """Press where a key stands on a US keyboard, whatever it types."""
        self.injected.append((key, time.monotonic_ns()))
        self.typist.tap_place(key)
        self.look()

    def point(self) -> None:
        """Move the pointer to the middle of the study's window, where nothing takes a click."""
        root = self._display.screen().root
        shape = self._study.get_geometry()
        corner = self._study.translate_coords(root, 0, 0)
        x = shape.width // 2 - corner.x
        y = shape.height // 2 - corner.y
        xtest.fake_input(self._display, X.MotionNotify, x=x, y=y)
        self._display.sync()

    def write(self, text: str) -> None:
        """Type any text, lines with Enter."""
        for number, line in enumerate(text.split("\n")):
            if number:
                self.tap("enter")
            if all(letter == " " or (letter.isascii() and letter.isalnum() and letter.islower()) for letter in line):
                self.tap_fast(*("space" if letter == " " else letter for letter in line))
                continue
            while line:
                line = self.typist.write(line)
                self.look(4 * LOOK_S)

    @property
    def study_height(self) -> int:
        return int(self._study.get_geometry().height)

    def point_at(self, x: int, y: int) -> None:
        """Move the pointer to a place in the study's window."""
        corner = self._study.translate_coords(self._display.screen().root, 0, 0)
        xtest.fake_input(self._display, X.MotionNotify, x=x - corner.x, y=y - corner.y)
        self._display.sync()

    def click_at(self, x: int, y: int, *, times: int = 1) -> None:
        self.point_at(x, y)
        for _ in range(times):
            self.typist.button(True)
            self.typist.button(False)
        self.look()

    def drag(self, begin: tuple[int, int], end: tuple[int, int]) -> None:
        self.point_at(*begin)
        self.typist.button(True)
        self.look()
        self.point_at(*end)
        self.look()
        self.typist.button(False)
        self.look()

    def click(self, button: int = 1) -> None:
        self.point()
        for down in (True, False):
            self.typist.button(down, button)
            self.look()

    def move(self, x: int, y: int) -> None:
        """Move the pointer by so much."""
        xtest.fake_input(self._display, X.MotionNotify, detail=True, x=x, y=y)
        self._display.sync()
        self.look()

    def minimise(self) -> None:
        self._desk.minimise_window(self._study.id)
        self.look()

    def restore(self) -> None:
        self._desk.restore_window(self._study.id)
        self.look()
        self.come()

    @contextmanager
    def whole_layout(self, name: str) -> Iterator[None]:
        """Have another layout of the whole keyboard, as a person chooses it from a menu."""
        self.typist.set_layout(name)
        self.look()
        try:
            yield
        finally:
            self.typist.set_layout("us")
            self.look()

    @contextmanager
    def other_layout(self) -> Iterator[None]:
        """Let the place of 2 type what it types in France."""
        keycode = self.typist.keycode("2")
        before = self._display.get_keyboard_mapping(keycode, 1)
        french = [[XK.string_to_keysym("eacute"), XK.string_to_keysym("2"), *before[0][2:]]]
        for symbols in (french, before):
            self._display.change_keyboard_mapping(keycode, symbols)
            self._display.sync()
            self.look()
            if symbols is french:
                yield

    def close(self) -> None:
        self._other.destroy()
        self.typist.close()


@contextmanager
def using_hand(desk: Desktop, part_of_title: str, look: Callable[[float], None]) -> Iterator[Hand]:
    hand = Hand(desk, part_of_title, look)
    try:
        hand.leave()
        hand.come()
        yield hand
    finally:
        hand.close()


Act = Callable[[Hand], None]


def hold_enter_elsewhere(hand: Hand) -> None:
    """On the consent page: hold Enter in another window, come back, let go; then agree."""
    hand.leave()
    hand.down("enter")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("enter")
    hand.tap("enter")  # agrees
    hand.tap("enter")  # ready


def hold_a_key_elsewhere(hand: Hand) -> None:
    hand.leave()
    hand.down("1")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("1")


def leave_with_a_key_held(hand: Hand) -> None:
    hand.down("1")
    hand.leave()
    hand.up("1")
    hand.come()
    hand.look(FORGET_S)


def roll_over(hand: Hand) -> None:
    hand.down("1")
    hand.down("2")
    hand.up("1")
    hand.up("2")


def press_beside_modifiers(hand: Hand) -> None:
    for modifier in ("left_ctrl", "left_alt", "left_shift"):
        hand.down(modifier)
        hand.tap("2")
        hand.up(modifier)


def come_and_go_with_two_keys_held(hand: Hand) -> None:
    hand.leave()
    hand.down("1")
    hand.down("2")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("2")
    hand.up("1")


def hold_a_key_until_it_repeats(hand: Hand) -> None:
    hand.down("2")
    hand.look(REPEAT_S)
    hand.up("2")


def leave_and_come_with_a_key_held(hand: Hand) -> None:
    hand.down("1")
    hand.leave()
    hand.come()
    hand.look(REPEAT_S)
    hand.up("1")


def come_beside_a_modifier(hand: Hand) -> None:
    """As by Alt+Tab: the modifier is still down when the window has the focus."""
    hand.leave()
    hand.down("left_alt")
    hand.come()
    hand.tap("1")
    hand.up("left_alt")
    hand.tap("1")


def roll_three_over(hand: Hand) -> None:
    for key in ("1", "2", "3"):
        hand.down(key)
    for key in ("2", "1", "3"):
        hand.up(key)


def roll_back(hand: Hand) -> None:
    hand.down("1")
    hand.down("2")
    hand.up("2")
    hand.up("1")


def tap_twice(hand: Hand) -> None:
    hand.tap_fast("3", "3")


def click_into_the_window(hand: Hand) -> None:
    hand.click()
    hand.tap("1")


def click_to_come(hand: Hand) -> None:
    """The click that brings the focus, and a key behind it."""
    hand.leave()
    hand.click()
    hand.tap("1")


def click_beside_a_key(hand: Hand) -> None:
    hand.down("2")
    hand.click()
    hand.up("2")


def click_and_press_at_once(hand: Hand) -> None:
    hand.point()
    hand.typist.button(True)
    hand.tap_fast("1")
    hand.typist.button(False)
    hand.look()


def change_the_layout(hand: Hand) -> None:
    """In mid-session, to one where another symbol stands at the place of 2, and back."""
    hand.tap("2")
    with hand.other_layout():
        hand.tap_place("2")
    hand.tap("2")


def press_beside_alt_graph(hand: Hand) -> None:
    hand.down("right_alt")
    hand.tap("1")
    hand.up("right_alt")


def let_go_of_the_modifier_first(hand: Hand) -> None:
    hand.down("left_ctrl")
    hand.down("2")
    hand.up("left_ctrl")
    hand.up("2")


def press_the_modifier_last(hand: Hand) -> None:
    hand.down("1")
    hand.down("left_shift")
    hand.up("1")
    hand.up("left_shift")


def press_under_both_shifts(hand: Hand) -> None:
    hand.down("left_shift")
    hand.down("right_shift")
    hand.tap("3")
    hand.up("right_shift")
    hand.up("left_shift")


def press_under_caps_lock(hand: Hand) -> None:
    hand.tap("caps_lock")
    hand.tap("1")
    hand.tap("caps_lock")


def press_under_num_lock(hand: Hand) -> None:
    hand.tap("num_lock")
    hand.tap("2")
    hand.tap("num_lock")


def hold_a_key_over_a_pause(hand: Hand) -> None:
    hand.down("1")
    hand.tap("f8")
    hand.up("1")
    hand.tap("enter")


def press_in_a_pause(hand: Hand) -> None:
    hand.tap("f8")
    hand.tap("2")
    hand.tap("enter")
    hand.tap("2")


def hold_the_key_that_goes_on(hand: Hand) -> None:
    hand.tap("f8")
    hand.down("enter")
    hand.look(REPEAT_S)
    hand.up("enter")


def ask_to_leave_and_stay(hand: Hand) -> None:
    hand.tap("escape")
    hand.tap("1")
    hand.tap("enter")
    hand.tap("1")


def leave_with_a_modifier_held(hand: Hand) -> None:
    hand.down("left_shift")
    hand.leave()
    hand.up("left_shift")
    hand.come()
    hand.tap("3")


def tap_elsewhere(hand: Hand) -> None:
    hand.leave()
    hand.tap("1")
    hand.come()


def press_two_keys_in_two_windows(hand: Hand) -> None:
    hand.down("1")
    hand.leave()
    hand.down("2")
    hand.come()
    hand.up("2")
    hand.up("1")


def leave_in_a_pause(hand: Hand) -> None:
    hand.tap("f8")
    hand.leave()
    hand.come()
    hand.tap("enter")
    hand.tap("3")


def press_what_means_nothing(hand: Hand) -> None:
    hand.tap("x")
    hand.tap("kp_1")
    hand.tap("space")


def press_on_two_keyboards_in_turn(hand: Hand) -> None:
    hand.tap("1")
    hand.down_second("2")
    hand.up_second("2")
    hand.tap("1")


def roll_over_two_keyboards(hand: Hand) -> None:
    hand.down("1")
    hand.down_second("2")
    hand.up("1")
    hand.up_second("2")


def press_beside_a_modifier_of_the_other_keyboard(hand: Hand) -> None:
    hand.down_second("left_ctrl")
    hand.tap("2")
    hand.up_second("left_ctrl")


def hold_a_key_of_the_other_keyboard_elsewhere(hand: Hand) -> None:
    hand.leave()
    hand.down_second("1")
    hand.come()
    hand.tap("2")
    hand.up_second("1")


def tap_three_keys_in_a_burst(hand: Hand) -> None:
    hand.tap_fast("1", "2", "3")


def hold_two_keys_until_one_repeats(hand: Hand) -> None:
    hand.down("1")
    hand.down("3")
    hand.look(REPEAT_S)
    hand.up("3")
    hand.look(REPEAT_S)
    hand.up("1")


def leave_while_a_key_repeats(hand: Hand) -> None:
    hand.down("3")
    hand.look(REPEAT_S)
    hand.leave()
    hand.up("3")
    hand.come()
    hand.look(FORGET_S)


def press_anew_what_came_held(hand: Hand) -> None:
    hand.leave()
    hand.down("1")
    hand.come()
    hand.up("1")
    hand.tap("1")


def press_beside_what_came_held(hand: Hand) -> None:
    hand.leave()
    hand.down("1")
    hand.come()
    hand.tap("2")
    hand.up("1")


def hold_enter_elsewhere_over_a_pause(hand: Hand) -> None:
    """An Enter that was down before the window had the focus does not end a pause."""
    hand.tap("f8")
    hand.leave()
    hand.down("enter")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("enter")
    hand.tap("enter")
    hand.tap("1")


def hold_enter_elsewhere_over_the_question(hand: Hand) -> None:
    hand.tap("escape")
    hand.leave()
    hand.down("enter")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("enter")
    hand.tap("enter")
    hand.tap("1")


def hold_escape_elsewhere(hand: Hand) -> None:
    """It neither asks whether to leave nor, held for longer, ends the session."""
    hand.leave()
    hand.down("escape")
    hand.come()
    hand.look(FORGET_S)
    hand.up("escape")
    hand.tap("2")


def hold_the_pause_key_elsewhere(hand: Hand) -> None:
    hand.leave()
    hand.down("f8")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("f8")
    hand.tap("2")


def hold_escape_for_a_moment(hand: Hand) -> None:
    hand.down("escape")
    hand.look(REPEAT_S)
    hand.up("escape")
    hand.tap("enter")
    hand.tap("3")


def ask_to_leave_and_leave_the_window(hand: Hand) -> None:
    hand.down("escape")
    hand.leave()
    hand.up("escape")
    hand.come()
    hand.tap("enter")
    hand.tap("3")


def chord_of_two_modifiers(hand: Hand) -> None:
    hand.down("left_ctrl")
    hand.down("left_alt")
    hand.tap("2")
    hand.up("left_alt")
    hand.up("left_ctrl")


def press_beside_the_right_modifiers(hand: Hand) -> None:
    for modifier in ("right_ctrl", "right_shift"):
        hand.down(modifier)
        hand.tap("3")
        hand.up(modifier)


def take_the_modifier_while_a_key_is_held(hand: Hand) -> None:
    hand.down("1")
    hand.down("left_ctrl")
    hand.up("1")
    hand.tap("2")
    hand.up("left_ctrl")


def change_a_key_while_it_is_held(hand: Hand) -> None:
    hand.down("2")
    with hand.other_layout():
        hand.up("2")
    hand.tap("2")


def type_on_a_french_layout(hand: Hand) -> None:
    """Its digits are typed with Shift; the places count."""
    with hand.whole_layout("fr"):
        for key in ("1", "2", "3"):
            hand.tap_place(key)
    hand.tap("1")


def type_letters_in_a_burst(hand: Hand) -> None:
    hand.tap_fast("x", "y", "z")


def press_the_keys_of_an_editor(hand: Hand) -> None:
    for key in ("home", "end", "insert", "delete", "backspace", "left", "right", "page_down"):
        hand.tap(key)


def press_a_digit_of_the_number_pad(hand: Hand) -> None:
    hand.tap("num_lock")
    hand.tap("kp_1")
    hand.tap("num_lock")


def click_twice(hand: Hand) -> None:
    hand.click()
    hand.click()
    hand.tap("2")


def click_with_the_middle_button(hand: Hand) -> None:
    hand.click(2)
    hand.tap("1")


def turn_the_wheel_beside_a_key(hand: Hand) -> None:
    hand.down("1")
    hand.click(5)
    hand.click(4)
    hand.up("1")


def drag_over_a_key(hand: Hand) -> None:
    hand.point()
    hand.typist.button(True)
    hand.move(40, 20)
    hand.tap("2")
    hand.move(-40, -20)
    hand.typist.button(False)
    hand.look()


def leave_with_a_button_held(hand: Hand) -> None:
    hand.point()
    hand.typist.button(True)
    hand.look()
    hand.leave()
    hand.typist.button(False)
    hand.come()
    hand.tap("1")


def minimise_with_a_key_held(hand: Hand) -> None:
    hand.down("1")
    hand.minimise()
    hand.up("1")
    hand.restore()
    hand.tap("2")


def come_by_a_click_with_a_key_held(hand: Hand) -> None:
    hand.leave()
    hand.down("1")
    hand.click()
    hand.look(REPEAT_S)
    hand.up("1")
    hand.tap("2")


SAMPLE: tuple[Act, ...] = (
    hold_enter_elsewhere,
    leave_with_a_key_held,
    press_beside_modifiers,
)
ALL: tuple[Act, ...] = (
    *SAMPLE,
    hold_a_key_elsewhere,
    roll_over,
    come_and_go_with_two_keys_held,
    hold_a_key_until_it_repeats,
    leave_and_come_with_a_key_held,
    come_beside_a_modifier,
    roll_three_over,
    roll_back,
    tap_twice,
    click_into_the_window,
    click_to_come,
    click_beside_a_key,
    click_and_press_at_once,
    change_the_layout,
    press_beside_alt_graph,
    let_go_of_the_modifier_first,
    press_the_modifier_last,
    press_under_both_shifts,
    press_under_caps_lock,
    press_under_num_lock,
    hold_a_key_over_a_pause,
    press_in_a_pause,
    hold_the_key_that_goes_on,
    ask_to_leave_and_stay,
    leave_with_a_modifier_held,
    tap_elsewhere,
    press_two_keys_in_two_windows,
    leave_in_a_pause,
    press_what_means_nothing,
    press_on_two_keyboards_in_turn,
    roll_over_two_keyboards,
    press_beside_a_modifier_of_the_other_keyboard,
    hold_a_key_of_the_other_keyboard_elsewhere,
    tap_three_keys_in_a_burst,
    hold_two_keys_until_one_repeats,
    leave_while_a_key_repeats,
    press_anew_what_came_held,
    press_beside_what_came_held,
    hold_enter_elsewhere_over_a_pause,
    hold_enter_elsewhere_over_the_question,
    hold_escape_elsewhere,
    hold_the_pause_key_elsewhere,
    hold_escape_for_a_moment,
    ask_to_leave_and_leave_the_window,
    chord_of_two_modifiers,
    press_beside_the_right_modifiers,
    take_the_modifier_while_a_key_is_held,
    change_a_key_while_it_is_held,
    type_on_a_french_layout,
    type_letters_in_a_burst,
    press_the_keys_of_an_editor,
    press_a_digit_of_the_number_pad,
    click_twice,
    click_with_the_middle_button,
    turn_the_wheel_beside_a_key,
    drag_over_a_key,
    leave_with_a_button_held,
    minimise_with_a_key_held,
    come_by_a_click_with_a_key_held,
)
