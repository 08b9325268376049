"""`doctor --loopback` and `--photodiode` as programs: what is played into a null sink is what the input records.

The sink's monitor stands for a cable, and a program that looks at the window for a photodiode: that proves counting
and matching, not the delay of a sound card or of a display.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.counts import PATIENCE_S
from tests.machine import needs
from tests.null_sink import NullSink, recorded_sink
from tests.photodiode import LEAST_DELAY_S
from tests.programs import running, stop

ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.program, needs("sound")]


def examine(data: Path, environment: dict[str, str], *options: str) -> dict[str, tuple[str, str]]:
    """Return the findings of `doctor`: each one's value, and why it is unfit."""
    command = [sys.executable, "-m", "minihuman", "doctor", "--data", str(data), "--json", *options]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert "Traceback" not in done.stderr
    findings = {one["name"]: (one["value"], one["unfit_because"]) for one in json.loads(done.stdout)}
    assert done.returncode == int(any(unfit_because for _, unfit_because in findings.values()))
    return findings


def read_delay(value: str) -> tuple[int, float]:
    """Return how many onsets were recorded, and their median delay in ms."""
    figures = re.match(r"(\d+) of .*; median (\S+) ms", value)
    assert figures is not None, value
    return int(figures[1]), float(figures[2])


def add_silent_source(sink: NullSink) -> None:
    """Let programs that record hear another sink, into which nothing is played."""
    load = ["pactl", "load-module", "module-null-sink", "sink_name=silent"]
    subprocess.run(load, env=sink.environment, check=True, stdout=subprocess.DEVNULL)
    sink.environment["PULSE_SOURCE"] = "silent.monitor"


def test_clicks_come_back_through_the_sinks_monitor(tmp_path: Path) -> None:
    with recorded_sink(tmp_path / "sink") as sink:
        findings = examine(tmp_path / "data", sink.environment | {"DISPLAY": ""}, "--loopback")
    value, unfit_because = findings["loopback"]
    count, median_ms = read_delay(value)
    assert 20 <= count <= 40, value  # a busy machine interrupts the sound, and some come far from their times
    assert abs(median_ms) < 30, value
    assert (count < 40) == unfit_because.startswith("only"), unfit_because
    assert findings["sound input"][0].startswith("default, ALSA, 48000 Hz")


@pytest.mark.nightly
def test_without_the_cable_nothing_comes_back_and_the_way_out_is_named(tmp_path: Path) -> None:
    with recorded_sink(tmp_path / "sink") as sink:
        add_silent_source(sink)
        findings = examine(tmp_path / "data", sink.environment | {"DISPLAY": ""}, "--loopback")
    value, unfit_because = findings["loopback"]
    assert len(sink.read_onsets_ms()) >= 10  # they were played
    assert value.startswith("0 of 40 clicks came back, and the recording reaches 0 % of full scale; connect")
    assert unfit_because == "only 0 of 40 clicks came back through the cable"


def test_without_a_sound_server_one_sentence_says_so(tmp_path: Path) -> None:
    environment = {"PULSE_SERVER": "unix:/nowhere", "HOME": str(tmp_path)}
    value, unfit_because = examine(tmp_path / "data", environment, "--loopback")["loopback"]
    assert re.match(r"sound is to be recorded, but no sound input opens \(.+\); connect one", value)
    assert unfit_because == "the delay of sounds was not measured"


def test_changes_of_the_picture_are_seen(tmp_path: Path, display: str) -> None:
    watch = [sys.executable, "-m", "tests.photodiode", display]
    with (
        recorded_sink(tmp_path / "sink", DISPLAY=display) as sink,
        running(watch, env=sink.environment, cwd=ROOT) as diode,
    ):
        findings = examine(tmp_path / "data", sink.environment, "--photodiode", "--window", "pygame", "--windowed")
        stop(diode)
    for direction in ("dark to light", "light to dark"):
        value, _ = findings[f"photodiode {direction}"]
        count, median_ms = read_delay(value)
        assert 15 <= count <= 30, value  # a busy machine delays pictures, and the program that looks at them
        assert 1000 * LEAST_DELAY_S < median_ms < 1000, value


@pytest.mark.nightly
def test_without_a_diode_no_change_is_seen_and_the_way_out_is_named(tmp_path: Path, display: str) -> None:
    with recorded_sink(tmp_path / "sink", DISPLAY=display) as sink:
        findings = examine(tmp_path / "data", sink.environment, "--photodiode", "--window", "pygame", "--windowed")
    for direction in ("dark to light", "light to dark"):
        value, unfit_because = findings[f"photodiode {direction}"]
        assert value.startswith(f"0 of 30 changes from {direction} were seen, and the recording reaches 0 %")
        assert "fix the photodiode" in value
        assert unfit_because == f"only 0 of 30 changes from {direction} were seen"
