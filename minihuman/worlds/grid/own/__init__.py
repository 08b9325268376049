"""Grid worlds of one's own: fields that a class declares, and rules that are translated and compiled."""

from minihuman.worlds.grid.own.fields import Bool as Bool
from minihuman.worlds.grid.own.fields import Float as Float
from minihuman.worlds.grid.own.fields import FloatArray as FloatArray
from minihuman.worlds.grid.own.fields import Int as Int
from minihuman.worlds.grid.own.fields import IntArray as IntArray
from minihuman.worlds.grid.own.fields import IntTuple as IntTuple
