"""The table of every world of ours, registered with Gymnasium."""

from minihuman.worlds.entry import Entry
from minihuman.worlds.first_person.catalogue import ENTRIES as FIRST_PERSON
from minihuman.worlds.grid.catalogue import ENTRIES as GRID
from minihuman.worlds.grid.levels.catalogue import ENTRIES as LEVELS

ENTRIES: tuple[Entry, ...] = GRID + LEVELS + FIRST_PERSON


def register() -> None:
    """Register every world; registering again changes nothing."""
    import gymnasium

    for entry in ENTRIES:
        if entry.id not in gymnasium.registry:
            gymnasium.register(
                entry.id,
                entry_point=entry.entry_point,
                vector_entry_point=entry.vector_entry_point,
                kwargs=entry.kwargs,
                order_enforce=not entry.guards_itself,
                disable_env_checker=entry.guards_itself,
            )
