"""minihuman.ext has every port that a plug-in needs, and importing it takes nothing heavy."""

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from minihuman import ext
from tests.machine import needs

TEXT = (Path(__file__).parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")


PORTS = [pytest.param(name, marks=needs("learn")) if name.startswith("Learn") else name for name in ext.__all__]


@pytest.mark.parametrize("name", PORTS)
def test_every_name_is_the_port_itself(name: str) -> None:
    assert getattr(ext, name) is getattr(import_module(ext._MODULES[name]), name)


def test_the_ports_of_the_docs_are_there() -> None:
    table = [line for line in TEXT.splitlines() if line.startswith("| a")]
    named = {
        path.rpartition(".")[2] for line in table for path in re.findall(r"`(minihuman(?:\.\w+)+\.[A-Z]\w+)`", line)
    }
    assert named == {"Device", "Window"}
    assert named <= set(ext.__all__)


def test_importing_it_takes_nothing_heavy() -> None:
    heavy = "import sys, minihuman.ext; print({'torch', 'pygame', 'pandas'} & {*sys.modules})"
    found = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "set()"


def test_a_name_that_is_not_there_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Windo'"):
        getattr(ext, "Windo")  # noqa: B009
