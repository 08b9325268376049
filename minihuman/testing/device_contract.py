"""Contract test of devices: samples on the session's clock, in order, of the declared shape; reads never wait."""

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

from minihuman.runtime.devices.device import POLL_INTERVAL_S, Device, DeviceSample, make_device
from minihuman.runtime.machine import SessionClock
from minihuman.testing.checks import require

MAX_READ_S = 1.0  # a device is polled fifty times per second; a read that takes this long waits for something


def check_device(
    device: str | Callable[[], Device], *, n_channels: int = 0, n_samples: int = 1, timeout_s: float = 10.0
) -> None:
    """Open a device, read it as a session does, close it, and do so again: a study has more than one session.

    Args:
        device: the device as a protocol names it ("lsl:EyeTracker"), or what makes one.
        n_channels: how many numbers a sample has; 0 for a device that gives only text.
        n_samples: how many samples to read each time.
        timeout_s: how long to wait for them.

    Raises:
        ContractError: if a guarantee is broken; it says which.
        DeviceError: if the device is not there or cannot be used.
    """
    for _ in range(2):
        made = make_device(device) if isinstance(device, str) else device()
        require(isinstance(made, Device), f"{type(made).__name__} is not a minihuman.ext.Device")
        clock = SessionClock()
        facts = made.open(clock)
        try:
            require(
                isinstance(facts, dict) and all(isinstance(text, str) for pair in facts.items() for text in pair),
                f"open() returned {facts!r}; the log takes a dict of texts",
            )
            samples = _read_samples(made, clock, n_samples, timeout_s)
        finally:
            made.close()
        for sample in samples:
            _check_shape(sample, n_channels)


def _read_samples(device: Device, clock: SessionClock, n_samples: int, timeout_s: float) -> list[DeviceSample]:
    """Read from another thread than the one that opened the device, as a session does."""
    samples: list[DeviceSample] = []
    until_s = time.monotonic() + timeout_s
    with ThreadPoolExecutor(1) as thread:
        while len(samples) < n_samples and time.monotonic() < until_s:
            began_s = time.monotonic()
            fresh = thread.submit(device.read).result()
            took_s = time.monotonic() - began_s
            require(took_s < MAX_READ_S, f"read() took {took_s:.1f} s; it returns what has arrived and never waits")
            _check_times([*samples[-1:], *fresh], clock())
            samples += fresh
            time.sleep(POLL_INTERVAL_S)
    require(len(samples) >= n_samples, f"{len(samples)} of {n_samples} samples arrived within {timeout_s:g} s")
    return samples


def _check_times(samples: Sequence[DeviceSample], now_ns: int) -> None:
    for sample in samples:
        require(
            isinstance(sample, DeviceSample), f"read() returned {sample!r}, which is not a minihuman.ext.DeviceSample"
        )
        require(isinstance(sample.t_ns, int), f"t_ns is {sample.t_ns!r}; a time is an integer, ns")
        require(
            sample.t_ns <= now_ns,
            f"a sample of {sample.t_ns} ns was read at {now_ns} ns; its time is the session clock's",
        )
    for before, after in pairwise(samples):
        require(
            before.t_ns <= after.t_ns,
            f"{after.t_ns} ns follows {before.t_ns} ns; the oldest is first",
        )


def _check_shape(sample: DeviceSample, n_channels: int) -> None:
    values = sample.values
    require(
        isinstance(values, tuple) and all(isinstance(value, int | float) for value in values),
        f"values is {values!r}; it is a tuple of numbers, {math.nan} where a channel has none",
    )
    require(
        len(values) == n_channels or (not values and bool(sample.text)),
        f"a sample has {len(values)} values for {n_channels} channels",
    )
    require(isinstance(sample.text, str), f"text is {sample.text!r}, which is not text")
