"""Cells that other programs would take for something else: formulas, times, large numbers."""

import string

import numpy as np
import pyarrow as pa
import pytest

from minihuman.dataset.table_types import guard_text, guard_texts, parse_times, unguard_text
from minihuman.experiment.plan.ambiguous_texts import explain_misreading, list_ambiguous_texts
from minihuman.experiment.protocol.protocol import decode_protocol
from tests.study.test_protocol import DEMO

FORMULAS = ["=1+1", "+SUM(A1)", "-2+3+cmd|' /C calc'!A0", "@SUM(A1)", "a;=1+1", "a\n=1", "\t=1", "=", "'=1"]


@pytest.mark.parametrize("text", FORMULAS)
def test_no_cell_begins_as_a_formula_at_any_separator(text):
    guarded = guard_text(text)
    for separator in ";\t\r\n":
        assert not any(cell[:1] in "=+-@" and cell for cell in guarded.split(separator))
    assert unguard_text(guarded) == text


@pytest.mark.parametrize("text", ["-5", "+49", "-1.5e-3", "1,5", "sub-01", "a=b", "", "it's", "'quoted'", "e-mail@x"])
def test_numbers_and_ordinary_texts_stay_as_they_are(text):
    assert guard_text(text) == text == unguard_text(text)


def test_every_text_comes_back():
    rng = np.random.default_rng(3)
    letters = [*"=+-@';\t\r\n1", *string.ascii_letters[:3]]
    texts = ["".join(rng.choice(letters, size=rng.integers(0, 7))) for _ in range(3000)]
    assert [unguard_text(guard_text(text)) for text in texts] == texts
    assert guard_texts(pa.chunked_array([texts])).to_pylist() == [guard_text(text) for text in texts]


def test_missing_texts_stay_missing():
    assert guard_texts(pa.chunked_array([["=1", None, "a"]])).to_pylist() == ["'=1", None, "a"]


def test_a_time_of_the_wall_clock_has_its_zone():
    times = parse_times(pa.array(["2026-01-31T12:00:00.123456789Z", None, "2026-01-31T12:00:00Z"]))
    assert times.type == pa.timestamp("us", tz="UTC")
    assert [str(time) for time in times.to_pylist()] == [
        "2026-01-31 12:00:00.123456+00:00",
        "None",
        "2026-01-31 12:00:00+00:00",
    ]


@pytest.mark.parametrize(
    ("text", "misreading"),
    [
        ("NA", "a missing value"),
        ("null", "a missing value"),
        ("1.10", "a number"),
        ("007", "a number"),
        ("1e5", "a number"),
        ("Inf", "a number"),
        ("99999999999999999", "a number"),
        ("TRUE", "true or false"),
        ("T", "true or false"),
        ("2024-01-02", "a date"),
        ("3/4", "a date"),
        ("MAR1", "a date"),
        ("=1", "a formula"),
        *((text, "") for text in ("1", "-7", "0.25", "1.1", "sub-01", "yes", "Nathan", "march")),
    ],
)
def test_what_programs_that_guess_take_a_text_for(text, misreading):
    assert explain_misreading(text) == misreading


def test_check_names_the_texts_of_a_protocol_that_are_misread():
    toml = DEMO.replace('version = "1.0"', 'version = "1.10"')
    toml += """
[[questions]]
name = "about"
items = [{ name = "answer", kind = "choice", ask = "?", options = ["yes", "NA"], codes = ["true", "001"] }]
"""
    lines = list(list_ambiguous_texts(decode_protocol(toml.encode())))
    assert [line.partition(": ")[2].partition(";")[0] for line in lines] == [
        "study.version '1.10', about.answer '001'",
        "about.answer 'true'",
        "about.answer 'NA'",
    ]
    assert list(list_ambiguous_texts(decode_protocol(DEMO.encode()))) == []
