"""The facts about a study: optional, checked, and named when they cannot be."""

import re

import pytest

from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.specs import is_orcid
from tests.study.test_protocol import DEMO

ABOUT = """
[about]
title = "Keys found again"
description = "People find keys."
licence = "CC-BY-4.0"
funding = ["Grant 7"]
ethics_approvals = ["Board of the faculty, 2026-17"]
institution = "University of Nowhere"
keywords = ["navigation", "transfer"]
doi = "10.1234/abcd"
task_description = "Find the goal."
authors = [{ name = "Ada Lovelace", orcid = "0000-0002-1825-0097", email = "ada@example.org" }, { name = "N. N." }]
participant_columns = [
    { name = "age", type = "integer", unit = "year", description = "Age at the session." },
    { name = "hand", description = "The hand at the keys.", levels = { left = "left", right = "right" } },
]
[[devices]]
name = "gaze"
plugin = "lsl:EyeTracker"
channels = ["x", "y"]
units = ["px", "px"]
required = false
"""


def test_a_study_without_facts_is_one():
    assert decode_protocol(DEMO.encode()).about.title == ""


def test_every_fact_is_read():
    protocol = decode_protocol((DEMO + ABOUT).encode())
    assert [author.name for author in protocol.about.authors] == ["Ada Lovelace", "N. N."]
    assert protocol.about.participant_columns[1].levels == {"left": "left", "right": "right"}
    assert protocol.devices[0].channels == ("x", "y")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1825-0097", "1825-0098", "$.about.authors[0].orcid is '0000-0002-1825-0098', which is not an ORCID"),
        ("ada@", "ada", "$.about.authors[0].email is 'adaexample.org', which is not an e-mail address"),
        ('"N. N."', '" "', "$.about.authors[1].name is empty"),
        ("orcid", "orchid", "$.about.authors[0].orchid is not a field; did you mean 'orcid'?"),
        ("licence", "license", "$.about.license is not a field; did you mean 'licence'?"),
        ("CC-BY-4.0", "free for all", "$.about.licence is 'free for all'; use an SPDX identifier such as"),
        ("10.1234", "https://doi.org/10.1234", "$.about.doi is 'https://doi.org/10.1234/abcd'; write it as"),
        ('"navigation"', '""', "$.about.keywords[0] is empty; remove it"),
        ('"age"', '"participant"', "$.about.participant_columns[0].name is 'participant', the column of participants'"),
        ('"hand"', '"age"', "$.about.participant_columns[1].name is 'age' again"),
        ("Age at the session.", "", "$.about.participant_columns[0].description is empty"),
        ('"integer"', '"int"', "$.about.participant_columns[0].type is 'int'"),
        ('["px", "px"]', '["px"]', "$.devices[0].units has 1 for 2 channels"),
        ('["x", "y"]', '["x", "x"]', "$.devices[0].channels names a channel twice; give each its own name"),
        ('"gaze"', '"Gaze"', "$.devices[0].name is 'Gaze'; use lower-case"),
        ("lsl:EyeTracker", "", "$.devices[0].plugin is empty"),
    ],
)
def test_what_cannot_be_is_named_with_the_way_out(old, new, message):
    assert old in ABOUT
    with pytest.raises(ProtocolError) as caught:
        decode_protocol((DEMO + ABOUT.replace(old, new, 1)).encode(), "demo.toml")
    assert re.search(r"demo\.toml:\d+: " + re.escape(message), str(caught.value))


def test_check_digits_of_orcids():
    assert is_orcid("0000-0001-5109-3700")
    assert is_orcid("0000-0002-1694-233X")
    assert not is_orcid("0000-0002-1694-2330")
