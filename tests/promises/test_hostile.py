"""Bad input is one sentence: no traceback, whatever a protocol, a log, a world's id or an argument says."""

import os
import random
import shutil
import stat
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode

from minihuman.admin.log_info import format_session_json, format_session_lines
from minihuman.admin.protocol_file import find_shipped_protocol
from minihuman.admin.session_index import read_session_index, summarize_session
from minihuman.admin.status import format_status
from minihuman.admin.verify.log import verify_session
from minihuman.cli import main
from minihuman.cli.command_line import make_command_line
from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.tables import select
from minihuman.errors import LogError, MinihumanError, ProtocolError, WorldError
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.exporters.exporter import export_study
from minihuman.figures.gallery import draw_all_figures
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import recover_log, repair_log
from minihuman.log.salvage.records import MAX_RECORD_BYTES
from minihuman.log.salvage.scan import LogScanner
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import GRID_WORLDS
from tests.counts import count
from tests.promises.hostile_protocols import mutated
from tests.promises.sessions import TOML, play, study
from tests.promises.tampering import Record, messages_changed, moved, others_changed, rewritten
from tests.report.reports import write_report


@pytest.mark.nightly(sample=True)
def test_any_protocol_is_read_or_refused_in_one_line() -> None:
    rng = random.Random(1)
    texts = [find_shipped_protocol("demo").read_text(), TOML.format(episodes=3, steps=20)]
    read = refused = 0
    for _ in range(count(150, 10_000)):
        toml = mutated(rng.choice(texts), rng)
        try:
            protocol = decode_protocol(toml, "p.toml")
            expand_protocol(protocol, enrol_participant(protocol, 0))
            read += 1
        except MinihumanError:
            refused += 1
    assert read > 0
    assert refused > 0


@pytest.mark.nightly(sample=True)
def test_any_log_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    assert _refused(_READERS, tmp_path, count(200, 20_000)) > 0


@pytest.mark.nightly(sample=True)
def test_any_log_in_a_study_is_counted_written_and_drawn_or_left_out_in_one_line(tmp_path: Path) -> None:
    assert _refused(_CONSUMERS, tmp_path, count(16, 3_000)) > 0


def _refused(operations: Sequence[Callable[[Path], object]], tmp_path: Path, most: int) -> int:
    """Do something with changed logs so many times; how often it was refused. Anything else that is raised stays so."""
    log = play(tmp_path / "data", study(episodes=2, steps=8, more="record_observations = true\n"), sync=lambda _: None)
    records: list[Record] = list(LogScanner(log))
    topics = dict.fromkeys(record.channel.topic for record in records if hasattr(record, "channel"))
    changes = [change for topic in topics for _, change in (*messages_changed(records, topic), *moved(records, topic))]
    changes += [change for _, change in others_changed(records)]
    rng = random.Random(2)
    refused = done = 0
    folder = tmp_path / "changed" / "promised" / "sub-01" / "ses-01"
    folder.mkdir(parents=True)
    target = folder / log.name
    while done < most:
        some = rng.sample(changes, rng.randint(1, 4))
        try:
            rewritten(log, target, lambda found, some=some: [change(found) for change in some], chained=True)
        except (StopIteration, IndexError, AttributeError):
            continue  # what one change took away is missing to another
        for operation in operations:
            done += 1
            try:
                operation(target)
            except MinihumanError:
                refused += 1
        for left in (*folder.iterdir(), *folder.parents[1].glob("*.*")):
            shutil.rmtree(left) if left.is_dir() else left.unlink()
    print(f"\n{done} reads, {refused} of them refused")
    return refused


def _recovered(log: Path) -> None:
    part = log.with_name(f"{log.name}.part")
    part.write_bytes(log.read_bytes())
    log.unlink()
    recover_log(part)


def _written(log: Path, format_name: str, *, stored_frames: bool = False) -> None:
    with TemporaryDirectory() as out:
        export_study(format_name, log.parents[2], Path(out), Selection(), stored_frames=stored_frames)


def _asked(log: Path) -> None:
    with StudyStore(StudySessions(log.parents[2]), with_shortest=True) as store:
        store.tables.query("SELECT * FROM episodes")


def _reported(log: Path) -> None:
    with TemporaryDirectory() as out:
        list(write_report(select(log.parents[2]), Path(out)))


def _drawn(log: Path) -> None:
    with TemporaryDirectory() as out:
        list(draw_all_figures(select(log.parents[2]), Path(out)))


_CONSUMERS: tuple[Callable[[Path], object], ...] = (
    lambda log: _written(log, "csv"),
    lambda log: _written(log, "bids"),
    lambda log: _written(log, "imitation"),
    lambda log: _written(log, "imitation", stored_frames=True),
    _asked,
    _reported,
    _drawn,
)
_READERS: tuple[Callable[[Path], object], ...] = (
    read_log,
    lambda log: format_session_lines(read_log(log)),
    lambda log: format_session_json(read_log(log)),
    lambda log: list(read_events(log)),
    lambda log: list(verify_session(log)),
    lambda log: summarize_session([log]),
    lambda log: list(format_status(log.parents[2])),
    lambda log: [episode.frames.column("flip_ns") for episode in read_log(log).episodes],
    repair_log,
    _recovered,
)


@pytest.mark.nightly(sample=True)
def test_any_world_is_made_or_refused_in_one_line() -> None:
    rng = random.Random(3)
    ids = [*(entry.id for entry in GRID_WORLDS[:20]), "minigrid:MiniGrid-Empty-5x5-v0", "CartPole-v1", "FrozenLake-v1"]
    odd = [":", "json:json:json", "", "os:system", "minihuman/", "x" * 5000, "\0", "a/b/c-v0", "..", "this-v0", "-v-1"]
    options = [
        {},
        {"size": -1},
        {"size": 3},
        {"max_steps": float("inf")},
        {"max_steps": -1},
        {"map_name": "x"},
        {"x": 1},
    ]
    options += [
        {"obs_height": 10**12},
        {"size": 10**9},
        {"render_mode": "human"},
        {"width": "a"},
        {"agent_view_size": 2},
    ]
    for _ in range(count(40, 1_000)):
        world_id = rng.choice([*ids, *odd]) if rng.random() < 0.7 else "".join(rng.choices("abc:/-v0123.", k=8))
        try:
            world = World(world_id, rng.choice(options))
        except WorldError:
            continue
        world.close()


@pytest.mark.nightly(sample=True)
def test_any_arguments_are_understood_or_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(4)
    monkeypatch.chdir(tmp_path)
    log = play(tmp_path, study(episodes=1, steps=5), sync=lambda _: None)
    (tmp_path / "notes.mcap").write_text("dear diary")
    (tmp_path / "bad.toml").write_text("x = [")
    (tmp_path / "good.toml").write_text(TOML.format(episodes=1, steps=5))
    (tmp_path / "folder").mkdir()
    values = [
        "notes.mcap", "bad.toml", "good.toml", "folder", "promised", str(log), "nothing", "/dev/null", "", "x", "-1",
        "\x1b[31m", "é", "csv", "sub-00", "sub-01", "0", "1", "99999999999", "select * from episodes", "{}", "1e400",
    ]  # fmt: skip
    options = ["--json", "--seal", "--participant", "--group", "--out", "--session", "--trust"]
    command_line = make_command_line()
    commands = {name: command_line.get_command(click.Context(command_line), name) for name in _LINES}
    codes = Counter[int]()
    for done in range(count(30, 1_000)):
        name = rng.choice(_LINES)
        if rng.random() < 0.5:
            line = [name, *rng.choices([*values, *options], k=rng.randint(0, 4))]
        else:
            line = [name, *_fitting(commands[name], values, rng)]
        monkeypatch.setattr("sys.argv", ["minihuman", *line])
        try:
            main()
            code = 0
        except SystemExit as ended:
            code = ended.code
        said = capsys.readouterr()
        assert code in (0, 1, 2, None), (line, code)
        assert "Traceback" not in said.err + said.out, line
        assert "\x1b[31m" not in said.err + said.out, line
        codes[code or 0] += 1
        if done % 50 == 49:
            with capsys.disabled():
                print(f"{done + 1} argument lines, by exit code: {dict(codes)}", flush=True)


_LINES = (  # all that neither opens a window nor serves until it is stopped
    "new", "schema", "simulate", "check", "status", "worlds", "plugins", "info", "verify", "recover", "manifest",
    "plot", "annotate", "report", "query", "withdraw", "replace", "payments", "gather", "export",
)  # fmt: skip


def _fitting(command: click.Command, values: Sequence[str], rng: random.Random) -> list[str]:
    """A line of a command's own arguments, most of them there, and some of its options."""
    words = []
    for parameter in command.params:
        if isinstance(parameter, click.Argument):
            words += [rng.choice(values)] if rng.random() < 0.95 else []
        elif isinstance(parameter, click.Option) and rng.random() < 0.15:
            words += [parameter.opts[0], *([] if parameter.is_flag else [rng.choice(values)])]
    return words


def test_a_pipe_that_is_named_like_a_log_holds_nobody_up(tmp_path: Path) -> None:
    pipe = tmp_path / "sub-01_ses-01.mcap"
    os.mkfifo(pipe)
    with pytest.raises(LogError, match="is not a regular file"):
        read_log(pipe)
    (row,) = read_session_index(tmp_path)
    assert "is not a regular file" in row.problem
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("says", [100, 8 << 30])
def test_a_chunk_that_unpacks_to_gigabytes_is_refused_before_it_does(tmp_path: Path, says: int) -> None:
    import resource

    bomb = zstandard.ZstdCompressor(level=1).compressobj()
    block, packed = bytes(1 << 20), b""
    for _ in range(256):
        packed += bomb.compress(block)
    packed += bomb.flush()
    chunk = (
        b"".join((bytes(16), says.to_bytes(8, "little"), bytes(4), (4).to_bytes(4, "little"), b"zstd"))
        + len(packed).to_bytes(8, "little")
        + packed
    )
    content = b"\x89MCAP0\r\n" + bytes([Opcode.CHUNK]) + len(chunk).to_bytes(8, "little") + chunk
    log = tmp_path / "sub-01_ses-01.mcap"
    log.write_bytes(content)
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LogError, match="damaged"):
        read_log(log)
    grown_bytes = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib) * 1024
    assert grown_bytes < 2 * MAX_RECORD_BYTES
    assert zlib.crc32(log.read_bytes()) == zlib.crc32(content)


@pytest.mark.nightly(sample=True)
def test_a_cache_that_is_garbage_costs_a_reading_and_nothing_else(tmp_path: Path) -> None:
    log = play(tmp_path, study(episodes=1), sync=lambda _: None)
    folder = log.parents[2]
    expected = list(read_session_index(folder))
    whole = (folder / TABLE_CACHE).read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(count(10, 50)):
        spoilt = bytearray(whole)
        for at in rng.integers(len(whole), size=int(rng.integers(1, 40))):
            spoilt[at] = int(rng.integers(256))
        (folder / TABLE_CACHE).write_bytes(spoilt[: int(rng.integers(len(spoilt)))] if rng.random() < 0.3 else spoilt)
        found = list(read_session_index(folder))
        assert [row.path for row in found] == [row.path for row in expected]
        (folder / TABLE_CACHE).unlink()


def test_control_characters_of_a_protocol_do_not_reach_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    protocol = tmp_path / "p.toml"
    protocol.write_text(TOML.format(episodes=1, steps=5).replace('version = "1"', 'version = "\\u001b[31m"'))
    monkeypatch.setattr("sys.argv", ["minihuman", "check", str(protocol)])
    with pytest.raises(SystemExit):
        main()
    assert "\x1b" not in "".join(capsys.readouterr())


def test_a_placeholder_that_asks_for_a_text_of_any_size_is_refused() -> None:
    for bad in ("{steps:>99999999999}", "{steps[0]}", "{outcome.upper}", "{steps!r}"):
        with pytest.raises(ProtocolError, match="placeholder"):
            decode_protocol(TOML.format(episodes=1, steps=5).replace("{outcome}", bad).encode())
