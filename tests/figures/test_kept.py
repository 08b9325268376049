"""Kept figures: a second report draws nothing, and no figure is ever one of something else."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as planned

import minihuman
from minihuman.data.caches import FIGURES
from minihuman.figures import drawings, files, kept
from minihuman.figures.drawn_from import session_blocks
from minihuman.figures.kept import KeptFigures, drawn_with
from minihuman.statistics.survival import Waited
from tests.builders import session

pytestmark = pytest.mark.program

CURVES = {"grid_first": np.array([[0.1, 0.5], [0.3, 0.9]]), "direct": np.array([[0.0, 0.2], [0.1, np.nan]])}
SAID = {"measure": "reward", "limits": (0.0, 1.0)}


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return tmp_path / "study"


def drawn(study, out, curves=CURVES, stem="grid_reward", **said) -> dict[str, bytes]:
    both = KeptFigures(study).save(out / stem, drawings.learning, curves, **{**SAID, **said})
    return {path.suffix: path.read_bytes() for path in both}


def refuse_to_draw(monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("drawn again")

    monkeypatch.setattr(files, "save", refuse)


def test_what_is_drawn_of_the_same_is_copied_to_wherever_it_is_wanted(study, tmp_path, monkeypatch):
    first = drawn(study, tmp_path / "one")
    refuse_to_draw(monkeypatch)
    assert drawn(study, tmp_path / "two" / "deep") == first
    assert first[".png"].startswith(b"\x89PNG")
    assert first[".pdf"].startswith(b"%PDF")


OTHERS = {
    "one value": {"curves": {**CURVES, "direct": np.array([[0.0, 0.25], [0.1, np.nan]])}},
    "one participant fewer": {"curves": {**CURVES, "direct": CURVES["direct"][:1]}},
    "a group's name": {"curves": {"grid_first": CURVES["grid_first"], "straight": CURVES["direct"]}},
    "the groups' order": {"curves": dict(reversed(CURVES.items()))},
    "the axis' words": {"measure": "Belohnung"},
    "the limits": {"limits": None},
}


@pytest.mark.parametrize("other", OTHERS)
def test_a_figure_of_something_else_is_drawn(study, tmp_path, other):
    first = drawn(study, tmp_path / "one")
    second = drawn(study, tmp_path / "two", **OTHERS[other])
    assert second[".png"] != first[".png"]
    assert second == drawn(tmp_path / "no study", tmp_path / "anew", **OTHERS[other])
    assert drawn(study, tmp_path / "three") == first


def test_another_kind_of_figure_of_the_same_name_is_drawn(study, tmp_path):
    groups = {"direct": Waited(np.array([1.0, 2.0]), np.array([True, False]))}
    first = drawn(study, tmp_path / "one")
    png, _ = KeptFigures(study).save(tmp_path / "two" / "grid_reward", drawings.waiting, groups, label="s")
    assert png.read_bytes() != first[".png"]
    later = {"direct": Waited(np.array([1.0, 2.0]), np.array([True, True]))}
    again, _ = KeptFigures(study).save(tmp_path / "three" / "grid_reward", drawings.waiting, later, label="s")
    assert again.read_bytes() != png.read_bytes()


def _no_goal(episode):
    return replace(episode, start=replace(episode.start, map=replace(episode.start.map, things=())))


@pytest.mark.parametrize(
    "change",
    [
        lambda one: replace(one, poses=one.poses + 0.25),
        lambda one: replace(one, t_ns=one.t_ns**2),
        lambda one: replace(one, outcome="timeout"),
        lambda one: replace(one, start=replace(one.start, plan=planned(one.plan, episode=7))),
        lambda one: replace(one, start=replace(one.start, plan=planned(one.plan, block_name="Gitter"))),
        _no_goal,
    ],
    ids=["poses", "times", "outcome", "number", "block", "map"],
)
def test_paths_of_an_episode_that_differs_are_drawn(study, tmp_path, change):
    log = session(blocks=("grid",), episodes=2)
    first, *others = log.episodes
    changed = replace(log, episodes=(change(first), *others))
    keeping = KeptFigures(study)
    before, after = (
        keeping.save(tmp_path / name / "paths", drawings.paths, session_blocks(one))[0].read_bytes()
        for name, one in (("one", log), ("two", changed))
    )
    assert before != after


@pytest.mark.parametrize("part", ["code", "Matplotlib", "fonts"])
def test_what_draws_is_in_the_digest(tmp_path, monkeypatch, part):
    before = drawn_with.__wrapped__()
    assert before == drawn_with.__wrapped__()
    match part:
        case "code":
            package = shutil.copytree(Path(minihuman.__file__).parent, tmp_path / "minihuman")
            monkeypatch.setattr(minihuman, "__file__", str(package / "__init__.py"))
            assert drawn_with.__wrapped__() == before
            style = package / "figures" / "style.py"
            style.write_text(style.read_text().replace('"font.size": 7.0', '"font.size": 7.5'))
        case "Matplotlib":
            version = kept.version
            monkeypatch.setattr(kept, "version", lambda name: "9.9" if name == "matplotlib" else version(name))
        case "fonts":
            own = Path(kept.find_spec("matplotlib").origin).parent / "mpl-data"
            copied = shutil.copytree(own, tmp_path / "matplotlib" / "mpl-data")
            monkeypatch.setattr(
                kept, "find_spec", lambda _: type("Spec", (), {"submodule_search_locations": [str(copied.parent)]})
            )
            assert drawn_with.__wrapped__() == before
            os.truncate(copied / "fonts" / "ttf" / "DejaVuSans.ttf", 1000)
    assert drawn_with.__wrapped__() != before


def test_figures_that_other_code_drew_are_drawn_again(study, tmp_path, monkeypatch):
    first = drawn(study, tmp_path / "one")
    monkeypatch.setattr(kept, "drawn_with", lambda: "something else")
    (study / FIGURES / "grid_reward.png").write_bytes(b"what it drew")
    assert drawn(study, tmp_path / "two") == first


@pytest.mark.parametrize("became", ["changed", "cut short", "without its note", "a half-written note", "gone"])
@pytest.mark.parametrize("which", ["png", "pdf"])
def test_a_kept_file_that_was_harmed_is_not_believed(study, tmp_path, became, which):
    first = drawn(study, tmp_path / "one")
    file = study / FIGURES / f"grid_reward.{which}"
    note = file.with_name(f"{file.name}.json")
    match became:
        case "changed":
            changed = bytearray(file.read_bytes())
            changed[len(changed) // 2] ^= 1
            file.write_bytes(changed)
        case "cut short":
            os.truncate(file, 500)
        case "without its note":
            note.unlink()
        case "a half-written note":
            os.truncate(note, 40)
        case "gone":
            file.unlink()
    assert drawn(study, tmp_path / "two") == first


def test_where_nothing_can_be_kept_figures_are_drawn(study, tmp_path):
    (study / FIGURES).write_text("a file where the folder would be, as a folder that may not be written")
    first = drawn(study, tmp_path / "one")
    assert drawn(study, tmp_path / "two") == first
    assert drawn(tmp_path / "no study", tmp_path / "three") == first
    assert not (tmp_path / "no study").exists()


def test_figures_set_in_other_faces_are_not_kept(study, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "faces_are_matplotlibs", lambda: False)
    drawn(study, tmp_path / "one")
    assert not (study / FIGURES).exists()


def test_the_faces_are_those_that_the_digest_is_of():
    assert files.faces_are_matplotlibs()


def test_what_a_digest_cannot_see_into_is_refused_rather_than_kept(study, tmp_path):
    with pytest.raises(TypeError, match="no digest can see into"):
        KeptFigures(study).save(tmp_path / "x", drawings.waiting, {"a": object()}, label="s")
