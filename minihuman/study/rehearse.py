"""A protocol against its worlds: does each exist, and has it the actions and the steps that the blocks ask for?"""

from minihuman.errors import ProtocolError, WorldError
from minihuman.study.protocol import Block, Protocol
from minihuman.worlds.adapt.world import World


def rehearse(protocol: Protocol, source: str = "protocol") -> None:
    """Make every block's world and look its actions up, playing nothing; ``source`` names the file in errors.

    Raises:
        ProtocolError: at the first block whose world cannot be played as it says.
    """
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
