"""Every exporter of ours keeps what exporters promise; what a lab may get wrong is named."""

from pathlib import Path

import pytest

from minihuman.exporters.exporter import ExportResult, list_exporters
from minihuman.testing.checks import ContractError
from minihuman.testing.exporter_contract import check_exporter

pytestmark = pytest.mark.program


OF_TEAMS = {"pettingzoo", "overcooked"}  # of what several bodies played: tests/activities/team exports with them


@pytest.mark.parametrize("name", sorted(set(list_exporters()) - OF_TEAMS))
def test_every_exporter_keeps_what_exporters_promise(name):
    check_exporter(name)


def lengths(selection, out):
    """One line an episode: how many steps it took; each of the wrong ones changes one thing."""
    steps = [len(item.episode.actions) for item in selection]
    (out / "lengths.txt").write_text("\n".join(map(str, steps)))
    return ExportResult((out / "lengths.txt",), episodes=len(steps), steps=sum(steps))


def elsewhere(selection, out):
    return ExportResult((Path(__file__),), lengths(selection, out).episodes, 0)


def miscounting(selection, out):
    written = lengths(selection, out)
    return ExportResult(written.paths, written.episodes + 1, written.steps)


def silent(selection, out):
    lengths(selection, out)


def beside(selection, out):
    (out.parent / "notes.txt").write_text("beside")
    return lengths(selection, out)


def meddling(selection, out):
    items = list(selection)
    items[0].log.path.write_bytes(b"")
    return lengths(items, out)


def test_a_labs_exporter_keeps_them():
    check_exporter(lengths)


@pytest.mark.parametrize(
    ("exporter", "said"),
    [
        (elsewhere, "outside the folder it was given"),
        (miscounting, "4 episodes count, and it says that it wrote 5"),
        (silent, "gave a NoneType, not an ExportResult"),
        (beside, r"wrote beside its folder: notes\.txt"),
        (meddling, "changed what is beside the logs"),
    ],
)
def test_a_promise_that_is_not_kept_is_named(exporter, said):
    with pytest.raises(ContractError, match=said):
        check_exporter(exporter)
