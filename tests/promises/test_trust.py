"""Only trusted code runs: nothing of a stranger's folder, nothing that a log names; a trusted study runs everywhere."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import MinihumanError, ProtocolError, WorldError
from minihuman.log.read.session_reader import read_log
from minihuman.trust import Trust, find_config_folder
from minihuman.worlds.adapters.world import World
from tests.counts import count

WATCHED = """
import logging, sys
from pathlib import Path
from minihuman.admin.verify.log import verify_session
from minihuman.log.read.session_reader import read_events
from minihuman.runtime.watch.running_sessions import LiveSession, ScreenPreview

logging.basicConfig(level="DEBUG")
log, module = map(Path, sys.argv[1:])
preview, live = ScreenPreview(), LiveSession()
for event in read_events(log):
    live.take(event)
print("a picture" if preview.png(live).startswith(b"\\x89PNG") else "no picture")
module.write_text("COUNT = 5\\n")
for text, _ in verify_session(log):
    print(text)
"""
TRAP = "import pathlib; pathlib.Path(__file__).with_name(f'ran-{__name__}').touch(); raise SystemExit(3)\n"
PROTOCOL = """
[study]
name = "own"
version = "1.0"
seed = 1
participants = 4
[keys]
pool = ["1", "2", "3", "4", "5"]
[[groups]]
name = "all"
blocks = ["light", "dark"]
[[blocks]]
name = "light"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 10
[[blocks]]
name = "dark"
world = "WORLD"
episodes = 1
actions = ["back", "forward"]
max_steps = 20
"""


@pytest.fixture
def trapped(tmp_path: Path) -> Path:
    """A folder with files that are named as libraries are."""
    for name in ("rerun", "msgspec", "numpy", "minihuman", "json"):
        (tmp_path / f"{name}.py").write_text(TRAP)
    return tmp_path


@pytest.fixture
def configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a user's configuration who trusts nothing yet."""
    monkeypatch.setenv("MINIHUMAN_CONFIG", str(tmp_path / "configuration"))
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path / "configuration"


@pytest.fixture
def write_study(tmp_path: Path, configuration: Path) -> Callable[..., Path]:
    """Writes a protocol and a trap beside it that is its world's module; gives the protocol."""

    def write(module: str, code: str = TRAP, folder: str = "study") -> Path:
        (tmp_path / folder).mkdir()
        (tmp_path / folder / f"{module}.py").write_text(code)
        protocol = tmp_path / folder / "own.toml"
        protocol.write_text(PROTOCOL.replace("WORLD", f"{module}:own/Corridor-v0"))
        return protocol

    return write


@pytest.mark.program
def test_a_replay_in_a_folder_with_a_file_named_rerun_runs_the_real_one(trapped: Path) -> None:
    from minihuman.replay.recording import viewer_command, viewer_environment

    command = viewer_command(Path("x.rrd"), web=False)
    assert command[:4] == [sys.executable, "-P", "-m", "rerun"]
    environment = {**viewer_environment(), "HOME": str(trapped / "home")}
    said = subprocess.run([*command[:4], "--version"], cwd=trapped, env=environment, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert "rerun" in said.stdout
    assert not list(trapped.glob("ran-*"))
    assert not list((trapped / "home").rglob("analytics*")), "its usage statistics are off"


@pytest.mark.program
def test_a_command_in_a_folder_of_traps_runs_none_of_them(trapped: Path) -> None:
    script = Path(sys.executable).with_name("minihuman")
    if not script.exists():
        pytest.skip("the command minihuman is missing: pip install -e .")
    protocol = Path(__file__).parents[2] / "protocols" / "demo.toml"
    command = [script, "run", protocol, "--data", trapped / "data", "--window", "none"]
    said = subprocess.run(command, cwd=trapped, capture_output=True, text=True, timeout=300)
    assert said.returncode == 2, "there is no such window; by then every world has been played"
    assert "Traceback" not in said.stderr
    assert not list(trapped.glob("ran-*"))


def test_a_module_that_a_log_names_is_not_imported(configuration: Path) -> None:
    sys.modules.pop("this", None)
    with pytest.raises(WorldError, match="the module 'this' is not trusted"):
        World("this:X-v0")
    assert "this" not in sys.modules
    Trust(modules=frozenset({"this"})).record()
    with pytest.raises(WorldError, match="X"):
        World("this:X-v0")
    assert "this" in sys.modules


@pytest.mark.parametrize("module", ["minihuman.__main__", "__main__", "../evil", "_ctypes_test"])
def test_what_is_no_module_of_worlds_is_not_imported(configuration: Path, module: str) -> None:
    with pytest.raises(WorldError):
        World(f"{module}:X-v0")


def test_the_python_beside_a_protocol_runs_only_if_its_folder_is_trusted(
    write_study: Callable[..., Path], configuration: Path
) -> None:
    protocol = write_study("trap_one")
    with pytest.raises(ProtocolError, match=r"runs Python .* from .*study, which you do not trust yet") as refused:
        read_protocol(protocol)
    assert "\n" not in str(refused.value)
    asked = []
    with pytest.raises(ProtocolError):
        read_protocol(protocol, trust=lambda question: bool(asked.append(question)))
    assert asked == [f"This protocol runs Python or reads files from {protocol.parent}. Trust it?"]
    with pytest.raises(WorldError, match=r"not trusted|No module"):
        World("trap_one:own/Corridor-v0")
    assert not list(protocol.parent.glob("ran-*"))
    assert not configuration.exists()

    assert read_protocol(protocol, trust=True).study.name == "own"
    assert json.loads((configuration / "trust.jsonl").read_text()) == {"folder": str(protocol.parent)}
    read_protocol(protocol)  # from now on it is not asked again
    with pytest.raises(WorldError, match="tried to end the program"):  # so it ran
        World("trap_one:own/Corridor-v0")


def test_a_link_counts_where_it_leads(write_study: Callable[..., Path], tmp_path: Path) -> None:
    stranger = write_study("trap_two", folder="stranger")
    ours = tmp_path / "ours"
    ours.mkdir()
    Trust(frozenset({ours})).record()
    (ours / "own.toml").symlink_to(stranger)
    with pytest.raises(ProtocolError, match=r"stranger, which you do not trust"):
        read_protocol(ours / "own.toml")
    (ours / "own.toml").unlink()
    (ours / "own.toml").write_bytes(stranger.read_bytes())
    (ours / "trap_two.py").symlink_to(stranger.with_name("trap_two.py"))
    with pytest.raises(ProtocolError, match=r"stranger, which you do not trust"):
        read_protocol(ours / "own.toml")
    assert not list(stranger.parent.glob("ran-*"))


def test_a_library_is_not_replaced_by_a_file_beside_the_protocol(write_study: Callable[..., Path]) -> None:
    protocol = write_study("antigravity")
    with pytest.raises(ProtocolError, match="the module antigravity, which you do not trust"):
        read_protocol(protocol)
    assert "antigravity" not in sys.modules


def test_files_that_a_world_reads_are_those_of_a_trusted_folder(write_study: Callable[..., Path]) -> None:
    protocol = write_study("unused")
    text = protocol.read_text().replace('world = "unused:own/Corridor-v0"', 'world = "minihuman/MiniWorld-OneRoom-v0"')
    text = text.replace('["back", "forward"]', '["turn_left", "move_forward"]')
    protocol.write_text(text + 'options = { assets = "ours" }\n')
    (protocol.parent / "ours").mkdir()
    with pytest.raises(ProtocolError, match="do not trust"):
        read_protocol(protocol)
    read_protocol(protocol, trust=True)
    World("minihuman/MiniWorld-OneRoom-v0", {"assets": "ours"}).close()
    for outside in ("/etc", "../stranger", "../../../../../../etc"):
        with pytest.raises(WorldError, match="not in a trusted folder"):
            World("minihuman/MiniWorld-OneRoom-v0", {"assets": outside})


def test_a_record_that_cannot_be_read_is_named(configuration: Path) -> None:
    configuration.mkdir()
    (configuration / "trust.jsonl").write_text('{"folder": "/a"}\n"half\n')
    with pytest.raises(
        MinihumanError, match=r"trust.jsonl:2: '\"half' does not name a folder or module; delete this line"
    ):
        Trust.read()


def test_the_configuration_is_where_the_platform_keeps_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("MINIHUMAN_CONFIG")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert find_config_folder() == tmp_path / "minihuman"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    assert find_config_folder() == Path.home() / ".config" / "minihuman"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert find_config_folder() == Path.home() / "Library" / "Application Support" / "minihuman"


def test_two_trusted_folders_with_a_module_of_one_name_are_told_apart(
    write_study: Callable[..., Path], tmp_path: Path
) -> None:
    for folder in ("first", "second"):
        Trust(frozenset({write_study("trap_three", f"# of {folder}\n{TRAP}", folder).parent})).record()
    with pytest.raises(WorldError, match=r"first and .*second both have a module 'trap_three'"):
        World("trap_three:own/Corridor-v0")
    assert not list(tmp_path.rglob("ran-*"))


CORRIDOR = (Path(__file__).parents[1] / "worlds" / "corridor.py").read_text()
OWN = f"{CORRIDOR}\nfrom own_length import COUNT\ngymnasium.register('own/Corridor-v0', entry_point=CorridorEnv)\n"
COMMANDS = """
import os, sys
import minihuman.api, minihuman.cli, minihuman.dataset.store, minihuman.exporters.exporter, minihuman.figures.gallery
import minihuman.admin.verify.log, minihuman.reporting.build, minihuman.replay.recording
for number, words in enumerate(__import__("json").loads(sys.argv[1])):
    child = os.fork()
    if not child:
        for stream in (1, 2):
            os.dup2(os.open(f"said-{number}", os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
        sys.argv = ["minihuman", *words]
        minihuman.cli.main()
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.nightly
@pytest.mark.program
def test_every_command_finds_a_world_beside_the_protocol(write_study: Callable[..., Path], tmp_path: Path) -> None:
    protocol = write_study("own_corridor", OWN)
    (protocol.parent / "own_length.py").write_text("COUNT = 4\n")
    place = tmp_path / "elsewhere"
    place.mkdir()
    refused = [["serve", str(protocol)], ["simulate", str(protocol), "--trust", "--participants", "1"]]
    commands = [
        ["check", str(protocol)],
        ["simulate", str(protocol), "--participants", "1", "--player", "random"],
        ["verify", "sessions/own"],
        ["query", "sessions/own", "select count(*) from steps"],
    ]
    others = [
        ["check", str(protocol), "--pictures", "screens"],
        ["verify", "sessions/own", "--tables"],
        ["replay", "sessions/own", "--out", "own.rrd", "--view"],
        ["plot", "sessions/own", "--out", "figures"],
        ["report", "sessions/own", "--out", "report"],
        ["export", "minari", "sessions/own", "minari"],
        ["export", "csv", "sessions/own", "csv"],
        ["status", "sessions/own"],
    ]
    commands += count(0, 1) * others
    done = subprocess.run(
        [sys.executable, "-P", "-c", COMMANDS, json.dumps([*refused, *commands])],
        cwd=place,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        timeout=300,
    )
    said = [(place / f"said-{number}").read_text() for number in range(len(refused + commands))]
    assert done.returncode == 0, done.stderr
    codes = [int(code) for code in done.stdout.split()]
    assert codes == [2, 2, *[0] * len(commands)], "\n".join(said)
    assert "do not trust" in said[0]
    assert "has no planner" in said[1]
    log = place / "sessions" / "own" / "sub-01" / "ses-01" / "sub-01_ses-01.mcap"
    facts = read_log(log).facts
    for name in ("own_corridor", "own_length"):
        digest = hashlib.sha256((protocol.parent / f"{name}.py").read_bytes()).hexdigest()
        assert facts[f"world_sha256_{name}"] == digest

    looked = subprocess.run(
        [sys.executable, "-P", "-c", WATCHED, str(log), str(protocol.parent / "own_length.py")],
        cwd=place,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert looked.returncode == 0, looked.stderr
    picture, *findings = looked.stdout.splitlines()
    assert picture == "a picture", f"what `watch` shows: {looked.stderr}"
    assert findings[0] == "recorded with another file of the module own_length"
    assert "all as logged" in findings[1]
