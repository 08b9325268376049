"""What of a layout can be walked, and in which order its cells come up for the start and the goal.

Minigrid keeps the largest connected part in a networkx graph and draws two of its nodes. Their order is the layout's
own unless the part is smaller than half of the free cells: then networkx walks through a Python set, whose order
depends on the order in which it was filled. The same sets are filled in the same order here.
"""

from collections.abc import Iterable

Cell = tuple[int, int]


def largest_part(free: list[Cell]) -> list[Cell]:
    """The largest connected part of two cells or more, the first of several; empty if there is none.

    Args:
        free: The free cells in the layout's order.
    """
    unseen = dict.fromkeys(free)
    largest: set[Cell] = set()
    seen = 0
    for cell in free:
        if cell in unseen:
            part = _reached(cell, unseen, len(free) - seen)
            seen += len(part)
            for each in part:
                del unseen[each]
            if len(part) > max(1, len(largest)):
                largest = part
    return _in_order(_in_order(largest, free), free)


def _reached(source: Cell, unseen: dict[Cell, None], at_most: int) -> set[Cell]:
    """The cells that can be reached, breadth first: up, left, down and right of each."""
    reached = {source}
    level = [source]
    while level:
        this, level = level, []
        for x, y in this:
            for cell in ((x - 1, y), (x, y - 1), (x + 1, y), (x, y + 1)):
                if cell in unseen and cell not in reached:
                    reached.add(cell)
                    level.append(cell)
            if len(reached) == at_most:
                return reached
    return reached


def _in_order(cells: Iterable[Cell], free: list[Cell]) -> list[Cell]:
    chosen = set(iter(cells))
    return list(chosen) if 2 * len(chosen) < len(free) else [cell for cell in free if cell in chosen]
