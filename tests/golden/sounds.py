"""A frozen study with sounds: noise, tones and files, for one ear and for both, with pictures, and as feedback."""

import io
import wave

import msgspec
import numpy as np
from PIL import Image

from minihuman.experiment.protocol.protocol import Protocol, decode_protocol

SOUNDS = """
[study]
name = "sounds"
version = "1"
seed = 11
participants = 4
[keys]
pool = ["f", "j"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["words", "tones"]
[[blocks]]
name = "words"
kind = "trials"
world = "minihuman/Stimulus-v0"
stimuli = { file = "words.csv", balanced_by = ["congruent"] }
timeline.target = "word"
timeline.stimuli = [
  { name = "fixation", text = "+", size = 0.08, duration_ms = [400, 700] },
  { name = "warning", sound = "noise", level_db = -30, ear = "{ear}", onset_ms = 20, duration_ms = 100 },
  { name = "word", sound = "{word}", ear = "{ear}", after = "warning", onset_ms = 300, until = "end" },
  { name = "picture", image = "{picture}", since = "word", onset_ms = 50, until = "response" },
  { name = "buzz", sound = "tone", hz = 220, duration_ms = 150, feedback = "failure" },
]
feedback = { failure = "Wrong" }
feedback_ms = 600
episodes = 8
actions = ["left", "right"]
noop_action = "none"
response_deadline_ms = 1500
max_steps = 1
ready = "first"
inter_trial_interval_ms = [300, 500]
[[blocks]]
name = "tones"
kind = "trials"
world = "minihuman/Stimulus-v0"
stimuli = { rows = [{ hz = 1000, correct = "none", times = 2 }, { hz = 1500, correct = "left" }], order = "fixed" }
timeline.ends = "time"
timeline.soa_ms = 1100
timeline.target = "tone"
timeline.stimuli = [
  { name = "fixation", text = "+", size = 0.08, until = "end" },
  { name = "tone", sound = "tone", hz = "{hz}", level_db = -26, onset_ms = 200, duration_ms = 70 },
]
episodes = 6
actions = ["left", "right"]
noop_action = "none"
response_deadline_ms = 700
max_steps = 1
ready = "none"
"""
TABLE = (
    b"word,ear,picture,correct,congruent\n"
    b"low.wav,left,dark.png,left,yes\nhigh.wav,right,light.png,right,yes\n"
    b"low.wav,right,light.png,left,no\nhigh.wav,both,,right,no\n"
)


def build_sounds() -> Protocol:
    """Return the study with its table, two sound files and two pictures."""
    files = {"words.csv": TABLE, "low.wav": encode_tone(300, channels=1), "high.wav": encode_tone(600, channels=2)}
    for name, colour in (("dark.png", "navy"), ("light.png", "white")):
        Image.new("RGB", (8, 8), colour).save(picture := io.BytesIO(), "PNG")
        files[name] = picture.getvalue()
    return msgspec.structs.replace(decode_protocol(SOUNDS.encode()), files=files)


def encode_tone(hz: float, *, channels: int) -> bytes:
    """Encode 80 ms of a tone as a WAV file of 8,000 samples a second."""
    samples = np.round(8_000 * np.sin(2 * np.pi * hz / 8_000 * np.arange(640))).astype("<i2")
    encoded = io.BytesIO()
    with wave.open(encoded, "wb") as file:
        file.setnchannels(channels)
        file.setsampwidth(2)
        file.setframerate(8_000)
        file.writeframes(np.repeat(samples, channels).tobytes())
    return encoded.getvalue()
