"""Sounds as another program records them from a null sink, beside what the log says of them."""

import subprocess
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.machine import needs
from tests.null_sink import recorded_sink
from tests.sound_loopback import compare, play_at_desk, play_in_chromium, play_in_firefox, write_study

pytestmark = [pytest.mark.program, needs("sound")]


def test_each_sound_of_the_log_was_heard_at_the_desk(tmp_path: Path, display: str) -> None:
    protocol = write_study(tmp_path, trials=6, onset_ms=300)
    with recorded_sink(tmp_path / "sink") as sink:
        log = play_at_desk(protocol, tmp_path / "data", sink, display)
    assert 1 <= len(compare(log, sink).recorded) <= 6  # a machine that is busy for half a second misses a trial's sound
    assert list(find_log_differences(log, World)) == []


@pytest.mark.nightly
@pytest.mark.parametrize("onset_ms", [0, 300])
def test_the_spread_at_the_desk_is_below_two_milliseconds(tmp_path: Path, display: str, onset_ms: int) -> None:
    protocol = write_study(tmp_path, trials=100, onset_ms=onset_ms)
    with recorded_sink(tmp_path / "sink") as sink:
        comparison = compare(play_at_desk(protocol, tmp_path / "data", sink, display), sink)
    print(comparison.describe())
    assert comparison.from_picture.std() <= 2
    assert comparison.within_claim >= 0.99


@pytest.mark.nightly
@needs("compiler")
def test_a_wall_clock_that_steps_moves_no_onset(tmp_path: Path, display: str) -> None:
    """The wall clock of the session, PortAudio and the sound server steps by 37 s, forward and back, every 8 s."""
    library = tmp_path / "steps.so"
    source = Path(__file__).parents[2] / "clock_steps.c"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl"], check=True)
    protocol = write_study(tmp_path, trials=count(20, 100), onset_ms=300)
    with recorded_sink(tmp_path / "sink", LD_PRELOAD=str(library)) as sink:
        comparison = compare(play_at_desk(protocol, tmp_path / "data", sink, display), sink)
    print(f"a wall clock that steps: {comparison.describe()}")
    assert comparison.from_picture.std() <= 2
    assert comparison.within_claim >= 0.99


@pytest.mark.nightly
@needs("chromium")
@pytest.mark.parametrize("onset_ms", [0, 300])
def test_the_spread_in_the_browser_is_below_four_milliseconds(tmp_path: Path, onset_ms: int) -> None:
    protocol = write_study(tmp_path, trials=100, onset_ms=onset_ms, ready="first")
    with recorded_sink(tmp_path / "sink") as sink:
        log = play_in_chromium(protocol, tmp_path / "data", sink)
    comparison = compare(log, sink)
    print(comparison.describe())
    assert list(find_log_differences(log, World)) == []
    assert comparison.from_picture.std() <= 4
    assert comparison.within_claim >= 0.99


@pytest.mark.nightly
@needs("firefox")
def test_the_spread_in_firefox_is_below_four_milliseconds(tmp_path: Path) -> None:
    protocol = write_study(tmp_path, trials=60, onset_ms=300, ready="first")
    with recorded_sink(tmp_path / "sink") as sink:
        comparison = compare(play_in_firefox(protocol, tmp_path / "data", sink), sink)
    print(comparison.describe())
    assert comparison.from_picture.std() <= 4
    assert comparison.within_claim >= 0.99
