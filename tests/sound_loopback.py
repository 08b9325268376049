"""Sessions with sounds whose onsets are recorded by another program, and compared with what the log says of them."""

import io
import subprocess
import sys
import time
import wave
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.trials.events import SoundPlayed, StimuliShown
from minihuman.log.read.session_reader import read_log
from tests.counts import PATIENCE_S
from tests.machine import need
from tests.null_sink import NullSink
from tests.programs import running
from tests.web.browser import Somebody, driving
from tests.web.firefox import firefox_at
from tests.web.serving import serving

_TOML = """
study = {{ name = "loopback", version = "1.0", seed = 1, closing = "" }}
keys = {{ pool = ["space"], keyboard_check = false }}
groups = [{{ name = "everyone", blocks = ["clicks"] }}]
[[blocks]]
name = "clicks"
kind = "trials"
world = "minihuman/Stimulus-v0"
options = {{ responses = ["press"] }}
episodes = {trials}
actions = ["press"]
noop_action = "none"
response_deadline_ms = 500
max_steps = 1
ready = "{ready}"
final_frame_ms = 0
inter_trial_interval_ms = [100, 150]
[blocks.timeline]
ends = "time"
stimuli = [
  {{ name = "disc", shape = "circle", until = "end" }},
  {{ name = "click", sound = "click.wav", until = "end", onset_ms = {onset_ms} }},
]
"""


def write_study(folder: Path, *, trials: int, onset_ms: float, ready: str = "none") -> Path:
    """Write a study whose trials show a disc and click so long after it; return its protocol."""
    path = folder / "loopback.toml"
    path.write_text(_TOML.format(trials=trials, onset_ms=onset_ms, ready=ready))
    (folder / "click.wav").write_bytes(encode_click())
    return path


def encode_click() -> bytes:
    """A WAV file of 20 ms, loud from its first sample on."""
    samples = np.where(np.arange(960) // 24 % 2, -20_000, 20_000).astype("<i2")
    encoded = io.BytesIO()
    with wave.open(encoded, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(48_000)
        file.writeframes(samples.tobytes())
    return encoded.getvalue()


@dataclass(frozen=True)
class Comparison:
    """Recorded onsets beside those in the log, one for each sound; times are ms, of each clock its own."""

    recorded: NDArray[np.float64]
    reported: NDArray[np.float64]
    uncertainty: NDArray[np.float64]
    after_flip: NDArray[np.float64]  # from the flip of the trial's first picture to the reported onset

    @property
    def claim_errors(self) -> NDArray[np.float64]:
        """What is left of the recorded onsets when the reported ones are known; the clocks may drift apart evenly."""
        line = np.polynomial.Polynomial.fit(self.reported, self.recorded, 1)
        return self.recorded - line(self.reported)

    @property
    def from_picture(self) -> NDArray[np.float64]:
        """From the flip of a picture to its recorded sound, but for a constant."""
        from_picture = self.after_flip + self.claim_errors
        return from_picture - from_picture.mean()

    @property
    def within_claim(self) -> float:
        """The share of the reports whose error is below what they state."""
        return float(np.mean(np.abs(self.claim_errors) <= self.uncertainty))

    def describe(self) -> str:
        """Return the figures in a line."""
        errors = self.claim_errors
        return (
            f"{len(errors)} sounds; recorded minus reported: SD {errors.std():.3f} ms, at most "
            f"{np.abs(errors).max():.3f} ms, {100 * self.within_claim:.1f} % within the stated uncertainty (median "
            f"{np.median(self.uncertainty):.2f} ms); after the picture: SD {self.from_picture.std():.3f} ms"
        )


def compare(log: Path, sink: NullSink) -> Comparison:
    """Compare the sounds of a session's log with the recording; both have to be complete."""
    events = [event for segment in read_log(log).segments for event in segment.part_events]
    flips = {event.episode: event.flip_ns for event in events if isinstance(event, StimuliShown) and event.frame == 0}
    played = [event for event in events if isinstance(event, SoundPlayed)]
    recorded = sink.read_onsets_ms()
    assert len(recorded) == len(played), f"{len(recorded)} sounds were recorded, {len(played)} are in the log"
    return Comparison(
        recorded,
        np.array([event.onset_ns / 1e6 for event in played]),
        np.array([event.uncertainty_ms for event in played]),
        np.array([(event.onset_ns - flips[event.episode]) / 1e6 for event in played]),
    )


def play_at_desk(protocol: Path, data: Path, sink: NullSink, display: str) -> Path:
    """Play a study that asks for nothing in a window; return its log."""
    command = [sys.executable, "-m", "minihuman", "run", str(protocol), "--data", str(data), "--window", "pygame"]
    environment = {**sink.environment, "DISPLAY": display}
    with running([*command, "--windowed"], env=environment, stdout=subprocess.PIPE, text=True) as program:
        program.communicate(timeout=10 * PATIENCE_S)
    [log] = data.rglob("*.mcap")
    return log


def play_in_firefox(protocol: Path, data: Path, sink: NullSink) -> Path:
    """Play a study that asks for Enter alone in Firefox; return its log."""
    with serving(protocol, data) as served:
        address = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        with firefox_at(address, data.with_name("profile"), environment=sink.environment) as page:
            page.until("s.welcomed && s.kind !== ''")
            while not page.find("minihuman.state.finished"):
                if page.find("minihuman.state.kind") not in ("trial", "blank", "play"):
                    page.press("enter")
                time.sleep(0.2)
    [log] = data.rglob("*.mcap")
    return log


def play_in_chromium(protocol: Path, data: Path, sink: NullSink) -> Path:
    """Play a study that asks for Enter alone in Chromium; return its log."""
    with serving(protocol, data) as served, driving() as driver:
        browser = driver.chromium.launch(
            executable_path=need("chromium"),
            args=["--no-sandbox", "--disable-background-networking"],
            ignore_default_args=["--mute-audio"],
            env=sink.environment,
        )
        somebody = Somebody(browser.new_context(), f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.until("s.welcomed && s.kind !== ''")
        somebody.sit_through()
        assert somebody.errors == []
        browser.close()
    [log] = data.rglob("*.mcap")
    return log
