import pygame
import pytest

from minihuman.display.windows.keyboard import key_from_scancode, key_from_symbol, key_from_xkb, key_to_scancode
from minihuman.experiment.keys import KEY_NAMES


def test_every_name_has_a_scancode_that_leads_back() -> None:
    assert {key_from_scancode(key_to_scancode(key)) for key in KEY_NAMES} == KEY_NAMES


@pytest.mark.parametrize(
    ("constant", "key"),
    [
        ("KSCAN_A", "a"),
        ("KSCAN_1", "1"),
        ("KSCAN_0", "0"),
        ("KSCAN_RETURN", "enter"),
        ("KSCAN_KP_7", "kp_7"),
        ("KSCAN_KP_0", "kp_0"),
        ("KSCAN_F12", "f12"),
        ("KSCAN_RIGHT", "right"),
        ("KSCAN_PAGEUP", "page_up"),
        ("KSCAN_NUMLOCKCLEAR", "num_lock"),
        ("KSCAN_RALT", "right_alt"),
        ("KSCAN_GRAVE", "grave"),
    ],
)
def test_scancodes_are_sdls(constant: str, key: str) -> None:
    assert key_from_scancode(getattr(pygame, constant)) == key


def test_a_key_without_a_name_is_called_after_its_number() -> None:
    assert key_from_scancode(100) == "scancode_100"
    assert key_from_xkb("LSGT", 94) == "keycode_94"
    assert key_from_symbol("HASH") == "symbol_hash"


@pytest.mark.parametrize(
    ("symbol", "key"), [("_1", "1"), ("NUM_1", "kp_1"), ("NUM_END", "kp_1"), ("A", "a"), ("UP", "up"), ("F9", "f9")]
)
def test_pyglets_symbols_are_read_as_on_a_us_keyboard(symbol: str, key: str) -> None:
    assert key_from_symbol(symbol) == key
