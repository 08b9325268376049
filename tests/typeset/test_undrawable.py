"""A language that no face here can set: refused before anybody sits down, and named with the way out."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from minihuman.admin.legibility import list_undrawable_languages
from minihuman.cli.command_line import make_command_line
from minihuman.display import typefaces
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.doctor import examine_machine
from tests.promises.sessions import TOML
from tests.typeset.screen_digests import forget_typefaces

CHINESE = TOML.format(episodes=1, steps=3).replace('version = "1"', 'version = "1"\nlanguage = "zh"')


@pytest.fixture(autouse=True)
def no_faces_but_the_shipped(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(typefaces, "_list_font_folders", lambda: iter([Path("/nowhere/fonts")]))
    forget_typefaces()
    yield
    forget_typefaces()


@pytest.mark.parametrize(
    "command", [("check",), ("run", "--window", "pygame"), ("serve", "--port", "0")], ids=["check", "run", "serve"]
)
def test_a_study_in_it_is_refused_in_one_line_with_the_way_out(command: tuple[str, ...], tmp_path: Path) -> None:
    protocol = tmp_path / "chinese.toml"
    protocol.write_text(CHINESE, encoding="utf-8")
    name, *options = command
    data = [] if name == "check" else ["--data", str(tmp_path)]
    refusal = CliRunner().invoke(make_command_line(), [name, str(protocol), *options, *data])
    assert refusal.exit_code != 0
    said = str(refusal.exception) or refusal.output
    assert "no face on this machine can set" in said
    assert "fonts-noto-cjk" in said
    assert "into /nowhere/fonts" in said


def test_arabic_and_hebrew_need_nothing_that_a_machine_lacks() -> None:
    assert list_undrawable_languages().keys() == {"zh", "ja"}


def test_the_doctor_names_it_and_finds_a_machine_unfit_for_a_study_in_it(tmp_path: Path) -> None:
    study = decode_protocol(CHINESE.encode())
    findings = {finding.name: finding for finding in examine_machine(window="none", data=tmp_path, protocol=study)}
    assert findings["languages"].value.startswith("en, de, fr, es, ar, he; not zh: no face on this machine can set")
    assert findings["languages"].unfit_because == ""
    assert "can set" in findings["texts"].value
    assert findings["texts"].unfit_because == "a text of the study cannot be read here"


def test_the_doctor_says_that_every_text_of_a_study_can_be_read(tmp_path: Path) -> None:
    study = decode_protocol(TOML.format(episodes=1, steps=3).encode())
    findings = {finding.name: finding for finding in examine_machine(window="none", data=tmp_path, protocol=study)}
    assert findings["texts"].value == "every text of the study can be read, in 'en'"
    assert findings["texts"].unfit_because == ""
