"""What the server does not put up with, and what its page says."""

import string

import pytest

from minihuman.study.online import Codes, Online
from minihuman.study.words import LANGUAGES
from minihuman.web.ending import Ending, end_of, ending
from minihuman.web.guard import BURST, HEADERS, MESSAGES_PER_S, Allowance, is_ours
from minihuman.web.said import all_said, said
from minihuman.web.screening import Door, misfit


def test_typing_is_within_the_allowance_and_a_flood_is_not():
    typing = Allowance(0.0)
    assert all(typing.take(number / 40) for number in range(4000))
    flood = Allowance(0.0)
    assert sum(flood.take(number / 1000) for number in range(2000)) <= BURST + 2 * MESSAGES_PER_S + 1
    assert flood.take(60.0)


@pytest.mark.parametrize(
    ("origin", "host", "ours"),
    [
        ("https://lab.example", "lab.example", True),
        ("http://127.0.0.1:8000", "127.0.0.1:8000", True),
        ("http://127.0.0.1:8000", "127.0.0.1:8001", False),
        ("https://evil.example", "lab.example", False),
        ("https://lab.example.evil", "lab.example", False),
        ("https://lab.example@evil.example", "lab.example", False),
        ("null", "lab.example", False),
        ("file://", "", False),
        ("http://[", "[", False),
        (None, "lab.example", False),
        ("", "", False),
    ],
)
def test_only_our_own_page_may_open_a_socket(origin, host, ours):
    assert is_ours(origin, host) is ours


def test_the_page_may_load_from_nowhere_else():
    headers = dict(HEADERS)
    assert headers["content-security-policy"].startswith("default-src 'self';")
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["cross-origin-opener-policy"] == "same-origin"
    assert headers["cross-origin-embedder-policy"] == "require-corp"
    assert headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    ("web", "door", "why"),
    [
        (Online(), Door(), ""),
        (Online(), Door(keyboard=False), "keyboard"),
        (Online(keyboard=False), Door(keyboard=False), ""),
        (Online(browsers=("firefox",)), Door(browser="chrome"), "browser"),
        (Online(min_window_px=(800, 600)), Door(window_px=(800, 599)), "window"),
        (Online(max_rtt_ms=200), Door(rtt_ms=201.0), "line"),
        (Online(max_rtt_ms=200), Door(), ""),
    ],
)
def test_who_does_not_fit_is_told_why(web, door, why):
    assert misfit(web, door) == why


ONLINE = Online(
    codes=Codes(complete="C1", declined="D2", failed_check="F3", timed_out="T4"),
    redirect="https://app.example/done?cc={code}&who={id}",
)


@pytest.mark.parametrize(
    ("reason", "agreed", "kind", "code"),
    [
        ("complete", True, "page", "C1"),
        ("declined", False, "page", "D2"),
        ("quit", False, "page", "D2"),
        ("quit", True, "play", ""),
        ("screened_out", True, "questions", "F3"),
        ("screened_out", True, "play", ""),
        ("timed_out", True, "play", "T4"),
        ("connection_lost", True, "play", "T4"),
        ("disk_full", True, "play", ""),
    ],
)
def test_each_end_has_its_own_code(reason, agreed, kind, code):
    assert ending(ONLINE, end_of(reason, agreed=agreed, part_kind=kind)).code == code


def test_the_way_back_carries_code_and_id_and_nothing_else_gets_into_it():
    told = ending(ONLINE, "complete", person="a&b=c")
    assert told == Ending("complete", "C1", "https://app.example/done?cc=C1&who=a%26b%3Dc")
    assert ending(ONLINE, "quit").url == ""
    assert ending(Online(redirect="https://app.example/?x={id}"), "quit", person="7").url == "https://app.example/?x=7"


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_says_everything_in_every_language(language):
    english, its = said("en"), all_said()[language]
    assert its.keys() == english.keys()
    for key, text in its.items():
        fields = sorted(name for _, name, _, _ in string.Formatter().parse(text) if name)
        assert fields == sorted(name for _, name, _, _ in string.Formatter().parse(english[key]) if name), key
        assert language == "en" or text != english[key], key


def test_a_language_of_ones_own_gets_english_around_the_study():
    assert said("tlh") == said("en")
