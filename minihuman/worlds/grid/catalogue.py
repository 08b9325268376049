"""The table of grid worlds."""

from minihuman.worlds.entry import Entry

ENTRIES: tuple[Entry, ...] = ()
