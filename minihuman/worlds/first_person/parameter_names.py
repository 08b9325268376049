"""A world's parameters by Miniworld's names: what `params` of a world is, and what `params=` of `make` takes."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from minihuman.errors import WorldError
from minihuman.worlds.first_person.parameters import Parameter, Parameters, Value

PARAMETER_NAMES = (
    *("sky_color", "light_pos", "light_color", "light_ambient", "obj_color_bias", "forward_step", "forward_drift"),
    *("turn_step", "bot_radius", "cam_pitch", "cam_fov_y", "cam_height", "cam_fwd_disp"),
)


class ParameterRange(NamedTuple):
    """A parameter as Miniworld shows it: numbers, or arrays of three."""

    default: Any
    min: Any
    max: Any
    type: str = "float"


class ParameterNames:
    """A table of parameters with Miniworld's methods; setting one of a world's counts from its next step on.

    Args:
        table: The parameters.
        change: Told the new table when one is set; None for a table of no world.
    """

    def __init__(self, table: Parameters, change: Callable[[Parameters], None] | None = None) -> None:
        self.table = table
        self._change = change

    @property
    def params(self) -> dict[str, ParameterRange]:
        """Return every parameter by name; a copy."""
        return {name: _shown(self.table[name]) for name in PARAMETER_NAMES}

    def copy(self) -> "ParameterNames":
        """Return a table of no world."""
        return ParameterNames(self.table)

    def no_random(self) -> "ParameterNames":
        """Return a table of no world in which nothing varies."""
        return ParameterNames(self.table.fixed())

    def set(
        self,
        name: str,
        default: ArrayLike,
        min: ArrayLike | None = None,
        max: ArrayLike | None = None,
        type: str = "float",
    ) -> None:
        """Set a parameter's default and the range it is drawn from; without a range it does not vary.

        Raises:
            WorldError: if there is no such parameter, or its numbers are out of range.
        """
        if type != "float":
            raise WorldError(f"the type of {name} is {type!r}; every parameter is a 'float'")
        low = default if min is None else min
        high = default if max is None else max
        self.table = self.table.varied(**{name: Parameter(_value(default), _value(low), _value(high))})
        if self._change is not None:
            self._change(self.table)

    def get_max(self, name: str) -> Any:
        """Return the upper end of a parameter's range."""
        return _shown(self.table[name]).max

    def sample(self, rng: np.random.Generator | None, name: str) -> Any:
        """Return a value of the range, drawn as Miniworld draws it, or the default without a stream."""
        value = self.table[name].sample(rng)
        if isinstance(value, tuple):
            return np.array(value)
        return value

    def sample_many(self, rng: np.random.Generator | None, target_obj: Any, param_names: list[str]) -> None:
        """Set attributes of an object to values of parameters of the same names."""
        for name in param_names:
            setattr(target_obj, name, self.sample(rng, name))


def read_parameters(params: Any) -> Parameters:
    """Return the table of what Miniworld's `params` or ours is.

    Raises:
        WorldError: if it is neither.
    """
    if isinstance(params, ParameterNames):
        return params.table
    ranges = getattr(params, "params", None)
    if not isinstance(ranges, dict):
        raise WorldError(f"params is {params!r}; give what env.unwrapped.params is, or parameters=...")
    table = {name: Parameter(*map(_value, (r.default, r.min, r.max))) for name, r in ranges.items()}
    return Parameters(table)


def _value(number: ArrayLike) -> Value:
    numbers = np.asarray(number, np.float64).tolist()
    if not isinstance(numbers, list):
        return float(numbers)
    red, green, blue = numbers
    return red, green, blue


def _shown(parameter: Parameter) -> ParameterRange:
    values = parameter.default, parameter.low, parameter.high
    default, low, high = (np.array(value) if isinstance(value, tuple) else value for value in values)
    return ParameterRange(default, low, high)
