"""What takes seconds to compile, in pieces that do not need each other: each is run once on next to nothing."""

import numpy as np

from minihuman.worlds.first_person.building.floor import finish
from minihuman.worlds.first_person.building.outline import rectangle
from minihuman.worlds.first_person.building.rooms import Room
from minihuman.worlds.first_person.collision import touches_wall
from minihuman.worlds.first_person.library import library
from minihuman.worlds.first_person.render.draw import visible_things
from minihuman.worlds.first_person.render.layout import lay_out
from minihuman.worlds.first_person.render.memory import size_of
from minihuman.worlds.first_person.render.project import VIEW_SIZE
from minihuman.worlds.first_person.render.scene import Camera, SceneRoom, Surface
from minihuman.worlds.first_person.render.shade import colour
from minihuman.worlds.first_person.scenery import room_tables


def walls() -> None:
    """Build a room and walk into nothing."""
    floor = finish([Room(rectangle(0.0, 1.0, 0.0, 1.0))], None)
    room_tables(floor, library(None))
    touches_wall(floor.walls, 0.5, 0.5, 0.1)


def colours() -> None:
    """Colour a picture without rows."""
    floats, wholes = size_of(0, 0, 0, 0, 0)
    nothing = np.zeros((1, 1, 3), np.uint8)
    colour(*library(None).textures, np.zeros(VIEW_SIZE), np.zeros(floats), np.zeros(wholes, np.int32), nothing)


def faces() -> None:
    """Look at a room of a single wall, without colouring it."""
    corners = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    room = SceneRoom(corners[::-1, ::2], [Surface(corners, corners[:, 1:], "concrete_1")])
    visible_things(lay_out([room], library=library(None)), Camera((-1.0, 0.5, 0.0), 0.0), 1, 1)


PIECES = walls, colours, faces
