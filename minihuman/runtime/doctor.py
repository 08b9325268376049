"""Checks whether this machine is fit to run participants: measures its display, keyboard path, disk and worlds.

For a study it also measures how long step, picture and flip take in each block's world.
"""

import os
import platform
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from importlib.metadata import PackageNotFoundError, version
from itertools import cycle
from pathlib import Path

import numpy as np

from minihuman import __version__
from minihuman.admin.legibility import describe_missing_face, find_illegible_in_study, list_undrawable_languages
from minihuman.display.windows.blocking_window import BlockingWindow, open_window
from minihuman.errors import DeviceError, WindowError, WorldError
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.screens import PlayScreen, Screen
from minihuman.experiment.plan.trials import list_protocol_sounds
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.words import LANGUAGES
from minihuman.operating_system import make_private_folder, sync_file
from minihuman.runtime.device_delays import NO_DELAYS, DelayChecks, measure_loopback, measure_photodiode
from minihuman.runtime.devices.sound import PortAudioOutput
from minihuman.runtime.finding import Finding
from minihuman.worlds.adapters.world import World

_STEPS = 60
_WARM = 10  # first steps, which are not counted
MAX_PICTURE_MS = 1000 / 30  # two frames of a display of 60 Hz


_NS_PER_MS = 1e6


def _measure_steps_ms(window: BlockingWindow, block: BlockSpec, world: World) -> list[float]:
    """Play a block's world with its actions in turn; return each step's time to the flip of its picture, in ms."""
    times_ms = []
    is_over = True
    actions = cycle(block.actions)
    for number in range(_STEPS):
        if is_over:
            world.reset(number)
        started_ns = time.perf_counter_ns()
        happened = world.step(world.action_names.index(next(actions)))
        picture = world.frame(block.view, window.picture_px, block.palette)
        screen = PlayScreen(picture, "measuring this study's pictures", block.name, step=number)
        times_ms.append((window.show(screen).flip_ns - started_ns) / _NS_PER_MS)
        is_over = happened.terminated or happened.truncated
    return times_ms


_FRAMES = 90
_WARM_FRAMES = 15  # first frames, which are not counted
_KEYS = 30
_SLEEP_BEFORE_KEY_S = 0.02
_LONGEST_WAIT_NS = 2_000_000_000  # for a key that was put into the queue
_SYNCS = 100
_SYNC_BYTES = 4096  # about one step of a session
_LATENESS_MS = 5.0  # beyond the display's period, within which a key's picture is displayed
_SLOWEST_FRAME_MS = 50.0  # 99th percentile; longer frames are seen as stutter
_SLOWEST_SYNC_MS = 250.0  # 99th percentile; the writer's queue absorbs shorter ones
_LEAST_FREE_BYTES = 2 * 10**9
_SOUND_S = 2.0  # of the sound device's test
_LARGEST_UNCERTAINTY_MS = 5.0
_UNKNOWN_PERIOD_MS = 1000 / 60  # assumed if the flip does not wait for the display
_PACKAGES = (
    "numpy",
    "gymnasium",
    "mcap",
    "pygame-ce",
    "pyglet",
    "rerun-sdk",
    "uharfbuzz",
    "python-bidi",
    "freetype-py",
)


def examine_machine(
    *,
    window: str,
    data: Path,
    fullscreen: bool = False,
    protocol: Protocol | None = None,
    delays: DelayChecks = NO_DELAYS,
) -> Iterator[Finding]:
    """Examine this machine; yield one finding after the other, including one for each check that is impossible.

    Args:
        window: "auto", "pygame" or "pyglet".
        data: the folder in which sessions are to be kept; it is created if absent.
        fullscreen: whether to measure the whole screen, as participants will see it.
        protocol: a study whose texts and worlds are to be checked, too.
        delays: the delays to measure, for which a cable or a photodiode is connected.
    """
    yield _list_versions()
    yield _check_clock()
    yield _check_languages()
    if protocol is not None:
        yield _check_texts(protocol)
        yield from _check_sound(protocol)
    if delays.loopback:
        yield from measure_loopback()
    yield from _check_display(window, protocol, fullscreen=fullscreen, photodiode=delays.photodiode)
    yield from _measure_disk(data)


def format_verdict(findings: list[Finding]) -> str:
    """Return the last line of the report: that the machine is fit, or why it is not."""
    reasons = [finding.unfit_because for finding in findings if finding.unfit_because]
    if not reasons:
        return "This machine is fit to run participants."
    return f"This machine is not fit to run participants, because {'; '.join(reasons)}."


def _list_versions() -> Finding:
    """List the versions of the system, of Python, of this package, and of the packages that sessions need."""
    system = platform.system()
    processor = platform.machine()
    python_version = platform.python_version()
    versions = [f"{system} {processor}", f"Python {python_version}", f"minihuman {__version__}"]
    for package in _PACKAGES:
        try:
            package_version = version(package)
        except PackageNotFoundError:
            package_version = "missing"
        versions.append(f"{package} {package_version}")
    return Finding("versions", ", ".join(versions))


def _check_clock() -> Finding:
    """Check whether the session's clock has a resolution of a millisecond or better."""
    resolution_ns = time.get_clock_info("perf_counter").resolution * 1e9
    clock_problem = ""
    if resolution_ns > _NS_PER_MS:
        clock_problem = "its clock ticks slower than once a millisecond"
    return Finding("clock", f"monotonic, {resolution_ns:.0f} ns", clock_problem)


def _check_languages() -> Finding:
    """List the languages in which screens can be drawn here, and what is missing for the others."""
    undrawable = list_undrawable_languages()
    drawable = ", ".join(language for language in LANGUAGES if language not in undrawable)
    without_face = [f"not {language}: {describe_missing_face(character)}" for language, character in undrawable.items()]
    return Finding("languages", "; ".join([drawable, *without_face]))


def _check_texts(protocol: Protocol) -> Finding:
    """Check whether every text of a study can be read on this machine's screens."""
    problems = list(dict.fromkeys(find_illegible_in_study(protocol)))
    if not problems:
        return Finding("texts", f"every text of the study can be read, in {protocol.study.language!r}")
    first_problem, *others = problems
    more_problems = ""
    if others:
        more_problems = f" (and {len(others)} more; minihuman check names all)"
    return Finding("texts", first_problem + more_problems, "a text of the study cannot be read here")


def _check_sound(protocol: Protocol) -> Iterator[Finding]:
    """Open the sound device for a study with sounds, and check its clock and whether it is interrupted.

    Yield one finding, or none if the study has no sounds.
    """
    contents = list_protocol_sounds(protocol)
    if not contents:
        return
    try:
        output = PortAudioOutput(time.perf_counter_ns, contents, protocol.files)
    except (DeviceError, WorldError) as error:
        yield Finding("sound", str(error), "its sounds cannot be played")
        return
    try:
        time.sleep(_SOUND_S)
        facts = output.facts()
        interruptions = output.interruptions
        uncertainty_ms = output.uncertainty_ms
    finally:
        output.close()
    sound_problem = ""
    if interruptions:
        sound_problem = f"the sound device ran out of samples {interruptions} times in {_SOUND_S:g} s"
    elif uncertainty_ms is None or uncertainty_ms > _LARGEST_UNCERTAINTY_MS:
        sound_problem = "the times of sounds are not known to the millisecond"
    precision = "unknown" if uncertainty_ms is None else f"within {uncertainty_ms:.2f} ms but for a constant delay"
    device = f"{facts['sound_device']}, {facts['sound_latency_ms']} ms latency"
    yield Finding("sound", f"{device}, onsets {precision}", sound_problem)


def _check_display(name: str, protocol: Protocol | None, *, fullscreen: bool, photodiode: bool) -> Iterator[Finding]:
    """Open a window, and check its display, its keys, its timing and, for a study, the pictures of its worlds.

    If ``photodiode``, measure the display's delay, too.
    """
    try:
        window = open_window(name, time.perf_counter_ns, fullscreen=fullscreen)
    except WindowError as error:
        yield Finding("display", str(error), "no window can be opened")
        if photodiode:
            yield _report_no_photodiode("no window can be opened")
        return
    try:
        facts = window.facts()
        properties = [f"{name} {fact}" for name, fact in facts.items() if name != "key_identity"]
        yield Finding("display", ", ".join(properties))
        yield _check_key_identity(facts.get("key_identity", "unknown"))
        if isinstance(window, BlockingWindow):
            has_vsync = facts["vsync"] == "on"
            has_refresh_rate = facts["refresh_hz_reported"] != "unknown"
            yield from _measure_frames(window, synced=has_vsync and has_refresh_rate)
            if protocol is not None:
                yield from _measure_pictures(window, protocol)
            if photodiode:
                yield from measure_photodiode(window)
        elif photodiode:
            yield _report_no_photodiode("this window does not wait for input; use --window pygame or pyglet")
    finally:
        window.close()


def _report_no_photodiode(reason: str) -> Finding:
    """Return the finding that no photodiode was recorded, and why."""
    return Finding("photodiode", f"not recorded: {reason}", "the delay of pictures was not measured")


def _check_key_identity(identity: str) -> Finding:
    """Check whether the window identifies keys by position, as it must with any keyboard layout."""
    unfit_because = ""
    if not identity.startswith("position"):
        unfit_because = "keys are known by symbol only, which a keyboard layout changes; use --window pygame"
    return Finding("keys", f"known by {identity}", unfit_because)


def _measure_pictures(window: BlockingWindow, protocol: Protocol) -> Iterator[Finding]:
    """Measure the time from a step to its picture's flip in the study's own worlds, at this window's size."""
    for block in protocol.blocks:
        with closing(World(block.world, block.options)) as world:
            times_ms = _measure_steps_ms(window, block, world)
        median, p95 = np.percentile(times_ms[_WARM:], (50, 95))
        picture_problem = ""
        if median > MAX_PICTURE_MS:
            picture_problem = f"a picture of block {block.name} takes {median:.0f} ms, over {MAX_PICTURE_MS:.0f}"
        delays = f"step to flip: median {median:.1f} ms, 95 % {p95:.1f} ms"
        yield Finding(f"block {block.name}", delays, picture_problem)


def _measure_frames(window: BlockingWindow, *, synced: bool) -> Iterator[Finding]:
    """Measure the time between flips, and from a key press to the flip of its picture.

    ``synced`` says whether a flip waits for the display.
    """
    flips_ns = [window.show(screen).flip_ns for screen in _yield_flicker(window, _FRAMES)]
    between_ms = np.diff(flips_ns[_WARM_FRAMES:]) / _NS_PER_MS
    p50, p95, p99 = np.percentile(between_ms, (50, 95, 99))
    frame_problem = ""
    if p99 > _SLOWEST_FRAME_MS:
        frame_problem = f"1 frame in 100 takes over {_SLOWEST_FRAME_MS:.0f} ms"
    if synced:
        refresh = f"{1000 / p50:.1f} Hz measured"
        period_ms = float(p50)
    else:
        refresh = "the flip does not wait for the display"
        period_ms = _UNKNOWN_PERIOD_MS
    yield Finding("refresh", refresh)
    yield Finding("frame time", f"median {p50:.2f} ms, 95 % {p95:.2f} ms, 99 % {p99:.2f} ms", frame_problem)
    median, p95 = np.percentile(_measure_key_to_flip_ms(window), (50, 95))
    key_problem = ""
    if median > period_ms + _LATENESS_MS:
        key_problem = f"a key's picture takes {median:.1f} ms"
    yield Finding("key to flip", f"median {median:.2f} ms, 95 % {p95:.2f} ms, {_KEYS} synthetic keys", key_problem)


def _measure_key_to_flip_ms(window: BlockingWindow) -> list[float]:
    """Return the times from a key put into the sleeping window's queue to the flip of the picture that it causes."""
    delays_ms = []
    for screen in _yield_flicker(window, _KEYS):
        sent_ns: list[int] = []

        def send(sent_ns: list[int] = sent_ns) -> None:
            sent_ns.append(time.perf_counter_ns())
            window.post_key("space")

        timer = threading.Timer(_SLEEP_BEFORE_KEY_S, send)
        timer.start()
        until_ns = time.perf_counter_ns() + _LONGEST_WAIT_NS
        while not any(isinstance(happened, KeyDown) for happened in window.wait(until_ns)):
            assert time.perf_counter_ns() < until_ns, "a key put into the toolkit's queue did not come out of it"
        delays_ms.append((window.show(screen).flip_ns - sent_ns[0]) / _NS_PER_MS)
        timer.join()
    return delays_ms


def _yield_flicker(window: BlockingWindow, count: int) -> Iterator[Screen]:
    """Yield play screens of realistic size, each different from the one before."""
    width, height = window.picture_px
    for number in range(count):
        grey = 60 if number % 2 == 0 else 120
        picture = np.full((height, width, 3), grey, np.uint8)
        yield PlayScreen(picture, "measuring the display", "this takes a few seconds")


def _measure_disk(data: Path) -> Iterator[Finding]:
    """Measure the free space of the disk with the data folder, and the time of a durable write to it."""
    make_private_folder(data)
    free_bytes = shutil.disk_usage(data).free
    free_gb = free_bytes / 1e9
    space_problem = ""
    if free_bytes < _LEAST_FREE_BYTES:
        space_problem = f"only {free_gb:.1f} GB are free under {data}"
    yield Finding("free space", f"{free_gb:.1f} GB under {data}", space_problem)
    times_ms = _measure_syncs_ms(data)
    median, p99 = np.percentile(times_ms, (50, 99))
    worst = max(times_ms)
    sync_problem = ""
    if p99 > _SLOWEST_SYNC_MS:
        sync_problem = f"1 fsync in 100 takes over {_SLOWEST_SYNC_MS:.0f} ms under {data}"
    yield Finding("fsync", f"median {median:.2f} ms, 99 % {p99:.2f} ms, worst {worst:.2f} ms", sync_problem)


def _measure_syncs_ms(data: Path) -> list[float]:
    """Return the times of durable writes to a temporary file in a folder, in milliseconds."""
    times_ms = []
    with tempfile.TemporaryFile(dir=data) as file:
        for _ in range(_SYNCS):
            file.write(os.urandom(_SYNC_BYTES))
            file.flush()
            started_ns = time.perf_counter_ns()
            sync_file(file.fileno())
            times_ms.append((time.perf_counter_ns() - started_ns) / _NS_PER_MS)
    return times_ms
