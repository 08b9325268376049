"""Protocol files: write a first one from a few answers, read one with its pictures and policies, find a shipped one.

Shipped protocols lie inside the package when it is installed, and beside it in a checkout.
"""

import re
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import msgspec

from minihuman.agents.agent import is_registered_agent
from minihuman.errors import ProtocolError
from minihuman.experiment.activities.block_plans import LATEST_POLICY
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol, list_old_names
from minihuman.worlds.adapters.world import World

_STEPS = 100  # where the world has no limit of its own
_MOVES = ("left", "right", "forward", "turn_left", "turn_right", "move_forward", "up", "down")
SCHEMA_FILE = "minihuman.schema.json"


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
        world = World(self.world)
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


def read_protocol(path: Path) -> Protocol:
    """Read and check a protocol file; Python files beside it can be the modules of its worlds from then on.

    Warns (``FutureWarning``) of each field or value under an old name.

    Raises:
        ProtocolError: if it cannot be read, or says something impossible; one line with the way out.
    """
    try:
        toml = path.read_bytes()
    except OSError as error:
        raise ProtocolError(f"{path} cannot be read: {error.strerror}; name a protocol's TOML file") from error
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)  # the last: nothing in it takes the place of a library
    protocol = decode_protocol(toml, str(path))
    for line in list_old_names(protocol, str(path)):
        warnings.warn(line, FutureWarning, stacklevel=2)
    return msgspec.structs.replace(protocol, files=_read_pictures(protocol, path) | _read_policies(protocol, path))


def _read_policies(protocol: Protocol, path: Path) -> dict[str, bytes]:
    """The policy files of its agents, which lie beside it, by name."""
    found: dict[str, bytes] = {}
    for number, block in enumerate(protocol.blocks):
        name = block.agent.policy if block.agent is not None else ""
        if name and name != LATEST_POLICY and not is_registered_agent(name):
            try:
                found[name] = (path.parent / name).read_bytes()
            except OSError as error:
                where = f"{path}: $.blocks[{number}].agent.policy"
                reason = f"{path.parent / name} cannot be read: {error.strerror}"
                raise ProtocolError(
                    f"{where}: {reason}; copy the policy file into the protocol's folder, or name a registered agent"
                ) from error
    return found


def _read_pictures(protocol: Protocol, path: Path) -> dict[str, bytes]:
    """The pictures of its pages, which lie beside it, by name."""
    found: dict[str, bytes] = {}
    for number, page in enumerate(protocol.pages):
        for name in page.images:
            picture = path.parent / name
            try:
                found[name] = picture.read_bytes()
            except OSError as error:
                where = f"{path}: $.pages[{number}].pictures"
                raise ProtocolError(
                    f"{where}: {picture} cannot be read: {error.strerror}; copy it into the protocol's folder"
                ) from error
            if not found[name].startswith(b"\x89PNG"):
                raise ProtocolError(f"{path}: $.pages[{number}].pictures: {picture} is not a PNG; save it as one")
    return found


_PACKAGE = Path(__file__).parents[1]


def find_shipped_protocol(name: str) -> Path:
    """Where a shipped protocol's TOML file is, by the file's name without its ending."""
    inside = _PACKAGE / "protocols" / f"{name}.toml"
    return inside if inside.exists() else _PACKAGE.parent / "protocols" / f"{name}.toml"
