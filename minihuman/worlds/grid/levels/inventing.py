"""Levels that can say anything: the whole language about a house. Options are named as Minigrid names them."""

from collections.abc import Sequence

from minihuman.worlds.grid.levels.going import MOST_THINGS
from minihuman.worlds.grid.levels.level import level
from minihuman.worlds.grid.levels.tracing import House
from minihuman.worlds.options import one_of, whole


@level()
def level_gen(
    house: House,
    num_dists: int = 18,
    locked_room_prob: float = 0.5,
    locations: bool = True,
    unblocking: bool = True,
    implicit_unlock: bool = True,
    action_kinds: Sequence[str] = ("goto", "pickup", "open", "putnext"),
    instr_kinds: Sequence[str] = ("action", "and", "seq"),
) -> None:
    """A house with a locked room or without, and any instruction."""
    for name, value in (("locations", locations), ("unblocking", unblocking), ("implicit_unlock", implicit_unlock)):
        one_of(name, value, (True, False))
    locked = house.maybe_locked_room(locked_room_prob)
    house.connect_all()
    house.things(whole("num_dists", num_dists, 0, MOST_THINGS))
    house.place_agent(not_in=locked)
    if not unblocking:
        house.require_reachable()
    house.keys_matter = unblocking
    house.invent(action_kinds, instr_kinds, places=locations, implicit_unlock=implicit_unlock, locked_room=locked)
