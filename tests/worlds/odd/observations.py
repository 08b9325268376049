"""Odd in observations and their spaces."""

from collections import OrderedDict
from typing import Any

import numpy as np
from gymnasium import spaces

from tests.worlds.odd.plain import Plain, odd

NO_PLAIN_FORM = "space .* export as csv or parquet"
NOT_IN_SPACE = "and its space.*export as csv or parquet"


class Observing(Plain):
    """A plain environment with another space."""

    space: Any = None

    def __init__(self, render_mode=None):
        super().__init__(render_mode)
        self.observation_space = self.space


@odd(noticed=r"the observation\[1\] is 51, and its space holds 0 to 50")
class ObservationTooHigh(Plain):
    def observe(self):
        return np.array([self.place, self.count + 50], np.float32)


@odd(noticed=r"the observation is of type float64, and its space is of float32")
class ObservationFloat64(Plain):
    def observe(self):
        return super().observe().astype(np.float64)


@odd()
class ObservationList(Plain):
    def observe(self):
        return super().observe().tolist()


@odd(noticed=r"of shape \(1, 2\)", unexportable=NOT_IN_SPACE)
class ObservationOtherShape(Plain):
    def observe(self):
        return super().observe()[None]


@odd(noticed=r"of shape \(3,\)", unexportable=NOT_IN_SPACE)
class ObservationGrows(Plain):
    def observe(self):
        return np.zeros(3 if self.count == 5 else 2, np.float32)


@odd(noticed=r"is nothing \(None\)", unexportable=NOT_IN_SPACE)
class ObservationNone(Plain):
    def observe(self):
        return None


@odd(noticed=r"is nan, and its space holds")
class ObservationNaN(Plain):
    def observe(self):
        return np.array([np.nan, self.count], np.float32)


@odd(unexportable="beyond float32; export as minari or imitation")
class ObservationUnbounded(Observing):
    space = spaces.Box(-np.inf, np.inf, (2,), np.float64)

    def observe(self):
        return np.array([np.inf, -1e300 * self.count])


@odd()
class ObservationZeroDimensional(Observing):
    space = spaces.Box(0, 50, (), np.float32)

    def observe(self):
        return np.array(self.count, np.float32)


@odd(unexportable="has no numbers")
class ObservationEmpty(Observing):
    space = spaces.Box(0, 1, (0,), np.float32)

    def observe(self):
        return np.zeros(0, np.float32)


@odd()
class ObservationOfPixels(Observing):
    space = spaces.Box(0, 255, (40, 48, 3), np.uint8)

    def observe(self):
        return self.render()


@odd(noticed="changes size|of shape", unexportable="shape|size")
class ObservationOfPixelsGrows(ObservationOfPixels):
    def observe(self):
        picture = self.render()
        return picture.repeat(2, axis=0) if self.count == 3 else picture


@odd()
class ObservationOneBuffer(Plain):
    def observe(self):
        self.buffer = getattr(self, "buffer", np.zeros(2, np.float32))
        self.buffer[:] = self.place, self.count
        return self.buffer


@odd()
class ObservationDiscrete(Observing):
    space = spaces.Discrete(5)

    def observe(self):
        return self.place


@odd(noticed=r"is 7, and its space holds 0 to 4", unexportable=NOT_IN_SPACE)
class ObservationDiscreteOutside(ObservationDiscrete):
    def observe(self):
        return 7 if self.count == 3 else self.place


@odd()
class ObservationDiscreteNegative(Observing):
    space = spaces.Discrete(5, start=-2)

    def observe(self):
        return np.int64(self.place - 2)


@odd(noticed="a whole number", unexportable="a whole number")
class ObservationDiscreteFloat(ObservationDiscrete):
    def observe(self):
        return float(self.place)


@odd()
class ObservationMultiDiscrete(Observing):
    space = spaces.MultiDiscrete([[5, 60], [5, 60]])

    def observe(self):
        return np.array([[self.place, self.count]] * 2)


@odd()
class ObservationMultiBinary(Observing):
    space = spaces.MultiBinary((2, 5))

    def observe(self):
        return np.eye(5, dtype=np.int8)[[self.place, self.place]]


@odd(unexportable="has no numbers")
class ObservationText(Observing):
    space = spaces.Text(20)

    def observe(self):
        return f"place{self.place}"


@odd(noticed="which .* does not hold", unexportable="has no numbers")
class ObservationTextUnicode(ObservationText):
    def observe(self):
        return f"Ort {self.place}: жёлтый 👩‍👩‍👧"


@odd(r"is text with half a character")
class ObservationSurrogate(ObservationText):
    def observe(self):
        return "half \ud83d"


@odd()
class ObservationNested(Observing):
    space = spaces.Dict(
        {
            "b": spaces.Dict({"z": spaces.Discrete(5), "a": spaces.Box(0, 1, (1,))}),
            "a": spaces.Tuple([spaces.Discrete(60)]),
        }
    )

    def observe(self):
        return {"a": (self.count,), "b": {"a": np.ones(1, np.float32), "z": self.place}}


@odd()
class ObservationOrdered(Observing):
    space = spaces.Dict({"place": spaces.Discrete(5), "count": spaces.Discrete(60)})

    def observe(self):
        return OrderedDict(count=self.count, place=self.place)


@odd(noticed=r"has no 'count', which its space has", unexportable="has no 'count'")
class ObservationMissingKey(ObservationOrdered):
    def observe(self):
        return {"place": self.place}


@odd(noticed=r"has 'more', which its space has not", unexportable="has 'more'")
class ObservationAddedKey(ObservationOrdered):
    def observe(self):
        return {"place": self.place, "count": self.count, "more": 1}


@odd(unexportable="part 0 cannot be named in HDF5")
class ObservationNumberedKeys(Observing):
    space = spaces.Dict({0: spaces.Discrete(5), 1: spaces.Discrete(60)})

    def observe(self):
        return {0: self.place, 1: self.count}


@odd(r"has keys that are not all text")
class ObservationMixedKeys(Observing):
    space = spaces.Dict({0: spaces.Discrete(5), "one": spaces.Discrete(60)})

    def observe(self):
        return {0: self.place, "one": self.count}


@odd(unexportable="part 'agent/place' cannot be named in HDF5")
class ObservationSlashKey(Observing):
    space = spaces.Dict({"agent/place": spaces.Discrete(5), "agent": spaces.Discrete(60)})

    def observe(self):
        return {"agent/place": self.place, "agent": self.count}


@odd(unexportable=NO_PLAIN_FORM)
class ObservationSequence(Observing):
    space = spaces.Sequence(spaces.Discrete(60))

    def observe(self):
        return tuple(range(self.count))


@odd(unexportable=NO_PLAIN_FORM)
class ObservationGraph(Observing):
    space = spaces.Graph(spaces.Box(0, 1, (1,)), None)

    def observe(self):
        return spaces.GraphInstance(np.ones((2, 1), np.float32), None, None)


@odd(unexportable=NO_PLAIN_FORM)
class ObservationOneOf(Observing):
    space = spaces.OneOf([spaces.Discrete(5), spaces.Discrete(60)])

    def observe(self):
        return (np.int64(0), np.int64(self.place))


@odd(r"the observation is an object of the class set, which a log cannot hash")
class ObservationSet(Plain):
    def observe(self):
        return {self.place}


@odd(r"the observation is an array of Python objects")
class ObservationObjects(Plain):
    def observe(self):
        return np.array([self, None])


@odd(r"the observation contains itself|calls itself without end")
class ObservationOfItself(Plain):
    def observe(self):
        whole = []
        whole.append(whole)
        return whole


@odd(r"its observation_space is nothing \(None\)")
class SpaceNone(Observing):
    space = None


@odd(r"its observation_space is a tuple of 2 values")
class SpaceTuple(Observing):
    space = (2, 3)


@odd()
class SpaceChanges(Plain):
    def reset(self, **options):
        self.observation_space = spaces.Box(0, 60, (2,), np.float32)
        return super().reset(**options)


@odd()
class MissionChanges(Plain):
    mission = "go"

    def move(self, action):
        super().move(action)
        self.mission = f"go to {self.place}"


@odd()
class MissionIsNoText(Plain):
    mission = 7


@odd(r"mission raised KeyError")
class MissionRaises(Plain):
    @property
    def mission(self):
        raise KeyError("mission")
