"""Figures as files."""

import io
import re
import zlib

import numpy as np
import pytest
from fontTools.ttLib import TTFont

from minihuman.figures import figure_data, style
from minihuman.figures.figure_data import digest_figure, draw_figure_files, group_by_block
from minihuman.figures.path_figures import paths_figure
from minihuman.figures.style import save_figure
from tests.builders import session

CURVES = {"grid_first": np.array([[0.1, 0.5], [0.3, 0.9]]), "direct": np.array([[0.0, 0.2], [0.1, np.nan]])}
OPTIONS = {"measure": "reward", "limits": (0.0, 1.0)}


def draw(stem):
    return save_figure(paths_figure([("grid", session(blocks=("grid",), episodes=1).episodes)], across=1), stem)


def test_the_same_data_give_the_same_files_with_no_date_and_no_program_version(tmp_path):
    first, again = draw(tmp_path / "a" / "paths"), draw(tmp_path / "b" / "paths")
    assert [path.name for path in first] == ["paths.png", "paths.pdf"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
    for word in (b"CreationDate", b"Matplotlib", b"matplotlib"):
        assert not any(word in path.read_bytes() for path in first)


def test_a_pdf_embeds_the_outlines_of_its_letters_and_no_table_that_places_them(tmp_path):
    content = draw(tmp_path / "paths")[1].read_bytes()
    streams = [zlib.decompress(packed) for packed in re.findall(rb"stream\n(.*?)\nendstream", content, re.DOTALL)]
    faces = [TTFont(io.BytesIO(stream)) for stream in streams if stream.startswith(b"\0\1\0\0")]
    assert faces
    for face in faces:
        assert {"glyf", "loca", "hmtx"} <= set(face.keys())
        assert {"GDEF", "GPOS", "GSUB", "MATH", "kern"}.isdisjoint(face.keys())


def test_a_figure_is_drawn_again_only_where_its_data_changed_or_a_file_is_not_whole(tmp_path, monkeypatch):
    stem, drawn = tmp_path / "curve", []
    save = style.save_figure
    monkeypatch.setattr(style, "save_figure", lambda *given, **named: drawn.append(save(*given, **named)))

    def count(curves=CURVES, **options):
        draw_figure_files(stem, "learning_curves.learning_figure", curves, **{**OPTIONS, **options})
        return len(drawn)

    assert (count(), count()) == (1, 1)
    first = {ending: stem.with_suffix(ending).read_bytes() for ending in (".png", ".pdf")}
    assert count({**CURVES, "direct": CURVES["direct"] + 0.1}) == 2
    assert stem.with_suffix(".png").read_bytes() != first[".png"]
    assert count() == 3
    for number, (ending, content) in enumerate(first.items(), 4):
        assert stem.with_suffix(ending).read_bytes() == content
        stem.with_suffix(ending).write_bytes(content[:-20])
        assert count() == number
    assert count() == 5


@pytest.mark.parametrize(
    ("curves", "options"),
    [
        ({**CURVES, "direct": CURVES["direct"][:1]}, OPTIONS),
        ({"grid_first": CURVES["grid_first"], "straight": CURVES["direct"]}, OPTIONS),
        (dict(reversed(CURVES.items())), OPTIONS),
        (CURVES, {**OPTIONS, "measure": "Belohnung"}),
        (CURVES, {**OPTIONS, "limits": None}),
    ],
    ids=["a participant fewer", "a group's name", "the groups' order", "the axis", "the limits"],
)
def test_a_digest_tells_figures_apart(curves, options):
    assert digest_figure("a.b", (CURVES,), OPTIONS) == digest_figure("a.b", (dict(CURVES),), dict(OPTIONS))
    assert digest_figure("a.b", (CURVES,), OPTIONS) != digest_figure("a.b", (curves,), options)


def test_a_digest_follows_the_paths_of_an_episode_and_the_software(monkeypatch):
    log, other = session(blocks=("grid",), episodes=1), session(blocks=("grid",), episodes=1)
    digest = digest_figure("a.b", (group_by_block(log),), {})
    assert digest_figure("a.b", (group_by_block(other),), {}) == digest
    other.episodes[0].poses[1] += 0.25
    assert digest_figure("a.b", (group_by_block(other),), {}) != digest
    monkeypatch.setattr(figure_data, "_describe_software", lambda: ("another version",))
    assert digest_figure("a.b", (group_by_block(log),), {}) != digest
    with pytest.raises(TypeError, match="object, which has no digest"):
        digest_figure("a.b", (object(),), {})
