"""A protocol against its worlds: does each exist, has it the actions and steps that blocks ask for, does it play?"""

import difflib
import tomllib
from collections.abc import Callable, Iterator

from minihuman.errors import ProtocolError, WorldError
from minihuman.study.mistakes import told
from minihuman.study.protocol import Block, Protocol
from minihuman.worlds.adapt.world import World
from minihuman.worlds.catalogue import ENTRIES

_OURS = "minihuman/"

SEEDS = 5  # that are laid out where a block does not say which


def rehearse(
    protocol: Protocol, source: str = "protocol", *, before: Callable[[Block], None] = lambda block: None
) -> None:
    """Make every block's world, look its actions up, and play it; ``source`` names the file in errors.

    ``before`` is called with each block before its world is played.

    Raises:
        ProtocolError: of every block whose world is not as it says, or at the first whose world cannot be played.
    """
    _look_up(protocol, source)
    for number, block in enumerate(protocol.blocks):
        try:
            before(block)
            play_a_step(block)
        except Exception as error:  # whatever somebody's world may raise
            reason = str(error) if isinstance(error, WorldError) else f"{type(error).__name__}: {error}"
            raise ProtocolError(f"{source}: $.blocks[{number}].world: {block.world} fails ({reason})") from error


def play_a_step(block: Block) -> None:
    """Do everything once that an episode of a block does with its world, with each of its layouts and actions."""
    seeds = sorted(set(block.seeds)) if isinstance(block.seeds, tuple) else range(SEEDS)
    world = World(block.world, block.options)
    try:
        for seed in seeds:
            world.reset(seed)
        for action in (*block.actions, *block.distractors):
            world.reset(seeds[0])
            world.map(), world.pose(), world.state_hash()
            world.step(world.action_names.index(action))
        world.frame(block.view, palette=block.palette)
    finally:
        world.close()


def _look_up(protocol: Protocol, source: str) -> None:
    text = protocol.toml.decode("utf-8-sig")
    complaints = [
        (f"$.blocks[{number}].{field}", complaint)
        for number, block in enumerate(protocol.blocks)
        for field, complaint in _complaints(block)
    ]
    if wrong := told(complaints, source=source, text=text, tree=tomllib.loads(text)):
        raise wrong


def _complaints(block: Block) -> Iterator[tuple[str, str]]:
    try:
        world = World(block.world, block.options)
    except WorldError as error:
        yield "world", f"is {block.world!r}: {_reason(block, error)}"
        return
    known, limit = world.action_names, world.step_limit
    world.close()
    named = {"actions": block.actions, "distractors": block.distractors, "noop": (block.noop,) if block.noop else ()}
    for field, names in named.items():
        for name in names:
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                meant = f"; did you mean {close[0]!r}?" if close else ""
                yield field, f"names {name!r}, which {block.world} does not have; its actions are {_list(known)}{meant}"
    if limit is not None and block.max_steps > limit:
        more = f"options = {{ max_steps = {block.max_steps} }} if it has that option"
        asked = f"ask for {limit} or fewer, or give the world more with {more}"
        yield "max_steps", f"is {block.max_steps}, but {block.world} ends an episode after {limit} steps; {asked}"


def _list(names: tuple[str, ...]) -> str:
    return ", ".join(names)


def _reason(block: Block, error: WorldError) -> str:
    """Why there is no such world, and which may have been meant."""
    reason = str(error).removeprefix(f"{block.world}: ")
    name = block.world.rpartition("/")[2].rpartition(":")[2]
    ours = [entry.id for entry in ENTRIES]
    if block.world in ours:
        return reason
    if f"{_OURS}{name}" in ours:
        upstream = "miniworld" if name.startswith("MiniWorld") else "minigrid"
        return f"there is none of that name alone; write {_OURS + name!r}, or {f'{upstream}:{name}'!r} for the original"
    close = difflib.get_close_matches(block.world, ours, n=1) or difflib.get_close_matches(f"{_OURS}{name}", ours, n=1)
    meant = f"; did you mean {close[0]!r}? `minihuman worlds` lists ours" if close else ""
    return f"{reason}{meant}"
