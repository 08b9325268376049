"""What a page cannot do is refused before anybody is asked to take part."""

from dataclasses import replace
from pathlib import Path

import pytest

from minihuman.errors import ProtocolError
from minihuman.lab.protocol_file import read_protocol
from minihuman.study.activities import registry
from minihuman.study.activities.takeover import TAKEOVER
from minihuman.web.running import refuse_unserved

PROTOCOLS = Path(__file__).parents[2] / "protocols"


@pytest.mark.parametrize("name", ["teach-fourrooms", "fourrooms-transfer"])
def test_studies_are_served(name):
    refuse_unserved(read_protocol(PROTOCOLS / f"{name}.toml"))


def test_a_kind_that_needs_a_window_is_not(monkeypatch):
    monkeypatch.setitem(registry.OURS, "takeover", replace(TAKEOVER, browser=False))
    registry.kind_of.cache_clear()
    try:
        study = read_protocol(PROTOCOLS / "teach-fourrooms.toml")
        with pytest.raises(ProtocolError, match="part 'teach' is of kind 'takeover', which needs a window"):
            refuse_unserved(study)
    finally:
        registry.kind_of.cache_clear()
