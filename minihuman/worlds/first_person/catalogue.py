"""The table of first-person worlds."""

from minihuman.worlds.entry import Entry

ENTRIES: tuple[Entry, ...] = ()
