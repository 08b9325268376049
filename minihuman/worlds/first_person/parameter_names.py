"""A world's parameters by Miniworld's names, for a world's attribute `params` and the argument `params` of `make`."""

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
    """A parameter in Miniworld's form: numbers, or arrays of three."""

    default: Any
    min: Any
    max: Any
    type: str = "float"


class ParameterNames:
    """A table of parameters with Miniworld's methods; a changed parameter of a world takes effect with its next step.

    Args:
        table: the parameters
        change: a function that receives the new table when a parameter is set; None for a table without a world
    """

    def __init__(self, table: Parameters, change: Callable[[Parameters], None] | None = None) -> None:
        self.table = table
        self._change = change

    @property
    def params(self) -> dict[str, ParameterRange]:
        """Return a copy of all parameters by name."""
        return {name: _show_parameter(self.table[name]) for name in PARAMETER_NAMES}

    def copy(self) -> "ParameterNames":
        """Return a copy of the table that belongs to no world."""
        return ParameterNames(self.table)

    def no_random(self) -> "ParameterNames":
        """Return a copy of the table that belongs to no world and in which nothing varies."""
        return ParameterNames(self.table.fixed())

    def set(
        self,
        name: str,
        default: ArrayLike,
        min: ArrayLike | None = None,
        max: ArrayLike | None = None,
        type: str = "float",
    ) -> None:
        """Set a parameter's default and the range from which it is drawn; without a range, it does not vary.

        Raises:
            WorldError: if there is no such parameter, or its numbers are invalid.
        """
        if type != "float":
            raise WorldError(f"the type of {name} is {type!r}; every parameter is a 'float'")
        low = default if min is None else min
        high = default if max is None else max
        self.table = self.table.varied(
            **{name: Parameter(_convert_value(default), _convert_value(low), _convert_value(high))}
        )
        if self._change is not None:
            self._change(self.table)

    def get_max(self, name: str) -> Any:
        """Return the upper end of a parameter's range."""
        return _show_parameter(self.table[name]).max

    def sample(self, rng: np.random.Generator | None, name: str) -> Any:
        """Return a value from the range, drawn as Miniworld does, or the default without a random stream."""
        value = self.table[name].sample(rng)
        if isinstance(value, tuple):
            return np.array(value)
        return value

    def sample_many(self, rng: np.random.Generator | None, target_obj: Any, param_names: list[str]) -> None:
        """Set attributes of an object to sampled values of the parameters with the same names."""
        for name in param_names:
            setattr(target_obj, name, self.sample(rng, name))


def read_parameters(params: Any) -> Parameters:
    """Return the parameters in a table of Miniworld's or our form.

    Raises:
        WorldError: if the table has neither form.
    """
    if isinstance(params, ParameterNames):
        return params.table
    ranges = getattr(params, "params", None)
    if not isinstance(ranges, dict):
        raise WorldError(f"params is {params!r}; give what env.unwrapped.params is, or parameters=...")
    table = {name: Parameter(*map(_convert_value, (r.default, r.min, r.max))) for name, r in ranges.items()}
    return Parameters(table)


def _convert_value(number: ArrayLike) -> Value:
    """Return a number as a float, or an array of three as a tuple of floats."""
    numbers = np.asarray(number, np.float64).tolist()
    if not isinstance(numbers, list):
        return float(numbers)
    red, green, blue = numbers
    return red, green, blue


def _show_parameter(parameter: Parameter) -> ParameterRange:
    """Return a parameter in Miniworld's form."""
    values = parameter.default, parameter.low, parameter.high
    default, low, high = (np.array(value) if isinstance(value, tuple) else value for value in values)
    return ParameterRange(default, low, high)
