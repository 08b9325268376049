"""What a store, a database, a log or a participant calls a file or a person is never a path of its own choosing."""

import ast
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from minihuman.admin import remote_logs
from minihuman.admin.log_info import RecoveryResult, recover_logs
from minihuman.admin.remote_logs import sync_logs
from minihuman.admin.status import format_status
from minihuman.dataset.log_files import list_readable_logs
from minihuman.dataset.selection import Selection
from minihuman.dataset.table_catalogue import TablePartition
from minihuman.errors import LogError, MinihumanError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.exporters.exporter import export_study
from minihuman.log import topics
from minihuman.log.paths import session_folder
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.session_leases import SessionLeases
from minihuman.log.salvage.records import LogMessage
from minihuman.runtime.simulated_session import simulate
from minihuman.storage.outside_names import OutsideNameError, StudyFile
from minihuman.web.arrivals import identify_visitor, is_token
from tests.borders.memory_store import MemoryStore
from tests.builders import session, write_log
from tests.counts import count
from tests.lab.lease_table import Clock, MemoryLeaseTable
from tests.promises.tampering import Record, at, rewritten
from tests.web.protocols import study

PACKAGE = Path(remote_logs.__file__).parents[1]
NAMES = count(60, 500)
HOSTILE_PARTS = (
    "..", ".", "", "...", " ", "a b", "C:", "C:\\x", "\\\\host\\share", "/etc", "\0", "a\0b", "\n", "a\nb", "\x1b[2J",
    "con", "CON", "nul.mcap", "LPT1", "sub-01.", "sub-01 ", "~", "~root", "$HOME", "%2e%2e", "..%2f", "\u202egnp",
    "é", "sub\u200b-01", "-rf", ".hidden", "._sub-01_ses-01.mcap", "*", "?", "<a>", "x" * 4096, "a" * 201, "|", '"',
)  # fmt: skip
ENDINGS = (".mcap", ".marks.jsonl", ".parquet", ".mcap.part", "")


def draw_part(rng: random.Random) -> str:
    """Draw a part of a name: a good one, a hostile one, or random characters."""
    kind = rng.random()
    if kind < 0.3:
        return rng.choice(("tried", "other", "sub-01", "sub-02", "ses-01", "ses-99", "sub-01_ses-01.mcap"))
    if kind < 0.85:
        return rng.choice(HOSTILE_PARTS)
    return "".join(chr(rng.choice((rng.randrange(1, 128), rng.randrange(0x2000)))) for _ in range(rng.randint(1, 9)))


def draw_name(rng: random.Random) -> str:
    """Draw a whole name of one to eight parts, most often below the study's prefix."""
    parts = [draw_part(rng) for _ in range(rng.randint(1, 8))]
    prefix = rng.choice(("tried/", "tried/", "tried/sub-01/", "tried/sub-01/ses-01/", "/", ""))
    return prefix + rng.choice(("/", "//", "\\", "/../")).join(parts) + rng.choice(ENDINGS)


def files_below(folder: Path) -> set[str]:
    """The paths of all files below a folder."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A whole log of a study called tried."""
    [path] = simulate(
        decode_protocol(study(tmp_path, max_steps=4).read_bytes()), tmp_path / "elsewhere", participants=1, seed=1,
        player="random",
    )  # fmt: skip
    return path


@pytest.mark.nightly(sample=True)
def test_no_name_of_a_store_becomes_a_path_outside_a_session_and_each_is_said(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = random.Random(7)
    store = MemoryStore()
    names = {draw_name(rng) for _ in range(NAMES)}
    store.files = {name: log.read_bytes() for name in names} | {
        "tried/sub-01/ses-01/sub-01_ses-01.mcap": log.read_bytes()
    }
    monkeypatch.setattr(remote_logs, "open_remote_store", lambda data, **settings: store)
    data = tmp_path / "a" / "b" / "c" / "data"
    data.mkdir(parents=True)
    before = files_below(tmp_path)
    lines: list[str] = []
    assert sync_logs(data, "tried/", say=lines.append) == (1, 0)
    place = data.relative_to(tmp_path) / "tried/sub-01/ses-01/sub-01_ses-01.mcap"
    assert files_below(tmp_path) - before == {place.as_posix()}
    listed = [name for name in names if name.startswith("tried/")]
    assert len(lines) == len(listed)
    assert all(line.isprintable() and len(line) < 400 for line in lines)


def test_a_name_has_a_place_only_if_it_has_the_form_of_one(tmp_path: Path) -> None:
    rng = random.Random(11)
    for name in (draw_name(rng) for _ in range(NAMES)):
        try:
            file = StudyFile.parse(name)
        except OutsideNameError:
            continue
        assert file.name == name
        assert file.path(tmp_path).resolve().relative_to(tmp_path).parts == tuple(name.split("/"))
    file = StudyFile.parse("tried/sub-01/ses-01/sub-01_ses-01.mcap")
    assert file.path(tmp_path) == tmp_path / "tried" / "sub-01" / "ses-01" / "sub-01_ses-01.mcap"


def test_a_log_of_another_session_is_not_taken_for_the_one_that_its_name_says(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = MemoryStore()
    store.files = {"tried/sub-02/ses-01/sub-02_ses-01.mcap": log.read_bytes()}
    monkeypatch.setattr(remote_logs, "open_remote_store", lambda data, **settings: store)
    lines: list[str] = []
    assert sync_logs(tmp_path / "data", "tried/", say=lines.append) == (0, 0)
    assert lines == [
        "tried/sub-02/ses-01/sub-02_ses-01.mcap in the remote store is refused: it is the log of another session"
    ]
    assert not list((tmp_path / "data").rglob("*.mcap"))


@pytest.mark.parametrize("where", ["cut", "middle", "empty"])
def test_a_damaged_log_of_a_store_is_said_and_not_fetched_and_whoever_has_it_whole_stores_it_again(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    whole = log.read_bytes()
    middle = len(whole) // 2
    damaged = {"cut": whole[:middle], "middle": whole[:middle] + bytes(9) + whole[middle + 9 :], "empty": b""}[where]
    name = "tried/sub-01/ses-01/sub-01_ses-01.mcap"
    store = MemoryStore()
    store.files[name] = damaged
    monkeypatch.setattr(remote_logs, "open_remote_store", lambda data, **settings: store)
    lines: list[str] = []
    assert sync_logs(tmp_path / "data", "tried/", say=lines.append) == (0, 0)
    assert [name in line and "damaged" in line for line in lines] == [True]
    assert sync_logs(log.parents[3], "tried/", say=lines.append) == (0, 1)
    assert store.files[name] == whole
    assert sync_logs(tmp_path / "data", "tried/", say=lines.append) == (1, 0)
    assert len(lines) == 1


def test_a_whole_log_of_a_store_takes_the_place_of_a_damaged_one_here(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = log.read_bytes()
    store = MemoryStore()
    store.files["tried/sub-01/ses-01/sub-01_ses-01.mcap"] = whole
    monkeypatch.setattr(remote_logs, "open_remote_store", lambda data, **settings: store)
    middle = len(whole) // 2
    log.write_bytes(whole[:middle] + bytes(9) + whole[middle + 9 :])  # its summary is as it was
    assert sync_logs(log.parents[3], "tried/") == (1, 0)
    assert log.read_bytes() == whole
    assert store.files["tried/sub-01/ses-01/sub-01_ses-01.mcap"] == whole


@pytest.mark.nightly(sample=True)
def test_no_file_of_a_database_is_restored_outside_its_session(tmp_path: Path) -> None:
    rng = random.Random(3)
    folder = tmp_path / "data" / "tried" / "sub-01" / "ses-01"
    folder.mkdir(parents=True)
    refusals: list[str] = []
    for name in (draw_name(rng) for _ in range(count(40, 500))):
        table = MemoryLeaseTable(Clock())
        leases = SessionLeases(table)
        lease = leases.acquire("tried/sub-01/ses-01")
        table.store("tried/sub-01/ses-01", lease.grant.fence, {name: b"content"})
        leases.release(lease)
        try:
            leases.restore(SessionLeases(table).acquire("tried/sub-01/ses-01"), folder)
        except OutsideNameError as error:
            refusals.append(str(error))
    assert {path for path in tmp_path.rglob("*") if path.is_file() and path.parent != folder} == set()
    assert refusals
    assert all(map(str.isprintable, refusals))


@pytest.mark.nightly(sample=True)
def test_a_log_that_names_its_study_or_participant_like_a_path_is_refused_by_every_output(tmp_path: Path) -> None:
    log = write_log(session(blocks=("grid",), episodes=1), tmp_path / "real")
    rng = random.Random(5)
    data = tmp_path / "x" / "data"
    folder = data / "study" / "sub-01" / "ses-01"
    folder.mkdir(parents=True)
    for number in range(count(4, 60)):
        field = ("study", "participant")[number % 2]
        hostile = rng.choice([part for part in HOSTILE_PARTS if part.isprintable()]) or ".."

        def rename(records: list[Record], field: str = field, hostile: str = hostile) -> None:
            place = at(records, topics.PLAN)
            message = records[place]
            assert isinstance(message, LogMessage)
            plan = v1.SessionPlan.FromString(message.data)
            if field == "study":
                plan.study = hostile
            else:
                plan.participant.id = hostile
            records[place] = LogMessage(
                message.channel, message.sequence, message.log_time, message.publish_time, plan.SerializeToString()
            )

        changed = rewritten(log, folder / "sub-01_ses-01.mcap", rename, chained=True)
        with pytest.raises(LogError, match="cannot be a file's name"):
            read_log(changed)
        for name in ("csv", "bids"):
            with pytest.raises(MinihumanError):
                export_study(name, data / "study", tmp_path / "out", Selection())
    assert {path.parts[len(tmp_path.parts)] for path in tmp_path.rglob("*")} == {"real", "x"}


@pytest.mark.parametrize("part", [part for part in HOSTILE_PARTS if part != ".hidden"])
def test_no_code_of_a_database_and_no_id_of_a_participant_is_a_folder_elsewhere(tmp_path: Path, part: str) -> None:
    for study_name, code in ((part, "sub-01"), ("tried", part)):
        with pytest.raises(OutsideNameError, match="cannot be a file's name"):
            session_folder(tmp_path, study_name, code, 1)
    visitor = identify_visitor({"PROLIFIC_PID": part}, ("prolific",))
    assert visitor is None or "/" not in visitor.id
    assert not is_token(part)
    assert TablePartition.parse(f"steps/study={part}/participant={part}/ses-01-{'0' * 16}.parquet") is None


def test_companions_of_other_systems_are_named_and_skipped_by_every_command(log: Path) -> None:
    study_dir = log.parents[2]
    for name in (f"._{log.name}", f"._{log.name}.part", "._sub-01_ses-01.marks.jsonl"):
        (log.parent / name).write_bytes(b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X")
    logs, skipped = list_readable_logs(study_dir)
    assert logs == [log]
    assert [line.path.name[:2] for line in skipped] == ["._"] * 3
    assert sum("._" in line for line in format_status(study_dir)) == 3
    recovered = list(recover_logs([study_dir]))
    assert all(isinstance(line, RecoveryResult) and "skipped" in line.line for line in recovered)
    assert len(recovered) == 3
    assert read_log(log.parent).plan.participant.id == "sub-01"


# modules that hear names from outside, and the only expressions that they may join to a path, each with its reason
HEARS = (
    "storage.remote_store",
    "storage.lease",
    "log.record.session_leases",
    "admin.recruitment",
    "zipfile",
    "tarfile",
)
JOINED = {
    ("admin/remote_logs.py", "_make_alternative_name(log)"): "of a local log and a digest",
    ("admin/local_copies.py", "code"): "read by form, as a participant's code",
    ("admin/withdrawal.py", "code"): "parsed as a participant's code first",
    ("admin/withdrawal.py", "f'.{mark.name}'"): "of a file of ours",
    ("admin/withdrawal.py", "archive.name + UNFINISHED_SUFFIX"): "as the user named it",
    ("learn/policy/file.py", "path.name + UNFINISHED_SUFFIX"): "as the user named it",
    ("log/record/session_leases.py", "name"): "checked by require_name",
    ("log/record/session_leases.py", "f'.{name}.restored'"): "checked by require_name",
    ("web/arrivals.py", "protocol.study.name"): "of the protocol",
    ("web/arrivals.py", "admission.participant"): "asks only whether it exists",
    ("admin/remote_logs.py", "study"): "parsed by outside_names",
    ("admin/status.py", "name"): "listed from the folder itself",
    ("runtime/watch/dashboard.py", "file_name or 'page.html'"): "one of a fixed table",
    ("runtime/watch/dashboard.py", "code"): "asks only whether it exists",
    ("web/deployment/check.py", "f'server-{number}'"): "a number",
    ("web/deployment/check.py", "f'{name}.toml'"): "of the protocol",
    ("web/deployment/check.py", "file_name"): "a constant",
    ("web/deployment/check.py", "name"): "of the protocol",
    ("web/server/process.py", "protocol.study.name"): "of the protocol",
    ("worlds/grid/ruleset/tasks.py", "f'{name}.npz'"): "of a set of the package",
}


def find_joins(source: str) -> Iterator[str]:
    """Yield what a module's source joins to a path, but for constants."""
    for node in ast.walk(ast.parse(source)):
        joined: list[ast.expr] = []
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            joined = [node.right]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in ("joinpath", "with_name", "relative_to"):
                joined = list(node.args) if node.func.attr != "relative_to" else []
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("Path", "open"):
            joined = node.args[1:] if node.func.id == "Path" else []
        for expression in joined:
            is_number = isinstance(expression, ast.Constant) or (
                isinstance(node, ast.BinOp) and isinstance(expression, ast.BinOp)
            )
            if not is_number and not (isinstance(expression, ast.Name) and expression.id.isupper()):
                yield ast.unparse(expression)


def hears_from_outside(source: str) -> bool:
    """Say whether a module imports what a store, a database, an archive or a participant speaks through."""
    modules = {
        name
        for node in ast.walk(ast.parse(source))
        for name in (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else []
        )
    }
    return any(name.removeprefix("minihuman.") in HEARS for name in modules)


def test_no_module_but_one_joins_a_name_from_outside_to_a_path() -> None:
    joins: set[tuple[str, str]] = set()
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if hears_from_outside(source):
            joins |= {(path.relative_to(PACKAGE).as_posix(), joined) for joined in find_joins(source)}
    assert joins - JOINED.keys() == set(), "pass the name through minihuman.storage.outside_names"
    assert JOINED.keys() - joins == set(), "these joins are gone; remove them here"


@pytest.mark.parametrize("planted", ["data / name", "data.joinpath(name)", "Path(data, name)", "log.with_name(name)"])
def test_a_name_joined_to_a_path_would_be_found(planted: str) -> None:
    source = f"from minihuman.storage.remote_store import RemoteStore\nfor name in store.names(''):\n    {planted}\n"
    assert hears_from_outside(source)
    assert list(find_joins(source)) == ["name"]
