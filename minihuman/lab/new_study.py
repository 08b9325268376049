"""A first protocol of one's own: a few answers become a TOML file that runs as it is."""

import re
from dataclasses import dataclass

from minihuman.errors import ProtocolError
from minihuman.study.protocol import decode
from minihuman.worlds.adapt.world import World

_STEPS = 100  # where the world has no limit of its own
_MOVES = ("left", "right", "forward", "turn_left", "turn_right", "move_forward", "up", "down")
SCHEMA_FILE = "minihuman.schema.json"


@dataclass(frozen=True, slots=True)
class Draft:
    """What a new study is to be."""

    name: str = "my-study"
    world: str = "minihuman/MiniGrid-FourRooms-v0"
    episodes: int = 5
    participants: int = 20
    keys: str = "fresh"  # found by trying, or "shown"

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
        decode(text.encode(), f"{self.name}.toml")
        return text


def study_name(words: str) -> str:
    """A name as a study's has to be, from whatever was typed.

    Raises:
        ProtocolError: if nothing is left of it.
    """
    name = re.sub(r"[^a-z0-9_]+", "-", words.lower()).strip("-_")[:64]
    if not name:
        raise ProtocolError(f"{words!r} makes no name; use lower-case letters, digits, '-' and '_'")
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
key_map = "{key_map}"  # fresh: which key does what is to be found out; shown: it is on the screen
instruction = "Find the goal. Some of the keys 1 to 9 do something; find out which."
feedback = "{{outcome}}, {{steps}} steps."
"""
