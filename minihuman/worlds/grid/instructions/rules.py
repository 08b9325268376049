"""What an action does where an instruction says what is to be done: every grid's actions, judged by the verifier."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.chance import Words
from minihuman.worlds.grid.core.rules import act, apply, close, refusal
from minihuman.worlds.grid.core.state import DIRECTION, STEP, TASK, Row
from minihuman.worlds.grid.core.tasks import INSTRUCTED, prize
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.grid.instructions.block import SATISFIED, WAITING
from minihuman.worlds.grid.instructions.verify import verify
from minihuman.worlds.kernels import kernel

_NO_CHANCE = np.zeros(6, np.uint64)


@kernel(brief=True)
def step_as_told(row: Row, action: int, words: Words, image: NDArray[np.uint8]) -> tuple[int, int, float]:
    """`core.rules.step` for a row that has room for an instruction."""
    status, reward = act_as_told(row, action, words)
    if status >= 0:
        see(row, image)
    return status, row[DIRECTION], reward


@kernel(brief=True)
def act_as_told(row: Row, action: int, words: Words) -> tuple[int, float]:
    """`core.rules.act` for a row that has room for an instruction."""
    if row[TASK] != INSTRUCTED:
        return act(row, action, words)
    refused = refusal(row, action)
    if refused < 0:
        return refused, 0.0
    row[STEP] += 1
    apply(row, action)
    outcome = verify(row, action)
    reward = prize(row) if outcome == SATISFIED else 0.0
    return close(row, outcome != WAITING), reward


def try_out(row: Row, action: int) -> tuple[int, float]:
    """Do an action in a copy of a state, whose obstacles stay where they are: status and reward."""
    status, reward = (act_as_told if row[TASK] == INSTRUCTED else act)(row, action, _NO_CHANCE)
    return status, reward
