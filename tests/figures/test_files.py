"""Figures as files."""

from minihuman.figures.files import save
from minihuman.figures.overview import overview_figure
from tests.builders import session


def test_the_same_data_give_the_same_files(tmp_path):
    first = save(overview_figure(session(episodes=2)), tmp_path / "a" / "overview")
    again = save(overview_figure(session(episodes=2)), tmp_path / "b" / "overview")
    assert [path.name for path in first] == ["overview.png", "overview.pdf"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]


def test_files_hold_no_date_and_no_program_version(tmp_path):
    png, pdf = save(overview_figure(session(episodes=1)), tmp_path / "overview")
    for word in (b"CreationDate", b"Matplotlib", b"matplotlib"):
        assert word not in pdf.read_bytes()
        assert word not in png.read_bytes()
