"""A protocol against its worlds: does each exist, has it the actions and steps that blocks ask for, does it play?"""

from collections.abc import Callable

from minihuman.errors import ProtocolError, WorldError
from minihuman.study.protocol import Block, Protocol
from minihuman.worlds.adapt.world import World

SEEDS = 5  # that are laid out where a block does not say which


def rehearse(
    protocol: Protocol, source: str = "protocol", *, before: Callable[[Block], None] = lambda block: None
) -> None:
    """Make every block's world, look its actions up, and play it; ``source`` names the file in errors.

    ``before`` is called with each block before its world is played.

    Raises:
        ProtocolError: at the first block whose world cannot be played as it says.
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
    for number, block in enumerate(protocol.blocks):
        try:
            world = World(block.world, block.options)
        except WorldError as error:
            raise ProtocolError(f"{source}: $.blocks[{number}].world: {error}") from error
        missing, limit = _missing(block, world.action_names), world.step_limit
        world.close()
        if missing:
            field, name = missing
            raise ProtocolError(
                f"{source}: $.blocks[{number}].{field} names {name!r}, which {block.world} does not have; "
                f"its actions are {', '.join(world.action_names)}"
            )
        if limit is not None and block.max_steps > limit:
            raise ProtocolError(
                f"{source}: $.blocks[{number}].max_steps is {block.max_steps}, but {block.world} ends an episode "
                f"after {limit} steps; ask for {limit} or fewer, or give the world more with options = {{ max_steps = "
                f"{block.max_steps} }} if it has that option"
            )


def _missing(block: Block, known: tuple[str, ...]) -> tuple[str, str] | None:
    """The first name, and its field, that is no action of the world."""
    named = {"actions": block.actions, "distractors": block.distractors, "noop": (block.noop,) if block.noop else ()}
    return next(((field, name) for field, names in named.items() for name in names if name not in known), None)
