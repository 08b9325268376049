"""The parameters of a world that can vary per episode or step: step length, turn, camera and light.

`forward_step` is the length of a step in metres. Random values are computed by arithmetic that is the same on every
machine. NumPy's `Generator.uniform` may fuse the multiplication and the addition where the processor can; the functions
here never do.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.options import MAX_METRES, check_number


def uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a random number in [low, high)."""
    return low + (high - low) * rng.random()


def weighted(rng: np.random.Generator, cumulative: Sequence[float]) -> int:
    """Return a random index drawn by weights, whose running sum, ending at 1, is ``cumulative``."""
    return bisect_right(cumulative, rng.random())


def running_sum(weights: Sequence[float]) -> tuple[float, ...]:
    """Return the running sum of weights, scaled to end at 1 and rounded like that of ``Generator.choice``."""
    shares = np.array(weights, dtype=float)
    sums = np.cumsum(shares / np.sum(shares))
    return tuple((sums / sums[-1]).tolist())


Value = float | tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter's default, and the range of its uniform distribution when a world is randomised."""

    default: Value
    low: Value
    high: Value

    def __post_init__(self) -> None:
        values = (self.low, self.default, self.high)
        low, default, high = (value if isinstance(value, tuple) else (value,) for value in values)
        has_one_length = len(low) == len(default) == len(high)
        if not has_one_length or not all(a <= b <= c for a, b, c in zip(low, default, high, strict=True)):
            raise WorldError(f"{self!r} must have low <= default <= high, all of the same length")

    def sample(self, rng: np.random.Generator | None) -> Value:
        """Return a random value from the range, or the default without a random stream."""
        if rng is None:
            return self.default
        match self.low, self.high:
            case tuple() as low, tuple() as high:
                return uniform(rng, low[0], high[0]), uniform(rng, low[1], high[1]), uniform(rng, low[2], high[2])
            case low, high:
                assert not isinstance(low, tuple)
                assert not isinstance(high, tuple)
                return uniform(rng, low, high)


class Parameters:
    """An immutable table of parameters by name.

    Raises:
        WorldError: if a value is outside the parameter's `LIMITS`.
    """

    __slots__ = ("_table",)

    def __init__(self, table: Mapping[str, Parameter]) -> None:
        self._table = dict(table)
        for name, parameter in self._table.items():
            for value in (parameter.low, parameter.default, parameter.high):
                for component in value if isinstance(value, tuple) else (value,):
                    check_number(f"parameters.{name}", component, *LIMITS[name])

    def __getitem__(self, name: str) -> Parameter:
        try:
            return self._table[name]
        except KeyError:
            raise WorldError(f"unknown parameter {name!r}; use one of {', '.join(self._table)}") from None

    def __deepcopy__(self, memo: dict[int, object]) -> "Parameters":
        return self

    def fixed(self, **defaults: Value) -> "Parameters":
        """Return a copy without variation and with some new defaults, as in ``DEFAULTS.fixed(forward_step=0.7)``.

        Raises:
            WorldError: if there is no such parameter, or a default is invalid.
        """
        self._check_names(defaults)
        table = {name: Parameter(p.default, p.default, p.default) for name, p in self._table.items()}
        for name, default in defaults.items():
            fixed_value = tuple(default) if isinstance(default, list) else default
            table[name] = Parameter(fixed_value, fixed_value, fixed_value)
        return Parameters(table)

    def varied(self, **ranges: Parameter) -> "Parameters":
        """Return a copy with some new parameters, as in ``DEFAULTS.varied(turn_step=Parameter(30, 20, 40))``.

        Raises:
            WorldError: if there is no such parameter, or one is invalid.
        """
        self._check_names(ranges)
        return Parameters(self._table | ranges)

    def _check_names(self, names: Iterable[str]) -> None:
        for name in names:
            _ = self[name]  # raises an error if there is no such parameter

    def number(self, name: str, rng: np.random.Generator | None) -> float:
        """Return a sampled value of a parameter that is one number, or its default without a random stream."""
        value = self[name].sample(rng)
        assert not isinstance(value, tuple), name
        return value

    def triple(self, name: str, rng: np.random.Generator | None) -> tuple[float, float, float]:
        """Return a sampled value of a parameter that is three numbers, or its default without a random stream."""
        value = self[name].sample(rng)
        assert isinstance(value, tuple), name
        return value

    def largest(self, name: str) -> float:
        """Return the upper end of the range of a parameter that is one number."""
        value = self[name].high
        assert not isinstance(value, tuple), name
        return value


LIMITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        **dict.fromkeys(("sky_color", "light_color", "light_ambient"), (0, 10)),
        "light_pos": (-1e6, 1e6),
        "obj_color_bias": (-1, 1),
        "forward_step": (0.001, MAX_METRES),
        "forward_drift": (-MAX_METRES, MAX_METRES),
        "turn_step": (0.1, 360),
        "bot_radius": (0.001, 100),
        "cam_pitch": (-80, 80),
        "cam_fov_y": (5, 170),
        "cam_height": (0, MAX_METRES),
        "cam_fwd_disp": (-10, 10),
    }
)

# Colours are red, green, blue from 0 to 1; lengths metres; angles degrees. The numbers are Miniworld's.
DEFAULTS = Parameters(
    {
        "sky_color": Parameter((0.25, 0.82, 1.0), (0.1, 0.1, 0.1), (1.0, 1.0, 1.0)),
        "light_pos": Parameter((0.0, 2.5, 0.0), (-40.0, 2.5, -40.0), (40.0, 5.0, 40.0)),
        "light_color": Parameter((0.7, 0.7, 0.7), (0.45, 0.45, 0.45), (0.8, 0.8, 0.8)),
        "light_ambient": Parameter((0.45, 0.45, 0.45), (0.35, 0.35, 0.35), (0.55, 0.55, 0.55)),
        "obj_color_bias": Parameter((0.0, 0.0, 0.0), (-0.2, -0.2, -0.2), (0.2, 0.2, 0.2)),
        "forward_step": Parameter(0.15, 0.12, 0.17),
        "forward_drift": Parameter(0.0, -0.05, 0.05),
        "turn_step": Parameter(15.0, 10.0, 20.0),
        "bot_radius": Parameter(0.4, 0.38, 0.42),
        "cam_pitch": Parameter(0.0, -5.0, 5.0),
        "cam_fov_y": Parameter(60.0, 55.0, 65.0),
        "cam_height": Parameter(1.5, 1.45, 1.55),
        "cam_fwd_disp": Parameter(0.0, -0.05, 0.10),
    }
)


def fix_parameters(parameters: Parameters | Mapping[str, Value]) -> Parameters:
    """Return a world's parameters: as they are, or the defaults with some fixed values."""
    if isinstance(parameters, Parameters):
        return parameters
    return DEFAULTS.fixed(**parameters)
