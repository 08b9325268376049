"""How long a study's own pictures take on this machine: step, picture and flip of each block's world."""

import time
from collections.abc import Iterator
from contextlib import closing
from itertools import cycle

import numpy as np

from minihuman.study.protocol import Block, Protocol
from minihuman.study.screens import PlayScreen
from minihuman.windows.blocking import BlockingWindow
from minihuman.worlds.adapt.world import World

_STEPS = 60
_WARM = 10  # steps before any is counted
LATEST_MS = 1000 / 30  # two frames of the commonest display


def pictures_ms(window: BlockingWindow, protocol: Protocol) -> Iterator[tuple[str, float, float]]:
    """Each block's name, and the median and the 95 % of the time from a step to its picture's flip, ms.

    Raises:
        WorldError: if a world cannot be made or drawn.
    """
    for block in protocol.blocks:
        with closing(World(block.world, block.options)) as world:
            median, slow = np.percentile(_times_ms(window, block, world)[_WARM:], (50, 95))
        yield block.name, float(median), float(slow)


def _times_ms(window: BlockingWindow, block: Block, world: World) -> list[float]:
    times_ms, over, actions = [], True, cycle(block.actions)
    for number in range(_STEPS):
        if over:
            world.reset(number)
        started_ns = time.monotonic_ns()
        happened = world.step(world.action_names.index(next(actions)))
        picture = world.frame(block.view, window.picture_px, block.palette)
        flip_ns = window.show(PlayScreen(picture, "measuring this study's pictures", block.name, step=number)).flip_ns
        times_ms.append((flip_ns - started_ns) / 1e6)
        over = happened.terminated or happened.truncated
    return times_ms
