"""Delays that only the hardware knows: from the logged onset of a sound, or flip of a picture, to a recording of it.

`minihuman doctor --loopback` records its own clicks through a cable, and `--photodiode` the screen's changes through a
photodiode, both with the default sound input. What is recorded includes the input's own delay.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.display.windows.blocking_window import BlockingWindow
from minihuman.errors import DeviceError, WorldError
from minihuman.experiment.machine.inputs import SoundStarted
from minihuman.experiment.machine.screens import PlayScreen
from minihuman.experiment.sounds import SoundContent, SoundCue, encode_wav
from minihuman.runtime.devices.sound import RATE_HZ, PortAudioOutput, SoundOutput
from minihuman.runtime.devices.sound_input import Recording, SoundInput
from minihuman.runtime.finding import Finding
from minihuman.runtime.onset_analysis import (
    DelaySummary,
    compute_share_within,
    find_onsets,
    measure_delays_s,
    summarise_delays,
)

_NS_PER_S = 1_000_000_000
_NS_PER_MS = 1_000_000
_SEED = 1  # of the drawn intervals, which need only be irregular
_LEAD_NS = 500_000_000  # before the first click or change
_TAIL_S = 1.2  # recorded after the last: longer than any delay that is looked for

_CLICKS = 40
_CLICK_INTERVAL_MS = (200, 300)
_CLICK_TOLERANCE_S = 0.09
_CLICK_RISE_S = 0.002
_CLICK_S = 0.004
_CLICK_HZ = 1000
_CLICK_LEVEL = 0.5  # of full scale
_LONGEST_WAIT_NS = 2_000_000_000  # for the report of a click that was due
_POLL_S = 0.005
_LARGEST_SD_MS = 2.0
_CONNECT_CABLE = (
    "connect the headphone output to the line or microphone input with a cable, choose that input as the system's, "
    "and raise the output's volume and the input's level"
)

_CHANGES = 60
_CHANGE_INTERVAL_MS = (250, 400)
_CHANGE_TOLERANCE_S = 0.11
_CHANGE_RISE_S = 0.015
_UNKNOWN_PERIOD_MS = 1000 / 60  # assumed if the flip does not wait for the display
_CONNECT_DIODE = (
    "fix the photodiode to the middle of the screen, connect it to the sound input that is the system's, set the "
    "screen to full brightness, and raise the input's level"
)

_EARLIEST_MEDIAN_MS = -1.0  # a recording that is earlier than this was not made at the times that the input states


@dataclass(frozen=True, slots=True)
class DelayChecks:
    """The checks of delays to make, for which a cable or a photodiode must be connected."""

    loopback: bool = False
    photodiode: bool = False


NO_DELAYS = DelayChecks()


def measure_loopback() -> Iterator[Finding]:
    """Play clicks and record them through a cable; yield findings about the input and the clicks' delays."""
    click = SoundContent("click.wav", 0.0, 0.0, "both", 0.0)
    try:
        with closing(SoundInput(time.perf_counter_ns)) as sound_input:
            files = {click.source: _encode_click()}
            purpose = "clicks are to be played"
            with closing(PortAudioOutput(time.perf_counter_ns, [click], files, purpose=purpose)) as output:
                starts = _play_clicks(output, click)
                time.sleep(_TAIL_S)
                interruptions = output.interruptions
            recording = sound_input.read()
            yield Finding("sound input", sound_input.describe())
    except (DeviceError, WorldError) as error:
        yield Finding("loopback", str(error), "the delay of sounds was not measured")
        return
    yield judge_loopback(starts, recording, interruptions=interruptions)


def _encode_click() -> bytes:
    """Return a click as a WAV file; a file begins at once, while a tone and noise begin softly."""
    half_period = RATE_HZ // (2 * _CLICK_HZ)
    signs = 1 - 2 * (np.arange(round(_CLICK_S * RATE_HZ)) // half_period % 2)
    mono = (_CLICK_LEVEL * signs).astype(np.float32)
    return encode_wav(np.repeat(mono[:, None], 2, axis=1), RATE_HZ)


def _play_clicks(output: SoundOutput, click: SoundContent) -> list[SoundStarted]:
    """Play clicks at irregular intervals as a session does; return the reports of those that began.

    Raises:
        DeviceError: if the device has stopped.
    """
    starts: list[SoundStarted] = []
    due_ns = time.perf_counter_ns() + _LEAD_NS
    for number, interval_ns in enumerate(_draw_intervals_ns(_CLICKS, _CLICK_INTERVAL_MS)):
        output.follow((SoundCue(number, click, due_ns),))
        reports: Sequence[SoundStarted] = ()
        while not reports and time.perf_counter_ns() < due_ns + _LONGEST_WAIT_NS:
            time.sleep(_POLL_S)
            reports = output.read()
        starts += reports
        latest_ns = max((report.onset_ns for report in reports), default=time.perf_counter_ns())
        due_ns = max(due_ns, latest_ns) + interval_ns
    return starts


def _draw_intervals_ns(count: int, bounds_ms: tuple[int, int]) -> list[int]:
    """Return intervals in nanoseconds, drawn uniformly between two bounds in milliseconds."""
    intervals_ms = np.random.default_rng(_SEED).uniform(*bounds_ms, count)
    return [round(interval_ms * _NS_PER_MS) for interval_ms in intervals_ms]


def judge_loopback(starts: Sequence[SoundStarted], recording: Recording, *, interruptions: int = 0) -> Finding:
    """Return the finding about clicks that were played and recorded.

    Args:
        starts: the reports of the clicks that began, as a log would have them.
        recording: what the input recorded meanwhile.
        interruptions: how often the output ran out of samples.
    """
    stated_s = np.array([start.onset_ns for start in starts]) / _NS_PER_S
    recorded_s = _find_onset_times_s(recording, _CLICKS, _CLICK_RISE_S)
    delays_s = _fill_missing(measure_delays_s(stated_s, recorded_s, tolerance_s=_CLICK_TOLERANCE_S), _CLICKS)
    summary = summarise_delays(delays_s)
    clicks = f"{summary.recorded} of {_CLICKS} clicks came back"
    if 2 * summary.recorded < _CLICKS:
        remedy = f"{clicks}, and the recording reaches {100 * recording.peak:.2g} % of full scale; {_CONNECT_CABLE}"
        return Finding("loopback", remedy, f"only {clicks} through the cable")
    uncertainties_s = np.zeros(_CLICKS)
    uncertainties_s[: len(starts)] = [start.uncertainty_ns / _NS_PER_S for start in starts]
    share = compute_share_within(delays_s, uncertainties_s)
    parts = [
        clicks,
        f"{_describe_delays(summary)} after the log's onset",
        f"{100 * share:.0f} % within the stated uncertainty once the median is taken off",
        _describe_bound(summary, "output"),
        f"the output was interrupted {interruptions} times",
    ]
    problem = ""
    if summary.recorded < _CLICKS:
        problem = f"only {clicks} through the cable"
    elif summary.sd_ms > _LARGEST_SD_MS:
        problem = f"the delay of sounds varies with an SD of {summary.sd_ms:.1f} ms, over {_LARGEST_SD_MS:g}"
    return Finding("loopback", "; ".join(parts), problem)


def _describe_bound(summary: DelaySummary, device: str) -> str:
    """Return what a median delay says about the delay of a device that a log does not know."""
    if summary.median_ms < _EARLIEST_MEDIAN_MS:
        return f"the input states its times too early, so the median says nothing about the {device}'s own delay"
    return f"the median includes the input's own delay, so it is an upper bound of what the {device} adds to the log"


def _find_onset_times_s(recording: Recording, count: int, rise_s: float) -> NDArray[np.float64]:
    """Return the session's times in seconds of the transients in a recording, float64[n]."""
    return recording.find_times_s(find_onsets(recording.samples, recording.rate_hz, count=count, rise_s=rise_s))


def _fill_missing(delays_s: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return delays with NaN for each onset up to a count that was not even stated, float64[count]."""
    return np.concatenate([delays_s, np.full(count - len(delays_s), np.nan)])


def _describe_delays(summary: DelaySummary) -> str:
    """Return median, SD and largest deviation of delays as a text."""
    return (
        f"median {summary.median_ms:.1f} ms (SD {summary.sd_ms:.2f} ms, at most {summary.largest_ms:.2f} ms from the "
        "median)"
    )


@dataclass(frozen=True, slots=True)
class PictureChange:
    """A change of the whole picture, with the flip that a session would log."""

    flip_ns: int
    to_light: bool


def measure_photodiode(window: BlockingWindow) -> Iterator[Finding]:
    """Change the picture between black and white, and record a photodiode; yield findings on the input and delays."""
    try:
        with closing(SoundInput(time.perf_counter_ns)) as sound_input:
            changes = _show_changes(window)
            _wait_in_window(window, time.perf_counter_ns() + round(_TAIL_S * _NS_PER_S))
            recording = sound_input.read()
            yield Finding("photodiode input", sound_input.describe())
    except DeviceError as error:
        yield Finding("photodiode", str(error), "the delay of pictures was not measured")
        return
    yield from judge_photodiode(changes, recording, period_ms=window.refresh_period_ns / _NS_PER_MS)


def _show_changes(window: BlockingWindow) -> list[PictureChange]:
    """Show black and white pictures in turn, at irregular intervals; return the changes."""
    width, height = window.picture_px
    pictures = [np.full((height, width, 3), level, np.uint8) for level in (0, 255)]
    screens = [PlayScreen(picture, "measuring the display with a photodiode", "") for picture in pictures]
    window.show(screens[0])
    _wait_in_window(window, time.perf_counter_ns() + _LEAD_NS)
    changes = []
    for number, interval_ns in enumerate(_draw_intervals_ns(_CHANGES, _CHANGE_INTERVAL_MS)):
        to_light = number % 2 == 0
        flip_ns = window.show(screens[to_light]).flip_ns
        changes.append(PictureChange(flip_ns, to_light))
        _wait_in_window(window, flip_ns + interval_ns)
    return changes


def _wait_in_window(window: BlockingWindow, until_ns: int) -> None:
    """Wait until a time, and drop the window's inputs until then."""
    while time.perf_counter_ns() < until_ns:
        window.wait(until_ns)


def judge_photodiode(changes: Sequence[PictureChange], recording: Recording, *, period_ms: float) -> Iterator[Finding]:
    """Yield the findings about changes of the picture: of those from dark to light, and of those from light to dark.

    Args:
        changes: the changes with the flips that a log would have.
        recording: what the input recorded of the photodiode meanwhile.
        period_ms: the display's period in milliseconds; 0 if it is unknown.
    """
    stated_s = np.array([change.flip_ns for change in changes]) / _NS_PER_S
    recorded_s = _find_onset_times_s(recording, len(changes), _CHANGE_RISE_S)
    delays_s = measure_delays_s(stated_s, recorded_s, tolerance_s=_CHANGE_TOLERANCE_S)
    to_light = np.array([change.to_light for change in changes])
    for direction, is_counted in (("dark to light", to_light), ("light to dark", ~to_light)):
        summary = summarise_delays(delays_s[is_counted])
        yield _judge_direction(direction, summary, period_ms=period_ms, peak=recording.peak)


def _judge_direction(direction: str, summary: DelaySummary, *, period_ms: float, peak: float) -> Finding:
    """Return the finding about the changes in one direction; ``peak`` is the recording's, as a share of full scale."""
    name = f"photodiode {direction}"
    changes = f"{summary.recorded} of {summary.stated} changes from {direction} were seen"
    if 2 * summary.recorded < summary.stated:
        remedy = f"{changes}, and the recording reaches {100 * peak:.2g} % of full scale; {_CONNECT_DIODE}"
        return Finding(name, remedy, f"only {changes}")
    half_frame_ms = (period_ms or _UNKNOWN_PERIOD_MS) / 2
    assumed = "" if period_ms else ", as the display's period is unknown and 60 Hz are assumed"
    limit = f"half a frame is {half_frame_ms:.1f} ms{assumed}"
    delays = f"{_describe_delays(summary)} after the logged flip"
    problem = ""
    if summary.recorded < summary.stated:
        problem = f"only {changes}"
    elif summary.sd_ms > half_frame_ms:
        problem = f"the delay from {direction} varies with an SD of {summary.sd_ms:.1f} ms, over half a frame"
    return Finding(name, f"{changes}; {delays}; {_describe_bound(summary, 'display')}; {limit}", problem)
