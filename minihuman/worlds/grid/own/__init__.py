"""Grid worlds of one's own: fields that a class declares, and rules that are translated and compiled."""

from minihuman.worlds.grid.own.fields import (
    Bool as Bool,
    Float as Float,
    FloatArray as FloatArray,
    Int as Int,
    IntArray as IntArray,
    IntTuple as IntTuple,
)
