"""The former module of the entry points, which data sets exported earlier name in their environment's spec."""

from minihuman.worlds.inside.entry_points import make_go_to_obj_world as make_go_to_obj, make_grid_world as make

__all__ = ["make", "make_go_to_obj"]
