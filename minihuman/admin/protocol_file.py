"""Protocol files: write a first one from a few answers, read one with its pictures and policies, find a shipped one.

Shipped protocols lie inside the package when it is installed, and beside it in a checkout.
"""

import errno
import io
import re
import stat
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
from PIL import Image

from minihuman.agents.agent import is_registered_agent, make_policy_agent
from minihuman.errors import MinihumanError, ProtocolError
from minihuman.experiment.activities.block_plans import LATEST_POLICY
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol, list_old_names
from minihuman.trust import NamedWorld, Permission, admit_worlds
from minihuman.worlds.adapters.world import World

_STEPS = 100  # where the world has no limit of its own
_MOVES = ("left", "right", "forward", "turn_left", "turn_right", "move_forward", "up", "down")
SCHEMA_FILE = "minihuman.schema.json"
MAX_PROTOCOL_BYTES = 2**20
MAX_PICTURE_BYTES = 2**24
MAX_PICTURE_PIXELS = 4096 * 4096
MAX_POLICY_BYTES = 2**25


@dataclass(frozen=True, slots=True)
class ProtocolDraft:
    """What a new study is to be."""

    name: str = "my-study"
    world: str = "minihuman/MiniGrid-FourRooms-v0"
    episodes: int = 5
    participants: int = 20
    keys: str = "new"  # found by trying, or "shown"

    def toml(self) -> str:
        """The protocol file, with what else there is as comments.

        Raises:
            ProtocolError: if the answers make no study.
            WorldError: if there is no such world.
        """
        world = World(self.world, trusted=True)
        names, limit = world.action_names, world.step_limit
        world.close()
        moves = [name for name in names if name in _MOVES] or list(names)
        text = _TEMPLATE.format(
            schema=SCHEMA_FILE,
            name=self.name,
            seed=sum(ord(letter) * 31**place for place, letter in enumerate(self.name)) % 10**6,
            participants=self.participants,
            world=self.world,
            episodes=self.episodes,
            actions=", ".join(f'"{name}"' for name in moves[:9]),
            others=", ".join(name for name in names if name not in moves) or "none",
            max_steps=limit or _STEPS,
            key_map=self.keys,
        )
        decode_protocol(text.encode(), f"{self.name}.toml")
        return text


def make_study_name(words: str) -> str:
    """A name as a study's has to be, from whatever was typed.

    Raises:
        ProtocolError: if nothing is left of it.
    """
    name = re.sub(r"[^a-z0-9_]+", "-", words.lower()).strip("-_")[:64]
    if not name:
        raise ProtocolError(f"{words!r} is not a valid name; use lower-case letters, digits, '-' and '_'")
    return name


_TEMPLATE = """\
#:schema ./{schema}
# A study of one group and one block. protocols/README.md has every field; `minihuman check` says what is wrong,
# and `minihuman check --pictures DIR` draws every screen.

[study]
name = "{name}"  # names the folder of its data
version = "1.0"
seed = {seed}  # every random choice of the study derives from it
participants = {participants}  # the allocation list's length
consent = \"\"\"
You will play some rounds of a simple game. Taking part is voluntary: you may stop at any time by holding Escape.
\"\"\"
closing = "Thank you for taking part."

[keys]
pool = ["1", "2", "3", "4", "5", "6", "7", "8", "9"]  # actions are dealt to these keys, anew for each participant

[[groups]]
name = "everyone"
blocks = ["play"]

[[blocks]]
name = "play"
world = "{world}"
episodes = {episodes}
actions = [{actions}]  # those that get a key; the world's others: {others}
max_steps = {max_steps}
key_map = "{key_map}"  # new: which key does what is to be found out; shown: it is on the screen
instructions = "Find the goal. Some of the keys 1 to 9 do something; find out which."
feedback = "{{outcome}}, {{steps}} steps."
"""


def read_protocol(path: Path, *, trust: Permission = False) -> Protocol:
    """Read and check a protocol file with its pictures and policies, all in its folder once links are followed.

    Python files in the folder can be the modules of its worlds from then on, if the user trusts the folder.
    Warns (``FutureWarning``) of each field or value under an old name.

    Args:
        path: the TOML file.
        trust: whether to trust the folder if it is not trusted yet, or what asks the user.

    Raises:
        ProtocolError: if it cannot be read, says something impossible, or runs Python that is not trusted; one line
            with the way out.
    """
    try:
        toml = _read_file(path, MAX_PROTOCOL_BYTES)
    except OSError as error:
        raise ProtocolError(f"{path} cannot be read: {error.strerror}; name a protocol's TOML file") from error
    protocol = decode_protocol(toml, str(path))
    for line in list_old_names(protocol, str(path)):
        warnings.warn(line, FutureWarning, stacklevel=2)
    folder = path.resolve().parent
    if refused := admit_worlds(_find_worlds(msgspec.to_builtins(protocol)), folder, trust):
        raise ProtocolError(
            f"{path} runs Python or reads files from {refused}, which you do not trust yet; read its code, then add "
            "--trust"
        )
    pictures, policies = _find_pictures(protocol), _find_policies(protocol)
    files = {name: _read_picture(folder, name, f"{path}: {where}") for name, where in pictures.items()}
    files |= {name: _read_policy(folder, name, f"{path}: {where}") for name, where in policies.items()}
    return msgspec.structs.replace(protocol, files=files)


def _find_worlds(value: object) -> Iterator[NamedWorld]:
    """Every world that a table of a protocol names, in the overrides of a group too."""
    if isinstance(value, Mapping):
        if isinstance(value.get("world"), str) or isinstance(value.get("options"), Mapping):
            world, options = value.get("world"), value.get("options")
            yield world if isinstance(world, str) else "", options if isinstance(options, Mapping) else {}
        value = tuple(value.values())
    if isinstance(value, list | tuple):
        for each in value:
            yield from _find_worlds(each)


def _find_pictures(protocol: Protocol) -> dict[str, str]:
    """The pictures of its pages, each with the field that names it."""
    return {name: f"$.pages[{number}].images" for number, page in enumerate(protocol.pages) for name in page.images}


def _find_policies(protocol: Protocol) -> dict[str, str]:
    """The policy files of its agents, each with the field that names it."""
    named = ((number, block.agent.policy) for number, block in enumerate(protocol.blocks) if block.agent is not None)
    return {
        name: f"$.blocks[{number}].agent.policy"
        for number, name in named
        if name and name != LATEST_POLICY and not is_registered_agent(name)
    }


def _read_picture(folder: Path, name: str, where: str) -> bytes:
    content = _read_beside(folder, name, where, MAX_PICTURE_BYTES, "copy it into the protocol's folder")
    try:
        with warnings.catch_warnings(), Image.open(io.BytesIO(content), formats=("PNG",)) as image:
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # larger ones are refused here
            if image.width * image.height <= MAX_PICTURE_PIXELS:
                image.load()
                return content
            problem = f"has {image.width} x {image.height} pixels; use {MAX_PICTURE_PIXELS} at most"
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        cut = "damaged" if content.startswith(b"\x89PNG") else "not a PNG"
        problem = f"is {cut} ({type(error).__name__}); save it as a PNG"
    raise ProtocolError(f"{where}: {folder / name} {problem}")


def _read_policy(folder: Path, name: str, where: str) -> bytes:
    cure = "copy the policy file into the protocol's folder, or name a registered agent"
    content = _read_beside(folder, name, where, MAX_POLICY_BYTES, cure)
    try:
        make_policy_agent(folder / name)
    except MinihumanError as error:
        raise ProtocolError(f"{where}: {error}") from error
    return content


def _read_beside(folder: Path, name: str, where: str, limit: int, cure: str) -> bytes:
    """Read a file of the protocol's folder, which is given without links.

    Raises:
        ProtocolError: if it is no regular file in it, is larger than ``limit``, or cannot be read.
    """
    try:
        path = (folder / name).resolve(strict=True)
        if not path.is_relative_to(folder):
            raise ProtocolError(f"{where}: {name!r} leads out of the protocol's folder; {cure}")
        return _read_file(path, limit)
    except (OSError, ValueError, RuntimeError) as error:
        if isinstance(error, ProtocolError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise ProtocolError(f"{where}: {folder / name} cannot be read: {reason}; {cure}") from error


def _read_file(path: Path, limit: int) -> bytes:
    """Read a regular file of a limited size.

    Raises:
        OSError: if it is a device or the like, is too large, or cannot be read.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    with path.open("rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise OSError(errno.EFBIG, f"it is larger than {limit} bytes")
    return content


_PACKAGE = Path(__file__).parents[1]


def find_shipped_protocol(name: str) -> Path:
    """Where a shipped protocol's TOML file is, by the file's name without its ending."""
    inside = _PACKAGE / "protocols" / f"{name}.toml"
    return inside if inside.exists() else _PACKAGE.parent / "protocols" / f"{name}.toml"
