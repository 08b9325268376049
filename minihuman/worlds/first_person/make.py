"""The entry point's former place: data sets that were exported earlier name it in their environment's spec."""

from minihuman.worlds.first_person.batch import make_world as make

__all__ = ["make"]
