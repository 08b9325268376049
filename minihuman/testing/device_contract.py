"""Contract tests of devices and windows.

A device gives samples on the session's clock, in order, of the declared shape, and reading it never waits. A window
shows screens; keys arrive in order, none is lost, and waiting ends on time.
"""

import abc
import getpass
import math
import platform
import random
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from minihuman.display.windows.window import Window
from minihuman.experiment.keys import DIGITS
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.runtime.devices.device import POLL_INTERVAL_S, Device, DeviceSample, make_device
from minihuman.runtime.machine import SessionClock
from minihuman.testing.checks import require

MAX_READ_S = 1.0  # a device is polled fifty times per second; a read that takes this long waits for something


def _is_dict_of_texts(facts: object) -> bool:
    if not isinstance(facts, dict):
        return False
    return all(isinstance(name, str) and isinstance(fact, str) for name, fact in facts.items())


def check_device(
    device: str | Callable[[], Device],
    *,
    n_channels: int = 0,
    n_samples: int = 1,
    timeout_s: float = 10.0,
    now_s: Callable[[], float] = time.monotonic,
) -> None:
    """Open a device, read it as a session does, and close it, twice, because a study has more than one session.

    Args:
        device: the device as a protocol names it ("lsl:EyeTracker"), or a function that makes one.
        n_channels: the number of values per sample; 0 for a device that gives only text.
        n_samples: the number of samples to read each time.
        timeout_s: how long to wait for the samples, in seconds.
        now_s: the clock that times this check and each read, in seconds.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        DeviceError: if the device is not there or cannot be used.
    """
    for _ in range(2):
        opened = make_device(device) if isinstance(device, str) else device()
        require(isinstance(opened, Device), f"{type(opened).__name__} is not a minihuman.ext.Device")
        clock = SessionClock()
        facts = opened.open(clock)
        try:
            require(_is_dict_of_texts(facts), f"open() returned {facts!r}; the log takes a dict of texts")
            samples = _read_samples(opened, clock, n_samples, timeout_s, now_s)
        finally:
            opened.close()
        for sample in samples:
            _check_content(sample, n_channels)


def _read_samples(
    device: Device, clock: SessionClock, n_samples: int, timeout_s: float, now_s: Callable[[], float]
) -> list[DeviceSample]:
    """Return samples read in another thread than the one that opened the device, as in a session; check their times.

    Raises:
        ContractError: if a read takes too long, a time is wrong, or fewer than ``n_samples`` arrive in ``timeout_s``.
    """
    samples: list[DeviceSample] = []
    deadline_s = now_s() + timeout_s
    with ThreadPoolExecutor(1) as thread:
        while len(samples) < n_samples and now_s() < deadline_s:
            began_s = now_s()
            new_samples = thread.submit(device.read).result()
            duration_s = now_s() - began_s
            is_fast = duration_s < MAX_READ_S
            require(is_fast, f"read() took {duration_s:.1f} s; it returns what has arrived and never waits")
            _check_times([*samples[-1:], *new_samples], clock())
            samples += new_samples
            time.sleep(POLL_INTERVAL_S)
    require(len(samples) >= n_samples, f"{len(samples)} of {n_samples} samples arrived within {timeout_s:g} s")
    return samples


def _check_times(samples: Sequence[DeviceSample], now_ns: int) -> None:
    """Check that samples are in order of time, and none is of a time after ``now_ns``."""
    for sample in samples:
        require(
            isinstance(sample, DeviceSample), f"read() returned {sample!r}, which is not a minihuman.ext.DeviceSample"
        )
        require(isinstance(sample.t_ns, int), f"t_ns is {sample.t_ns!r}; a time is an integer, ns")
        require(
            sample.t_ns <= now_ns,
            f"a sample of {sample.t_ns} ns was read at {now_ns} ns; its time is the session clock's",
        )
    for earlier, later in pairwise(samples):
        require(
            earlier.t_ns <= later.t_ns,
            f"{later.t_ns} ns follows {earlier.t_ns} ns; the oldest is first",
        )


def _check_content(sample: DeviceSample, n_channels: int) -> None:
    """Check that a sample has ``n_channels`` numbers, or only text."""
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


MS = 1_000_000
SECOND = 1_000_000_000

SCREENS: tuple[Screen, ...] = (
    TextScreen("Consent", "Words to read.\n\nMore words. " * 9, "Press Enter if you agree", "episode 1 of 2"),
    TextScreen("Keyboard check", "Press each key.", "1 key to go", keys=(("1", True), ("kp_2", False), ("up", True))),
    TextScreen("", "", ""),
    PlayScreen(np.full((56, 56, 3), 200, np.uint8), "reach the green goal", "episode 1 of 2", (("1", "left"),)),
    PlayScreen(np.full((900, 1200, 3), 90, np.uint8), "", ""),
)

KeyStrokes = Sequence[tuple[str, bool]]  # keys, and whether they go down


class TypedWindow(abc.ABC):
    """A window, and the means to type into it: a robot for a real window, a script for a virtual one."""

    window: Window

    @abc.abstractmethod
    def type(self, strokes: KeyStrokes) -> None:
        """Press (True) and release (False) keys in the given order, without delay."""

    @abc.abstractmethod
    def now_ns(self) -> int:
        """Return the time on the window's clock, in nanoseconds."""

    def hear(self, count: int) -> list[Input]:
        """Wait until ``count`` or more inputs have arrived, but at most ten seconds, and return all that arrived."""
        heard: list[Input] = []
        until_ns = self.now_ns() + 10 * SECOND
        while len(heard) < count and self.now_ns() < until_ns:
            heard += self.window.wait(until_ns)
        return heard


def check_window(typed: TypedWindow) -> None:
    """Run every check of `CHECKS` on a window, and close it twice.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
    """
    for check in CHECKS.values():
        check(typed)
    typed.window.close()
    typed.window.close()  # closing a closed window does nothing


def list_strokes(inputs: Iterable[Input]) -> list[tuple[str, bool]]:
    """Return the keys that went down or up, each with whether it went down."""
    return [(event.key, isinstance(event, KeyDown)) for event in inputs if isinstance(event, KeyDown | KeyUp)]


def a_screen_is_submitted_then_flipped(typed: TypedWindow) -> None:
    """Show each of `SCREENS`, and check that it is submitted, then displayed, between the call and the return."""
    for screen in SCREENS:
        before_ns = typed.now_ns()
        flip = typed.window.show(screen)
        in_order = before_ns <= flip.submit_ns <= flip.flip_ns == flip.t_ns <= typed.now_ns()
        require(in_order, f"{type(screen).__name__}: shown at {before_ns} to {typed.now_ns()} ns, and says {flip}")


def waiting_ends_at_the_deadline_and_not_before(typed: TypedWindow) -> None:
    """Wait while nothing is typed, and check when the wait ends."""
    until_ns = typed.now_ns() + 30 * MS
    heard = typed.window.wait(until_ns)
    require(heard == [], f"nobody typed, and wait() heard {heard}")
    require(typed.now_ns() >= until_ns, "wait() came back before its deadline with nothing")


def a_deadline_that_has_passed_still_hands_over_what_has_arrived(typed: TypedWindow) -> None:
    """Type two strokes, then wait twice with a deadline in the past; only the first wait returns them."""
    typed.type([("1", True), ("1", False)])
    time.sleep(0.1)  # the display server's delivery, not the window's
    _require_heard([("1", True), ("1", False)], typed.window.wait(0))
    _require_heard([], typed.window.wait(0))


def two_taps_within_a_frame_are_two_taps(typed: TypedWindow) -> None:
    """Press and release a key twice without delay, and check that the window returns all four strokes."""
    _type_and_hear(typed, [("3", True), ("3", False)] * 2)


def rolling_from_key_to_key_keeps_the_order(typed: TypedWindow) -> None:
    """Press each key before the previous one is released, and check that the window keeps the order."""
    _type_and_hear(typed, [("1", True), ("2", True), ("1", False), ("3", True), ("2", False), ("3", False)])


def of_hundreds_of_strokes_none_is_lost_or_doubled(typed: TypedWindow) -> None:
    """Type 400 random strokes without delay, and check that the window returns each once."""
    rng = random.Random(7)
    keys_down: set[str] = set()
    strokes = []
    for _ in range(400):
        key = rng.choice(sorted(DIGITS))
        strokes.append((key, key not in keys_down))
        keys_down ^= {key}  # the stroke presses a key that is up, and releases one that is down
    _type_and_hear(typed, strokes + [(key, False) for key in sorted(keys_down)])


def strokes_during_a_flip_are_kept(typed: TypedWindow) -> None:
    """Type before a screen is shown, and check that the window returns the strokes after it."""
    strokes = [("4", True), ("5", True), ("4", False), ("5", False)]
    typed.type(strokes)
    typed.window.show(SCREENS[0])
    _require_heard(strokes, typed.hear(4))


def stamps_never_go_back_and_lie_between_stroke_and_receipt(typed: TypedWindow) -> None:
    """Check that the times of inputs rise and lie between the strokes and their receipt on the window's clock."""
    before_ns = typed.now_ns()
    typed.type([("6", True), ("6", False)] * 5)
    stamps = [event.t_ns for event in typed.hear(10)]
    require(stamps == sorted(stamps), f"the stamps go back: {stamps}")
    within = bool(stamps) and before_ns <= stamps[0] <= stamps[-1] <= typed.now_ns()
    require(within, f"typed at {before_ns} ns or later, heard by {typed.now_ns()} ns, stamped {stamps}")


def facts_are_words_without_names_of_people_or_machines(typed: TypedWindow) -> None:
    """Check that the window's facts, which are logged, are texts and name neither this machine nor its user."""
    facts = typed.window.facts()
    require(bool(facts.get("window")), "facts() does not say which window it is, under 'window'")
    require(all(isinstance(fact, str) for fact in facts.values()), f"facts() holds a value that is not text: {facts}")
    for private in (platform.node(), getpass.getuser()):
        require(private not in " ".join(facts.values()).split(), "facts() names this machine or its user")


CHECKS: Mapping[str, Callable[[TypedWindow], None]] = MappingProxyType(
    {
        check.__name__: check
        for check in (
            a_screen_is_submitted_then_flipped,
            waiting_ends_at_the_deadline_and_not_before,
            a_deadline_that_has_passed_still_hands_over_what_has_arrived,
            two_taps_within_a_frame_are_two_taps,
            rolling_from_key_to_key_keeps_the_order,
            of_hundreds_of_strokes_none_is_lost_or_doubled,
            strokes_during_a_flip_are_kept,
            stamps_never_go_back_and_lie_between_stroke_and_receipt,
            facts_are_words_without_names_of_people_or_machines,
        )
    }
)


def _type_and_hear(typed: TypedWindow, strokes: KeyStrokes) -> None:
    """Type strokes, and check that the window returns them and nothing else, auto-repeats apart."""
    typed.type(strokes)
    heard = typed.hear(len(strokes))
    _require_heard(strokes, [event for event in heard if not getattr(event, "repeat", False)])


def _require_heard(strokes: KeyStrokes, heard: Sequence[Input]) -> None:
    heard_strokes = list_strokes(heard)
    is_equal = heard_strokes == list(strokes)
    require(is_equal, f"typed {_format_strokes(strokes)}, heard {_format_strokes(heard_strokes)}")


def _format_strokes(strokes: KeyStrokes) -> str:
    """Return strokes as text, such as "left+ left-": a plus for a press and a minus for a release."""
    signs = {True: "+", False: "-"}
    return " ".join(key + signs[down] for key, down in strokes) or "nothing"
