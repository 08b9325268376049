"""`doctor --loopback` and `--photodiode`: what they find in made-up recordings, and without a device."""

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from minihuman.experiment.machine.inputs import SoundStarted
from minihuman.runtime.device_delays import (
    DelayChecks,
    PictureChange,
    judge_loopback,
    judge_photodiode,
    measure_loopback,
)
from minihuman.runtime.doctor import examine_machine
from minihuman.runtime.finding import Finding
from tests.made_recordings import RATE_HZ, add_clicks, add_edges, draw_times_s, record

TIMES_S = draw_times_s(40, (0.2, 0.3))
CHANGES_S = draw_times_s(60, (0.25, 0.4))


def start_clicks(times_s: NDArray[np.float64], uncertainty_ms: float = 1.0) -> list[SoundStarted]:
    """Return the reports of clicks that began at these times."""
    times_ns = [round(time_s * 1e9) for time_s in times_s]
    uncertainty_ns = round(uncertainty_ms * 1e6)
    return [SoundStarted(time_ns, cue, time_ns, time_ns, uncertainty_ns) for cue, time_ns in enumerate(times_ns)]


def judge_clicks(recorded_s: NDArray[np.float64], **changes: float) -> Finding:
    return judge_loopback(start_clicks(TIMES_S, **changes), record(add_clicks(recorded_s, noise=0.003)))


def judge_changes(recorded_s: NDArray[np.float64], period_ms: float = 1000 / 60) -> list[Finding]:
    changes = [PictureChange(round(time_s * 1e9), number % 2 == 0) for number, time_s in enumerate(CHANGES_S)]
    return list(judge_photodiode(changes, record(add_edges(recorded_s, fade_s=0.02)), period_ms=period_ms))


def test_a_cable_with_a_constant_delay_is_fit_and_the_delay_is_called_an_upper_bound() -> None:
    finding = judge_clicks(TIMES_S + 0.08)
    assert finding.unfit_because == ""
    assert "40 of 40 clicks came back; median 80.0 ms" in finding.value
    assert "100 % within the stated uncertainty" in finding.value
    assert "includes the input's own delay, so it is an upper bound" in finding.value


def test_clicks_that_jitter_by_more_than_two_milliseconds_are_unfit() -> None:
    jitter_s = np.random.default_rng(2).normal(0, 1, 40)
    assert judge_clicks(TIMES_S + 0.08 + 0.0015 * jitter_s / jitter_s.std()).unfit_because == ""
    finding = judge_clicks(TIMES_S + 0.08 + 0.0025 * jitter_s / jitter_s.std())
    assert finding.unfit_because == "the delay of sounds varies with an SD of 2.5 ms, over 2"
    share = np.mean(np.abs(jitter_s - np.median(jitter_s)) / jitter_s.std() <= 1 / 2.5)
    assert f"{100 * share:.0f} % within the stated uncertainty" in finding.value


def test_a_click_that_does_not_come_back_is_unfit() -> None:
    finding = judge_clicks(np.delete(TIMES_S, 9) + 0.08)
    assert "39 of 40 clicks came back; median 80.0 ms" in finding.value
    assert finding.unfit_because == "only 39 of 40 clicks came back through the cable"


def test_a_click_that_never_began_is_one_that_did_not_come_back() -> None:
    finding = judge_loopback(start_clicks(TIMES_S[:-1]), record(add_clicks(TIMES_S[:-1])))
    assert finding.unfit_because == "only 39 of 40 clicks came back through the cable"
    assert "0 of 40" in judge_loopback([], record(add_clicks(TIMES_S))).value


def test_without_a_cable_one_sentence_says_what_to_do() -> None:
    finding = judge_loopback(start_clicks(TIMES_S), record(add_clicks(TIMES_S, level=0.0, noise=0.0001)))
    assert finding.value == (
        "0 of 40 clicks came back, and the recording reaches 0.05 % of full scale; connect the headphone output to the "
        "line or microphone input with a cable, choose that input as the system's, and raise the output's volume and "
        "the input's level"
    )
    assert finding.unfit_because == "only 0 of 40 clicks came back through the cable"


def test_an_input_that_states_its_times_too_early_bounds_nothing() -> None:
    value = judge_clicks(TIMES_S - 0.02).value
    assert "median -20.0 ms" in value
    assert "upper bound" not in value
    assert "too early" in value


def test_each_direction_of_the_picture_has_a_delay_of_its_own() -> None:
    delays_s = np.where(np.arange(60) % 2, 0.03, 0.012)
    to_light, to_dark = judge_changes(CHANGES_S + delays_s)
    assert "30 of 30 changes from dark to light were seen; median 12.0 ms" in to_light.value
    assert "30 of 30 changes from light to dark were seen; median 30.0 ms" in to_dark.value
    assert (to_light.unfit_because, to_dark.unfit_because) == ("", "")
    assert "upper bound" in to_light.value


def test_a_delay_that_varies_by_over_half_a_frame_is_unfit() -> None:
    jitter_s = np.zeros(60)
    jitter_s[::2] = np.random.default_rng(2).normal(0, 1, 30)
    jitter_s *= 0.005 / jitter_s[::2].std()
    assert [finding.unfit_because for finding in judge_changes(CHANGES_S + 0.02 + jitter_s)] == ["", ""]
    to_light, to_dark = judge_changes(CHANGES_S + 0.02 + jitter_s, period_ms=1000 / 144)
    assert to_light.unfit_because == "the delay from dark to light varies with an SD of 5.1 ms, over half a frame"
    assert to_dark.unfit_because == ""
    assert "half a frame is 3.5 ms" in to_light.value
    assert "60 Hz are assumed" in judge_changes(CHANGES_S, period_ms=0.0)[0].value


def test_a_change_that_was_not_seen_is_unfit() -> None:
    recorded_s = np.delete(CHANGES_S, 20) + 0.02
    to_light, to_dark = judge_changes(recorded_s)
    assert to_light.unfit_because == "only 29 of 30 changes from dark to light were seen"
    assert to_dark.unfit_because == ""


def test_without_a_diode_one_sentence_says_what_to_do() -> None:
    changes = [PictureChange(round(time_s * 1e9), number % 2 == 0) for number, time_s in enumerate(CHANGES_S)]
    silent = record(np.zeros(RATE_HZ, np.float32))
    for finding in judge_photodiode(changes, silent, period_ms=1000 / 60):
        assert finding.value.startswith("0 of 30 changes")
        assert "fix the photodiode to the middle of the screen" in finding.value
        assert finding.unfit_because.startswith("only 0 of 30 changes")


@pytest.mark.parametrize("drift", [0.0, 0.0001, -0.0001])
def test_a_recording_keeps_to_the_sessions_clock_while_its_own_drifts(drift: float) -> None:
    recording = record(np.zeros(30 * RATE_HZ, np.float32), drift=drift, jitter_s=0.002)
    frames = np.arange(1.0, 30.0) * RATE_HZ
    errors_s = recording.find_times_s(frames) - frames / RATE_HZ * (1 + drift)
    assert np.ptp(errors_s) < 0.001  # 100 ppm are 3 ms in 30 s


def test_a_recording_that_lost_samples_soon_has_the_right_times_again() -> None:
    recording = record(np.zeros(4 * RATE_HZ, np.float32), lost_s=(2.0, 0.05))
    frames = np.array([1.9, 2.5, 3.9]) * RATE_HZ
    assert recording.find_times_s(frames) - frames / RATE_HZ == pytest.approx([0.0, 0.05, 0.05])


def test_an_onset_between_samples_has_a_time_between_theirs() -> None:
    recording = replace(record(np.zeros(RATE_HZ, np.float32)), first_frames=np.array([0]), offsets_s=np.array([2.0]))
    assert recording.find_times_s(np.array([0.5, 24_000.25])) == pytest.approx(
        [2.0 + 0.5 / RATE_HZ, 2.5 + 0.25 / RATE_HZ]
    )


def test_without_sounddevice_the_way_out_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    [finding] = measure_loopback()
    assert finding.value.startswith(
        "sound is to be recorded, for which the package sounddevice is missing; pip install"
    )
    assert finding.unfit_because == "the delay of sounds was not measured"


def test_without_portaudio_the_way_out_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delitem(sys.modules, "sounddevice", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "sounddevice.py").write_text("raise OSError('PortAudio library not found')\n")
    [finding] = measure_loopback()
    assert finding.value == ("sound is to be recorded, for which PortAudio is missing; apt-get install libportaudio2")


def make_sounddevice(error: Exception) -> ModuleType:
    """Return a stand-in for the package, which finds no input."""
    module = ModuleType("sounddevice")

    def query_devices(**_: object) -> None:
        raise error

    module.PortAudioError = RuntimeError  # type: ignore[attr-defined]
    module.query_devices = query_devices  # type: ignore[attr-defined]
    module.default = type("default", (), {"device": (-1, 3)})  # type: ignore[attr-defined]
    return module


def test_without_an_input_the_way_out_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sounddevice", make_sounddevice(RuntimeError("Error querying device -1")))
    [finding] = measure_loopback()
    assert finding.value.startswith("sound is to be recorded, but no sound input opens (there is none); connect one")


def test_a_photodiode_without_a_window_is_not_measured(tmp_path: Path) -> None:
    findings = list(examine_machine(window="none", data=tmp_path, delays=DelayChecks(photodiode=True)))
    [finding] = [finding for finding in findings if finding.name == "photodiode"]
    assert finding.value == "not recorded: no window can be opened"
    assert finding.unfit_because == "the delay of pictures was not measured"
    assert "photodiode" not in {finding.name for finding in examine_machine(window="none", data=tmp_path)}
