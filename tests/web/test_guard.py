"""What the server does not put up with, and what its page says."""

import string

import pytest

from minihuman.experiment.protocol.specs import CompletionCodesSpec, WebSpec
from minihuman.experiment.protocol.web_spec import check_web
from minihuman.experiment.words import LANGUAGES
from minihuman.web.eligibility import (
    BrowserProperties,
    Completion,
    build_completion,
    check_eligibility,
    classify_ending,
    get_page_texts,
    load_page_texts,
)
from minihuman.web.http_security import HEADERS, build_headers, is_same_origin
from minihuman.web.traffic_limits import MESSAGE_BURST, MESSAGES_PER_S, RateLimit


def test_typing_is_within_the_allowance_and_a_flood_is_not():
    typing = RateLimit(0.0)
    assert all(typing.take(number / 40) for number in range(4000))
    flood = RateLimit(0.0)
    assert sum(flood.take(number / 1000) for number in range(2000)) <= MESSAGE_BURST + 2 * MESSAGES_PER_S + 1
    assert flood.take(60.0)


def test_sixty_steps_a_second_with_their_pictures_and_twenty_keys_are_never_held_back() -> None:
    page, per_s = RateLimit(0.0), 2 * 60 + 2 * 20 + 1
    assert all(page.take(number / per_s) for number in range(60 * per_s))


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
    assert is_same_origin(origin, host) is ours


def test_the_page_may_load_from_nowhere_else():
    headers = dict(HEADERS)
    assert headers["content-security-policy"].startswith("default-src 'self';")
    script = "script-src 'self' 'wasm-unsafe-eval';"  # compiling our own WebAssembly, and no text as a script
    assert script in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"].replace(script, "")
    assert headers["cross-origin-opener-policy"] == "same-origin"
    assert headers["cross-origin-embedder-policy"] == "require-corp"
    assert headers["cache-control"] == "no-store"


def test_no_other_page_shows_the_study_in_a_frame_but_those_of_the_listed_hosts():
    assert "frame-ancestors 'none'" in build_headers()["content-security-policy"]
    assert build_headers()["x-frame-options"] == "DENY"
    embedded = build_headers(["survey.example.org", "*.uni.example:8080"])
    assert embedded["content-security-policy"].endswith("frame-ancestors survey.example.org *.uni.example:8080")
    assert "x-frame-options" not in embedded
    assert embedded["cross-origin-embedder-policy"] == "require-corp"


@pytest.mark.parametrize(
    "host", ["https://a.example", "a.example/x", "*", "'self'", "A.example", "a.example; script-src *"]
)
def test_what_is_no_host_is_refused_in_embed_in(host):
    [(field, problem)] = check_web(WebSpec(embed_in=("survey.example.org", host)))
    assert field == "$.web.embed_in[1]"
    assert repr(host) in problem


@pytest.mark.parametrize(
    ("web", "properties", "why"),
    [
        (WebSpec(), BrowserProperties(), ""),
        (WebSpec(), BrowserProperties(keyboard=False), "keyboard"),
        (WebSpec(require_keyboard=False), BrowserProperties(keyboard=False), ""),
        (WebSpec(allowed_browsers=("firefox",)), BrowserProperties(browser="chrome"), "browser"),
        (WebSpec(min_window_size_px=(800, 600)), BrowserProperties(window_px=(800, 599)), "window"),
        (WebSpec(max_rtt_ms=200), BrowserProperties(rtt_ms=201.0), "latency"),
        (WebSpec(max_rtt_ms=200), BrowserProperties(), ""),
    ],
)
def test_who_does_not_fit_is_told_why(web, properties, why):
    assert check_eligibility(web, properties) == why


def test_a_study_for_a_gamepad_takes_nobody_without_one():
    assert check_eligibility(WebSpec(), BrowserProperties(), needs_gamepad=True) == "gamepad"
    assert check_eligibility(WebSpec(), BrowserProperties(gamepad=True), needs_gamepad=True) == ""


ONLINE = WebSpec(
    completion_codes=CompletionCodesSpec(complete="C1", declined="D2", failed_check="F3", timed_out="T4"),
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
    assert build_completion(ONLINE, classify_ending(reason, agreed=agreed, part_kind=kind)).code == code


def test_the_way_back_carries_code_and_id_and_nothing_else_gets_into_it():
    told = build_completion(ONLINE, "complete", person="a&b=c")
    assert told == Completion("complete", "C1", "https://app.example/done?cc=C1&who=a%26b%3Dc")
    assert build_completion(ONLINE, "quit").url == ""
    assert (
        build_completion(WebSpec(redirect="https://app.example/?x={id}"), "quit", person="7").url
        == "https://app.example/?x=7"
    )


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_says_everything_in_every_language(language):
    english, its = get_page_texts("en"), load_page_texts()[language]
    assert its.keys() == english.keys()
    for key, text in its.items():
        fields = sorted(name for _, name, _, _ in string.Formatter().parse(text) if name)
        assert fields == sorted(name for _, name, _, _ in string.Formatter().parse(english[key]) if name), key
        assert language == "en" or text != english[key], key


def test_a_language_of_ones_own_gets_english_around_the_study():
    assert get_page_texts("tlh") == get_page_texts("en")
