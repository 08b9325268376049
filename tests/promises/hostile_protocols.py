"""Protocols and policy files as a stranger could write them, checked one by one in a process that is watched.

Each number makes one folder: a shipped protocol or a small one, changed somewhere, with baits around it. An audit hook
sees every file that is opened, every module that is found and every program that is started. Run as
``python -m tests.promises.hostile_protocols FOLDER FIRST COUNT``; it prints what it found as JSON.
"""

import contextlib
import io
import json
import os
import pickle
import random
import resource
import shutil
import signal
import sys
import sysconfig
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

from minihuman import cli
from minihuman.admin.protocol_file import find_shipped_protocol
from tests.promises.sessions import TOML

PATIENCE_S = 60
MOST_MB = 512
PLANTED = (
    "[" * 5000,
    "x = " + "[" * 3000 + "]" * 3000,
    "x = " + "9" * 5000,
    'feedback = "{steps[0]}"',
    'feedback = "{outcome[a]}"',
    'feedback = "{steps:>99999999999}"',
    'feedback = "{steps!r}"',
    'version = "\\u001b[31mred"',
    "episodes = 99999999999999999999",
    "participants = -1",
    "max_steps = 1e400",
    "seeds = [1, 2",
    "a.b.c.d = 1979-05-27T07:32:00Z",
    "seed = nan",
    '"" = 1',
)


VALUES = ("-1", "0", "1e9", "[]", "{}", "true", '"x"', "[[1]]", "10000000")
TRAP = "import pathlib; pathlib.Path(__file__).with_name('ran').touch()\n"
PATHS = (
    *("/etc/passwd", "/dev/zero", "/dev/random", "/dev/stdin", "/proc/self/environ", "~/.ssh/id_rsa", "", "."),
    *("../outside/secret.png", "../outside/secret.pt", "link", "linked/secret.png", "pipe", "folder", "loop", "sparse"),
    *(
        "a" * 5000,
        "../" * 400 + "etc/passwd",
        "\\u0000",
        "\\u202egnp.x",
        "\\ud7ff",
        "é\\n.png",
        "C:\\\\secret",
        "huge.png",
    ),
    *("wide.png", "cut.png", "text.png"),
)
WORLDS = (
    *(
        "trap:X-v0",
        "this:X-v0",
        "antigravity:X-v0",
        "os:X",
        "__main__:X",
        "minihuman.__main__:X-v0",
        "../outside/trap:X",
    ),
    *("linked.trap:X-v0", "package.trap:X-v0", "tests.worlds.corridor:tests/Corridor-v0", ":", "a" * 9000, "\\u202e:X"),
    *("gymnasium.utils.play:X-v0", "minihuman/Nothing-v0", "minigrid:MiniGrid-Nothing-v0", "trap", "", "CartPole-v1"),
)
OPTIONS = (
    *(
        "{ size = 999999999 }",
        "{ size = -1 }",
        "{ size = 1e300 }",
        '{ assets = "/etc" }',
        '{ patterns = "../outside" }',
    ),
    *('{ xml_file = "/etc/passwd" }', '{ render_mode = "human" }', "{ additional_wrappers = [1] }", "{ width = 1024 }"),
    *("{ a = { b = { c = { d = [[[[]]]] } } } }", '{ entry_point = "trap:X" }', '{ max_episode_steps = "x" }'),
    '{ x = "' + "y" * 100_000 + '" }',
)
NUMBERS = ("0", "-1", "1", "9999", "10000", "100000", "99999999999999999999", "1e308", "inf", "nan", "0x7fffffff")
FIELDS = ("participants", "episodes", "max_steps", "seed", "min_rest_s", "step_period_ms")


def mutated(text: str, rng: random.Random) -> bytes:
    """A protocol with one to three lines changed."""
    lines = text.splitlines()
    for _ in range(rng.randint(1, 3)):
        place = rng.randrange(len(lines))
        match rng.randrange(6):
            case 0:
                lines.insert(place, rng.choice(PLANTED))
            case 1:
                lines.pop(place)
            case 2:
                lines.insert(place, rng.choice(lines))
            case 3:
                key, _, _ = lines[place].partition("=")
                lines[place] = f"{key}= {rng.choice(VALUES)}"
            case 4:
                line = lines[place]
                at = rng.randrange(len(line) + 1)
                lines[place] = line[:at] + rng.choice(['"', "\\", "\u202e", "=", "[", "\0", "é"]) + line[at:]
            case 5:
                key, equals, value = lines[place].partition("=")
                lines[place] = f"{key}{equals}{value * rng.choice([2, 50])}"
    return "\n".join(lines).encode(errors="surrogatepass")


def write_case(number: int, folder: Path) -> None:
    """Write the folder of a stranger, whose protocol is ``study/protocol.toml``, and baits beside it."""
    rng = random.Random(number)
    study, outside = folder / "study", folder / "outside"
    for each in (study / "folder", study / "package", outside):
        each.mkdir(parents=True)
    for place in (
        study / "trap.py",
        study / "package" / "__init__.py",
        study / "package" / "trap.py",
        outside / "trap.py",
    ):
        place.write_text(TRAP)
    (study / "sitecustomize.py").write_text(TRAP)
    (study / "evil-1.dist-info").mkdir()
    (study / "evil-1.dist-info" / "entry_points.txt").write_text("[minihuman.agents]\nevil = trap:X\n")
    png = _png(4, 4)
    (outside / "secret.png").write_bytes(png)
    (outside / "secret.pt").write_bytes(b"secret")
    (study / "link").symlink_to(outside / "secret.png")
    (study / "linked").symlink_to(outside)
    (study / "loop").symlink_to(study / "loop")
    os.mkfifo(study / "pipe")
    with (study / "sparse").open("wb") as file:
        file.truncate(1 << 40)
    (study / "huge.png").write_bytes(_png(60_000, 60_000))
    (study / "wide.png").write_bytes(_png(5_000, 5_000))
    (study / "cut.png").write_bytes(png[:40])
    (study / "text.png").write_bytes(b"no picture")
    text = TOML.format(episodes=2, steps=10)
    if number % 10 == 9:
        text = find_shipped_protocol(rng.choice(("demo", "instructions", "two-days"))).read_text()
    kind = rng.choice(tuple(KINDS))
    content = KINDS[kind](text, rng, study)
    protocol = study / "protocol.toml"
    if content is not None:
        protocol.write_bytes(content)


def _png(width: int, height: int) -> bytes:
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    header = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([1, 0, 0, 0, 0])  # one bit a pixel
    rows = zlib.compress(bytes(min(height, 5_000) * (width // 8 + 2)), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def _with_picture(text: str, rng: random.Random, study: Path) -> bytes:
    names = ", ".join(f'"{rng.choice(PATHS)}"' for _ in range(rng.randint(1, 2)))
    return f'{text}\n[[pages]]\nname = "seen"\ntext = "Look."\nimages = [{names}]\n'.encode(errors="surrogatepass")


def _with_policy(text: str, rng: random.Random, study: Path) -> bytes:
    name = rng.choice((*PATHS, *["made.pt"] * 60))
    if name == "made.pt":
        rng.choice(POLICIES)(study / name, rng)
    return _with_agent(text, name)


def _with_agent(text: str, policy: str) -> bytes:
    agent = f'kind = "takeover"\nagent = {{ policy = "{policy}", step_ms = 400 }}\n'
    return text.replace("episodes = ", f"{agent}episodes = ", 1).encode(errors="surrogatepass")


def _with_world(text: str, rng: random.Random, study: Path) -> bytes:
    lines = [f'world = "{rng.choice(WORLDS)}"' if line.startswith("world = ") else line for line in text.splitlines()]
    return "\n".join(lines).encode(errors="surrogatepass")


def _with_options(text: str, rng: random.Random, study: Path) -> bytes:
    worlds = ("Empty-5x5", "FourRooms", "WFC-MazeSimple", "DoorKey-8x8", "LavaGapS7", "Dynamic-Obstacles-8x8")
    world = rng.choice([f"MiniGrid-{name}-v0" for name in worlds] + ["MiniWorld-Hallway-v0", "MiniWorld-Maze-v0"])
    lines = [
        f'world = "minihuman/{world}"\noptions = {rng.choice(OPTIONS)}' if line.startswith("world = ") else line
        for line in text.splitlines()
    ]
    return "\n".join(lines).encode()


def _with_number(text: str, rng: random.Random, study: Path) -> bytes:
    field, value = rng.choice(FIELDS), rng.choice(NUMBERS)
    return "\n".join(
        f"{field} = {value}" if line.startswith(f"{field} = ") else line for line in text.splitlines()
    ).encode()


def _many(text: str, rng: random.Random, study: Path) -> bytes:
    """Much of one thing."""
    count = rng.choice((50, 500, 5_000))
    match rng.randrange(5):
        case 0:
            names = [f"block-{number}" for number in range(count)]
            text = text.replace('blocks = ["small"]', f"blocks = {json.dumps(names)}")
            block = text[text.index("[[blocks]]") :]
            blocks = "\n".join(
                block.replace('name = "small"', f'name = "{name}"').replace("episodes = 2", "episodes = 10000")
                for name in names
            )
            text = text[: text.index("[[blocks]]")] + blocks
        case 1:
            text += "".join(f'\n[[groups]]\nname = "g{number}"\nblocks = ["small"]' for number in range(count))
        case 2:
            text += '\n[[pages]]\nname = "long"\ntext = "' + "word " * 100 * count + '"\n'
        case 3:
            text += "\n[words.a]" + "".join(f"\nk{number} = 1" for number in range(count))
        case 4:
            text += "\nx = " + "[" * count + "]" * count
    return text.encode()


def _as_file(text: str, rng: random.Random, study: Path) -> bytes | None:
    """A protocol that is no ordinary file."""
    match rng.randrange(6):
        case 0:
            (study / "protocol.toml").symlink_to("/dev/zero")
        case 1:
            os.mkfifo(study / "protocol.toml")
        case 2:
            (study / "protocol.toml").mkdir()
        case 3:
            os.link(study / "sparse", study / "protocol.toml")
        case 4:
            return text.encode("utf-16")
        case 5:
            return rng.randbytes(rng.choice((1, 1_000, 2**20 + 1)))
    return None


def _with_name(text: str, rng: random.Random, study: Path) -> bytes:
    field = rng.choice(('language = "{}"\n', 'language = "../../../etc/passwd{}"\n', 'version = "{}"\n'))
    text = text.replace("seed = ", field.format(rng.choice(PATHS)) + "seed = ", 1)
    if rng.random() < 0.5:
        text += f'\n[[questions]]\nname = "asked"\nform = "{rng.choice(PATHS)}"\n'
    return text.encode(errors="surrogatepass")


KINDS: dict[str, Callable[[str, random.Random, Path], bytes | None]] = {
    "text": lambda text, rng, study: mutated(text, rng),
    "picture": _with_picture,
    "policy": _with_policy,
    "world": _with_world,
    "options": _with_options,
    "number": _with_number,
    "many": _many,
    "file": _as_file,
    "name": _with_name,
}


class _Runs:
    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> Any:
        return os.system, (self.command,)


def _policy(change: Callable[[dict[str, Any], random.Random], Any]) -> Callable[[Path, random.Random], None]:
    """A policy file with one change to what it holds."""

    def write(path: Path, rng: random.Random) -> None:
        import torch

        from minihuman.learn.policy.file import PolicyCard, save_policy
        from minihuman.learn.policy.network import build_policy
        from minihuman.learn.policy.observation import ObservationEncoder

        names = ("left", "right", "forward")
        card = PolicyCard(
            "minihuman/MiniGrid-Empty-5x5-v0",
            {},
            names,
            (3, 7, 7),
            ObservationEncoder(missions=False),
            "codes",
            "",
            0,
            1,
        )
        save_policy(build_policy(card.observation_space, len(names), "codes"), card, path)
        content = torch.load(path, weights_only=True)
        changed = change(content, rng)
        torch.save(content if changed is None else changed, path)

    return write


def _change_card(content: dict[str, Any], rng: random.Random) -> None:
    import torch

    name = rng.choice(tuple(content["card"]))
    content["card"][name] = rng.choice(
        (None, [], {}, -1, 10**30, "x", ("a", "b"), [[[]]], float("nan"), torch.zeros(2))
    )


def _change_shape(content: dict[str, Any], rng: random.Random) -> None:
    content["card"]["image_shape"] = rng.choice(
        ((3, 100_000, 100_000), (3, 0, 0), (-3, 7, 7), (3, 7), (3, 2_000, 2_000), (10**18, 10**18, 10**18), (1, 7, 7))
    )
    content["card"]["eyes"] = rng.choice(("grid", "atari", "map", "codes", "near", "none"))


def _change_weights(content: dict[str, Any], rng: random.Random) -> None:
    import torch

    weights = content["weights"]
    name = rng.choice((*weights, "action_net.bias", "action_net.bias"))
    match rng.randrange(9):
        case 0:
            del weights[name]
        case 1:
            content["weights"] = rng.choice(([], None, 3, "x", {}, {1: 2}))
        case 2:
            weights[name] = torch.full_like(weights[name], float("nan"))
        case 3:
            weights[name] = torch.zeros(1).expand(50_000, 50_000)
        case 4:
            weights[name] = weights[name].double()
        case 5:
            weights[name] = "x" * 1000
        case 6:
            del content["weights"]
        case 7:
            weights[name] = weights[name].to_sparse()
        case 8:
            weights[name] = torch.zeros(10**6)


def _write_pickle(path: Path, rng: random.Random) -> None:
    value = rng.choice((_Runs(f"touch {path.with_name('ran')}"), {"format": 1, "card": {}, "weights": {}}, [1] * 10**6))
    data = pickle.dumps(value)
    path.write_bytes(data[: rng.choice((len(data), len(data) // 2))])


def _write_archive(path: Path, rng: random.Random) -> None:
    """An archive that unpacks to gigabytes, or is none of PyTorch's."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        match rng.randrange(3):
            case 0:
                with archive.open("made/data.pkl", "w", force_zip64=True) as file:
                    for _ in range(100):
                        file.write(bytes(2**20))
            case 1:
                archive.writestr("../../outside/written", b"x")
            case 2:
                archive.writestr("made/data.pkl", pickle.dumps(_Runs(f"touch {path.with_name('ran')}")))
                archive.writestr("made/version", b"3\n")


def _cut(path: Path, rng: random.Random) -> None:
    _policy(lambda content, rng: None)(path, rng)
    data = bytearray(path.read_bytes())
    if rng.random() < 0.5:
        del data[rng.randrange(len(data)) :]
    else:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    path.write_bytes(data)


POLICIES: tuple[Callable[[Path, random.Random], None], ...] = (
    *map(_policy, (_change_card, _change_shape, _change_weights, _change_weights)),
    _policy(lambda content, rng: rng.choice(([], {}, {"format": 2}, {"format": 1}, "x"))),
    *(_write_pickle, _write_archive, _cut),
)


class Watch:
    """Sees what a process opens, finds and starts while a case is checked."""

    def __init__(self, allowed: list[Path]) -> None:
        self._allowed = tuple(str(path.resolve()) for path in allowed)
        self._case = ""  # of the folder that is checked
        self._busy = False
        self.offences: list[str] = []

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """What the interpreter calls; must not raise."""
        if not self._case or self._busy:
            return
        self._busy = True
        try:
            self._take(event, arguments)
        finally:
            self._busy = False

    @contextlib.contextmanager
    def over(self, case: Path) -> Any:
        """Watch while a case is checked."""
        self._case = str(case.resolve())
        try:
            yield
        finally:
            self._case = ""

    def _take(self, event: str, arguments: tuple[Any, ...]) -> None:
        match event:
            case "open" if isinstance(arguments[0], str | bytes | os.PathLike):
                path = os.path.realpath(os.fsdecode(arguments[0]))
                inside = path.startswith(f"{self._case}/study/")
                if not inside and not path.startswith(self._allowed):
                    self.offences.append(f"opened {path}")
            case "exec" if str(getattr(arguments[0], "co_filename", "")).startswith(self._case):
                self.offences.append(f"ran {arguments[0].co_filename}")
            case "os.system" | "subprocess.Popen" | "os.exec" | "os.posix_spawn" | "socket.connect":
                self.offences.append(f"{event} {arguments[:2]}")
            case "import" if arguments[0] in ("trap", "this", "antigravity", "evil", "sitecustomize"):
                self.offences.append(f"imported {arguments[0]}")


def check_case(protocol: Path) -> tuple[str, str]:
    """Run ``minihuman check``; give how it ended ("read" or "refused") and what is wrong with that."""
    said, errors = io.StringIO(), io.StringIO()
    sys.argv = ["minihuman", "check", str(protocol)]
    code: object = None
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
            cli.main()
    except SystemExit as ended:
        code = ended.code
    except BaseException as error:
        return "failed", f"{type(error).__name__}: {error}"[:300]
    lines = [line for line in errors.getvalue().splitlines() if not line.startswith("Warning: ")]
    if code == 0:
        return "read", ""
    if not lines or any(not line.startswith("minihuman: ") or "Traceback" in line for line in lines):
        return "refused", f"not a sentence: {lines[:3]}"
    return "refused", ""


def main() -> None:
    """Check cases and print what was found."""
    place, first, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    with tempfile.TemporaryDirectory() as folder:  # what every check loads, once; each case has a process of its own
        protocol = Path(folder, "protocol.toml")
        protocol.write_text(TOML.format(episodes=2, steps=10))
        _policy(lambda content, rng: None)(Path(folder, "made.pt"), random.Random())
        protocol.write_bytes(_with_agent(protocol.read_text(), "made.pt"))
        assert check_case(protocol) == ("read", "")
    writer = os.fork()  # what it takes to write them is not to be counted
    if not writer:
        for number in range(first, first + count):
            write_case(number, place / str(number))
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(writer, 0)[1]) == 0
    allowed = [
        Path(name) for name in {*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix, "/proc/self/status"}
    ]
    allowed += [
        *(
            Path(__file__).parents[2],
            Path("/usr/share"),
            Path(matplotlib.get_cachedir()),
            Path("/sys"),
            Path("/proc/cpuinfo"),
            Path("/dev/null"),
        ),
        *map(Path, filter(None, sys.path)),  # where packages are that the environment takes from another one
        Path(os.environ["MINIHUMAN_CONFIG"]),
    ]
    watch = Watch(allowed)
    sys.addaudithook(watch)
    signal.signal(signal.SIGALRM, _give_up)
    ends, wrong, peaks_mb = Counter[str](), dict[int, list[str]](), [0]
    for number in range(first, first + count):
        end, found, peak_mb = _in_child(lambda case=place / str(number): _watched(watch, case))
        if peak_mb >= MOST_MB:
            found.append(f"{peak_mb} MB")
        if found:
            wrong[number] = found
        ends[end] += 1
        peaks_mb.append(peak_mb)
        shutil.rmtree(place / str(number))
    print(json.dumps({"ends": ends, "wrong": wrong, "peak_mb": max(peaks_mb)}))


def _watched(watch: Watch, case: Path) -> tuple[str, list[str], int]:
    """How a check ended, what is wrong with that, and the most memory that was taken, MB."""
    signal.alarm(PATIENCE_S)
    with watch.over(case):
        end, problem = check_case(case / "study" / "protocol.toml")
    signal.alarm(0)
    made = [*case.rglob("ran"), *(case / "outside").glob("written")]
    found = [*filter(None, [problem]), *watch.offences, *(f"made {path}" for path in made)]
    return end, found, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def _in_child(work: Callable[[], tuple[str, list[str], int]]) -> tuple[str, list[str], int]:
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        end, found, peak_mb = work()
        os.write(writer, json.dumps((end, [text[:300] for text in found[:50]], peak_mb)).encode())
        os._exit(0)
    os.close(writer)
    with open(reader, "rb") as file:
        answer = file.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    end, found, peak_mb = json.loads(answer) if answer else ("failed", [f"exit {code}"], 0)
    return end, found, peak_mb


def _give_up(*_: object) -> None:
    raise TimeoutError(f"it takes longer than {PATIENCE_S} s")


if __name__ == "__main__":
    main()
