"""Whatever is changed in a log is noticed: by its chain always, and nearly always by what else is in it."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from minihuman.admin.verify.episodes import verify_episodes
from minihuman.admin.verify.log import MAX_DIFFERENCES, find_log_differences, verify_session
from minihuman.cli.command_line import make_command_line
from minihuman.errors import MinihumanError
from minihuman.log.paths import raise_as_log_error
from minihuman.log.read.session_reader import read_log
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner
from minihuman.log.topics import BY_NAME, EPISODE_START
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.promises.sessions import play, study
from tests.promises.tampering import Change, Record, messages_changed, moved, others_changed, rewritten

pytestmark = pytest.mark.program

INPUTS = {  # what a person or device did is in no other place of a log; docs/promises.md says so
    "/input/key symbol",
    "attachment packages.txt",
    "metadata minihuman.segment minihuman",
    "metadata minihuman.end late_writes",
    "metadata minihuman.end longest_wait_ms",
    "metadata minihuman.end and one more",
    "/page submit_ns",
    "/page flip_ns",
    "/map/image data",  # a byte behind the picture, which shows the same
}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    more = "record_observations = true\n"
    return play(tmp_path_factory.mktemp("data"), study(episodes=3, steps=12, more=more), sync=lambda _fd: None)


@pytest.fixture(scope="module")
def changes(log: Path) -> list[tuple[str, Change]]:
    records = list(LogScanner(log))
    seen = dict.fromkeys(record.channel.topic for record in records if isinstance(record, LogMessage))
    found = [change for topic in seen for kind in (messages_changed, moved) for change in kind(records, topic)]
    return found + list(others_changed(records))


def test_a_log_that_is_written_anew_as_it_was_is_proven(log: Path, tmp_path: Path) -> None:
    for chained in (False, True):
        same = rewritten(log, tmp_path / log.name, lambda _: None, chained=chained)
        assert _said(same) == []


def test_a_log_is_proven_while_it_is_live(tmp_path: Path) -> None:
    """Nothing is repeated for viewers in it yet, and nobody misses that."""
    data, copy = tmp_path / "data", tmp_path / "copy"

    def keep(_fd: int) -> None:
        for part in data.rglob("*.mcap.part"):
            copy.mkdir(exist_ok=True)
            shutil.copy(part, copy / part.name)

    play(data, study(episodes=2, steps=12), sync=keep)
    (part,) = copy.iterdir()
    assert _said(part) == []


@pytest.mark.nightly(sample=True)
def test_whatever_is_changed_is_noticed_by_the_chain(
    log: Path, changes: list[tuple[str, Change]], tmp_path: Path
) -> None:
    unnoticed = [name for name, change in _some(changes) if not _said(_changed(log, change, tmp_path, chained=False))]
    assert unnoticed == []


@pytest.mark.nightly(sample=True)
def test_whatever_is_changed_is_noticed_without_the_chain_but_for_some_inputs(
    log: Path, changes: list[tuple[str, Change]], tmp_path: Path
) -> None:
    some = [(name, change) for name, change in _some(changes) if name != "metadata minihuman.end chain"]  # made anew
    unnoticed = {name for name, change in some if not _said(_changed(log, change, tmp_path, chained=True))}
    assert unnoticed <= INPUTS


@pytest.mark.nightly(sample=True)
def test_a_changed_log_has_the_sentences_that_replaying_every_part_of_it_on_its_own_gives(
    log: Path, changes: list[tuple[str, Change]], tmp_path: Path
) -> None:
    for place, (name, change) in enumerate(_some(changes)):
        changed = _changed(log, change, tmp_path, chained=place % 2 == 0)
        assert _said(changed) == _say_part_by_part(changed), name


def _say_part_by_part(log: Path) -> list[str]:
    """Replay a log's episodes, and then the session, each with worlds of its own."""
    try:
        session = read_log(log)
        with raise_as_log_error(log, "played again"):
            steps = verify_episodes(session, World)
        with raise_as_log_error(log, "proven"):
            differences = list(find_log_differences(log, World))
    except MinihumanError as error:
        return [str(error)]
    more = [f"and {len(differences) - MAX_DIFFERENCES} more"] if len(differences) > MAX_DIFFERENCES else []
    return [*([steps.difference] if steps.difference else []), *differences[:MAX_DIFFERENCES], *more]


def _some(changes: list[tuple[str, Change]]) -> list[tuple[str, Change]]:
    rng = np.random.default_rng(1)
    chosen = rng.permutation(len(changes))[: count(40, len(changes))]
    return [changes[place] for place in sorted(chosen)]


def _changed(log: Path, change: Change, folder: Path, *, chained: bool) -> Path:
    return rewritten(log, folder / log.name, change, chained=chained)


def _said(log: Path) -> list[str]:
    try:
        return [line for line, fine in verify_session(log) if not fine]
    except MinihumanError as error:
        return [str(error)]


@pytest.mark.nightly(by_day=["bounds1"])
@pytest.mark.parametrize(
    "bounds", [(5.0, 0.0, 1.0, 9.0), (0.0, float("nan"), 9.0, 9.0), (0.0, 0.0, float("inf"), 9.0), (0.0, 0.0, 1e9, 1e9)]
)
def test_a_log_whose_map_bounds_were_changed_with_right_checksums_makes_no_command_raise(
    log: Path, tmp_path: Path, bounds: tuple[float, ...]
) -> None:
    def change(records: list[Record]) -> None:
        for place, record in enumerate(records):
            if isinstance(record, LogMessage) and record.channel.topic == EPISODE_START:
                message = BY_NAME[EPISODE_START].message.FromString(record.data)
                box = message.map.bounds
                box.x0, box.z0, box.x1, box.z1 = bounds
                records[place] = record._replace(data=message.SerializeToString(deterministic=True))

    folder = Path(shutil.copytree(log.parents[2], tmp_path / "tried"))
    changed = folder / log.relative_to(log.parents[2])
    rewritten(log, changed, change, chained=True)
    assert list(read_log(changed).episodes[0].start.map.bounds) == pytest.approx(bounds, nan_ok=True)
    for command in ("plot", "report"):
        ran = CliRunner().invoke(make_command_line(), [command, str(folder), "--out", str(tmp_path / command)])
        assert ran.exception is None or isinstance(ran.exception, MinihumanError | SystemExit), ran.exception
        is_refused = isinstance(ran.exception, MinihumanError) and "a map's bounds" in str(ran.exception)
        assert is_refused or bounds[2] == 1e9, "a map so large is drawn, as a path is"
