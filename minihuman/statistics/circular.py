"""Statistics of angles, which a mean of numbers misleads: 359 and 1 degrees have the mean direction 0.

Source: N. I. Fisher, Statistical Analysis of Circular Data (1993), section 2.3.
"""

import numpy as np
from numpy.typing import ArrayLike

_ROUNDING = 1e-12  # a shorter mean vector has no direction


def find_mean_direction_deg(angles_deg: ArrayLike) -> float:
    """Return the direction of the sum of unit vectors, in degrees from -180 to 180; NaN if the sum is 0 or empty."""
    mean_vector = _average_vectors(angles_deg)
    if not abs(mean_vector) > _ROUNDING:  # also if it is NaN
        return float("nan")
    return float(np.degrees(np.angle(mean_vector)))


def find_resultant_length(angles_deg: ArrayLike) -> float:
    """Return the length of the mean of unit vectors: 1 for equal angles, 0 if they cancel, NaN without angles."""
    return float(abs(_average_vectors(angles_deg)))


def _average_vectors(angles_deg: ArrayLike) -> complex:
    """Return the mean of the unit vectors in these directions as a complex number; NaN without angles."""
    angles_rad = np.radians(np.asarray(angles_deg, np.float64))
    if not angles_rad.size:
        return complex("nan")
    return complex(np.exp(1j * angles_rad).mean())
