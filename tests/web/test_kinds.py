"""What a page cannot do is refused before anybody is asked to take part."""

from dataclasses import replace
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import find_kind
from minihuman.web.server import process
from minihuman.web.server.process import require_browser_support

PROTOCOLS = Path(__file__).parents[2] / "protocols"


@pytest.mark.parametrize("name", ["teach-fourrooms", "fourrooms-transfer"])
def test_studies_are_served(name):
    require_browser_support(read_protocol(PROTOCOLS / f"{name}.toml"))


def test_a_kind_that_needs_a_window_is_not(monkeypatch):
    monkeypatch.setattr(process, "find_kind", lambda name: replace(find_kind(name), browser=name != "takeover"))
    study = read_protocol(PROTOCOLS / "teach-fourrooms.toml")
    with pytest.raises(ProtocolError, match="part 'teach' is of kind 'takeover', which cannot be shown in a browser"):
        require_browser_support(study)
