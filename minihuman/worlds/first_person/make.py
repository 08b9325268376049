"""The former module of the entry point, which data sets exported earlier name in their environment's spec."""

from minihuman.worlds.first_person.batch import make_world as make

__all__ = ["make"]
