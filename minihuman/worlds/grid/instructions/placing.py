"""Setting an instruction on a layout that is made: for worlds written in Python."""

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.state import TASK, Row
from minihuman.worlds.grid.core.tasks import INSTRUCTED
from minihuman.worlds.grid.instructions.bind import bind_now
from minihuman.worlds.grid.instructions.block import FLAGS, OWN_STEPS, ROOM, SAY_DONE, instructed_length
from minihuman.worlds.grid.instructions.language import Instruction
from minihuman.worlds.grid.instructions.numbers import block, to_numbers


def instruct(
    row: Row, instruction: Instruction, *, own_steps: bool = True, done_required: bool = False, room: int = 0
) -> None:
    """Make the instruction the task of a layout with its agent placed.

    Args:
        row: The state, of a world whose mission is an `InstructionSpace`.
        instruction: What to do.
        own_steps: Judge each part by its own steps, and by where things are; False is as in Minigrid.
        done_required: A clause ends when "done" is said right after it was done.
        room: Cells on a side of a room, walls included, for "on your left"; 0: the grid is one room.

    Raises:
        WorldError: if the world has no place for an instruction, or a description means nothing in it.
    """
    if len(row) < instructed_length(int(row[0]), int(row[1])):
        raise WorldError("this world has no instructions; give it mission=InstructionSpace()")
    numbers = block(row)
    numbers[:] = to_numbers(instruction)
    numbers[FLAGS] |= own_steps * OWN_STEPS | done_required * SAY_DONE
    numbers[ROOM] = room
    row[TASK] = INSTRUCTED
    if not bind_now(row):
        raise WorldError(f"'{instruction}' is about something that is not there; put it into the layout first")
