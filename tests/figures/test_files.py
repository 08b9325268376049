"""Figures as files."""

from minihuman.figures.path_figures import paths_figure
from minihuman.figures.style import save_figure
from tests.builders import session


def draw(stem):
    return save_figure(paths_figure([("grid", session(blocks=("grid",), episodes=1).episodes)], across=1), stem)


def test_the_same_data_give_the_same_files_with_no_date_and_no_program_version(tmp_path):
    first, again = draw(tmp_path / "a" / "paths"), draw(tmp_path / "b" / "paths")
    assert [path.name for path in first] == ["paths.png", "paths.pdf"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
    for word in (b"CreationDate", b"Matplotlib", b"matplotlib"):
        assert not any(word in path.read_bytes() for path in first)
