"""Recordings made of numbers: clicks and edges at given times, with noise, as an input would record them."""

import numpy as np
from numpy.typing import NDArray

from minihuman.runtime.devices.sound_input import Recording, fit_offsets_s

RATE_HZ = 48_000
_TAIL_S = 0.5
_BUFFER = 480  # samples


def draw_times_s(count: int, bounds_s: tuple[float, float]) -> NDArray[np.float64]:
    """Return times at irregular intervals, the first after 0.5 s."""
    return 0.5 + np.cumsum(np.random.default_rng(7).uniform(*bounds_s, count))


def add_clicks(times_s: NDArray[np.float64], *, level: float = 0.3, noise: float = 0.0) -> NDArray[np.float32]:
    """Return a recording of clicks of 4 ms, which are loud at once."""
    samples = _make_noise(times_s, noise)
    click = level * (1.0 - 2 * (np.arange(192) // 24 % 2))
    for time_s in times_s:
        first = round(time_s * RATE_HZ)
        samples[first : first + len(click)] += click
    return samples.astype(np.float32)


def add_edges(
    times_s: NDArray[np.float64], *, fade_s: float, rise_s: float = 0.0, level: float = 0.3, noise: float = 0.0
) -> NDArray[np.float32]:
    """Return a recording of edges, up and down in turn, that rise linearly and fade as behind an AC-coupled input."""
    samples = _make_noise(times_s, noise)
    for number, time_s in enumerate(times_s):
        first = round(time_s * RATE_HZ)
        after_s = np.arange(len(samples) - first) / RATE_HZ
        shape = np.minimum(1.0, after_s / rise_s) if rise_s else np.ones(len(after_s))
        samples[first:] += level * (-1) ** number * shape * np.exp(-after_s / fade_s)
    return samples.astype(np.float32)


def record(
    samples: NDArray[np.float32], *, drift: float = 0.0, jitter_s: float = 0.0, lost_s: tuple[float, float] = (0, 0)
) -> Recording:
    """Return samples as an input records them whose clock is slow by a share, and whose stated times jitter.

    ``lost_s`` says after how much, and for how long, the device takes no samples: those after it are stated later.
    """
    first_frames = np.arange(0, len(samples), _BUFFER)
    taken_s = first_frames / RATE_HZ * (1 + drift)
    taken_s += np.random.default_rng(5).exponential(jitter_s, len(taken_s)) if jitter_s else 0.0
    taken_s[first_frames >= lost_s[0] * RATE_HZ] += lost_s[1]
    return Recording(samples, RATE_HZ, first_frames, fit_offsets_s(first_frames, taken_s, RATE_HZ))


def _make_noise(times_s: NDArray[np.float64], noise: float) -> NDArray[np.float64]:
    return np.random.default_rng(11).normal(0.0, noise, round((times_s[-1] + _TAIL_S) * RATE_HZ))
