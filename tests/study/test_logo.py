"""A study's logo: a picture above the consent and the last words, in the plan and so in the log."""

import io
import re
from pathlib import Path

import pytest
from PIL import Image, ImageDraw

from minihuman import simulate, verify
from minihuman.activities.pages.plan import PagePlan
from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import ProtocolError
from minihuman.log.read.session_reader import read_log

_TOML = """
[study]
name = "logo"
version = "1"
seed = 4
consent = "You will play one round of a game. Taking part is voluntary."
logo = "logo.png"
[keys]
pool = ["1", "2", "3"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["play"]
[[blocks]]
name = "play"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 2
instructions = "Find the goal."
"""


def _png(colour: str = "#c02040") -> bytes:
    image = Image.new("RGB", (300, 120), "white")
    ImageDraw.Draw(image).ellipse((20, 10, 120, 110), fill=colour)
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A study with a logo."""
    study = tmp_path / "study"
    study.mkdir()
    (study / "p.toml").write_text(_TOML)
    (study / "logo.png").write_bytes(_png())
    return study


def test_the_consent_and_the_last_words_have_the_logo_and_the_session_is_proven(folder: Path):
    (log,) = simulate(folder / "p.toml", participants=1, data=folder.parent / "data")
    pages = [part for part in read_log(log).plan.parts if isinstance(part.plan, PagePlan)]
    assert [(part.name, part.plan.pictures) for part in pages] == [("consent", (_png(),)), ("closing", (_png(),))]
    assert all(line.ok for line in verify(log))
    (folder / "logo.png").unlink()
    assert all(line.ok for line in verify(log)), "the log has it"


def test_a_page_with_a_picture_of_its_own_keeps_it(folder: Path):
    Image.new("RGB", (8, 8), "green").save(folder / "own.png")
    text = _TOML.replace('blocks = ["play"]', 'parts = ["agree", "play"]')
    text += '[[pages]]\nname = "agree"\ntext = "Do you agree?"\nasks_consent = true\nimages = ["own.png"]\n'
    (folder / "p.toml").write_text(re.sub(r"(?m)^consent = .*$", "", text))
    (log,) = simulate(folder / "p.toml", participants=1, data=folder.parent / "data")
    pages = [part for part in read_log(log).plan.parts if isinstance(part.plan, PagePlan)]
    found = {part.name: part.plan.pictures for part in pages}
    assert found["agree"] == ((folder / "own.png").read_bytes(),)
    assert found["closing"] == (_png(),)
    assert all(line.ok for line in verify(log))


def test_a_logo_that_is_no_picture_is_refused_by_its_field(folder: Path):
    (folder / "logo.png").write_bytes(b"GIF89a")
    with pytest.raises(ProtocolError, match=r"\$\.study\.logo: .* is not a PNG"):
        read_protocol(folder / "p.toml")


def test_a_picture_that_only_a_group_s_page_has_is_read_too(folder: Path):
    Image.new("RGB", (8, 8), "green").save(folder / "own.png")
    text = _TOML.replace('blocks = ["play"]', 'parts = ["agree", "play"]')
    text += '[[pages]]\nname = "agree"\ntext = "Do you agree?"\nasks_consent = true\n'
    text += '[pages.group_overrides.all]\nimages = ["own.png"]\n'
    (folder / "p.toml").write_text(re.sub(r"(?m)^(consent|logo) = .*$", "", text))
    (log,) = simulate(folder / "p.toml", participants=1, data=folder.parent / "data")
    (page,) = [part.plan for part in read_log(log).plan.parts if part.name == "agree"]
    assert page.pictures == ((folder / "own.png").read_bytes(),)
    assert all(line.ok for line in verify(log))
