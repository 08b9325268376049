"""Sounds: tones, noise and sound files as samples. No device and no clock.

The desk and the page play the same samples: both get them from here.
"""

import hashlib
import io
import math
import wave
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError

TONE = "tone"
NOISE = "noise"
EARS = ("both", "left", "right")
SOUND_FORMATS = ("WAV", "FLAC", "OGG")
LOWEST_LEVEL_DB = -120.0
LONGEST_SOUND_S = 600.0
PAGE_RATE_HZ = 48_000  # the rate of the sounds that pages receive
EXTRA = 'pip install "minihuman-lab[sound]"'
_RAMP_S = 0.005  # ramp of tones, noise and shortened files, which would click without it
_SILENCE_S = 0.1  # added around samples before resampling
_NOISE_SEED = 51  # fixed, so that the noise is the same in each trial
_MAX_SAMPLE = 32767  # of 16 bits


class SoundContent(msgspec.Struct, frozen=True):
    """The source of a sound, and its level, ear and duration."""

    source: str  # TONE, NOISE, or a file of the protocol
    hz: float  # of a tone
    level_db: (
        float  # the peak of a tone or noise in relation to full scale; for a file, what its samples are changed by
    )
    ear: Literal["both", "left", "right"]
    lasts_ms: float  # 0 for a file's own length

    @property
    def file(self) -> str:
        """Return the name of the file; "" for a tone or noise."""
        return "" if self.source in (TONE, NOISE) else self.source


@dataclass(frozen=True, slots=True)
class SoundCue:
    """A sound that is scheduled to begin at a time, or is playing."""

    number: int  # unique in the session
    content: SoundContent
    due_ns: int  # session time


def compute_digest(content: SoundContent, files: Mapping[str, bytes]) -> str:
    """Return a sound's digest, 32 hexadecimal digits; it depends on a file's content but not on the file's name."""
    nameless = msgspec.structs.replace(content, source="file") if content.file else content
    digest = hashlib.sha256(msgspec.json.encode(nameless))
    digest.update(files.get(content.file, b""))
    return digest.hexdigest()[:32]


def render_sound(content: SoundContent, files: Mapping[str, bytes], rate_hz: int) -> NDArray[np.float32]:
    """Return a sound's samples, float32[n, 2] from -1 to 1, for the left and the right ear.

    Args:
        content: the sound.
        files: the contents of the protocol's files, by name.
        rate_hz: the number of samples per second.

    Raises:
        WorldError: if the file is missing or cannot be decoded, or if the package ``soundfile`` is not installed.
    """
    count = round(content.lasts_ms * rate_hz / 1000)
    if content.source == TONE:
        samples = np.sin(2 * np.pi * content.hz / rate_hz * np.arange(count))[:, None]
    elif content.source == NOISE:
        samples = np.random.default_rng(_NOISE_SEED).uniform(-1.0, 1.0, (count, 1))
    else:
        samples = _decode_file(content.file, files, rate_hz)
    begins_softly = not content.file
    ends_softly = begins_softly or 0 < count < len(samples)
    if count:
        samples = samples[:count]
    samples = samples * 10 ** (content.level_db / 20)
    ramp_length = min(len(samples), round(_RAMP_S * rate_hz))
    ramp = np.sin(np.linspace(0, np.pi / 2, ramp_length, endpoint=False)) ** 2
    if begins_softly:
        samples[:ramp_length] *= ramp[:, None]
    if ends_softly and ramp_length:
        samples[-ramp_length:] *= ramp[::-1, None]
    return _route_to_ears(samples, content.ear).clip(-1.0, 1.0).astype(np.float32)


def encode_wav(samples: NDArray[np.float32], rate_hz: int) -> bytes:
    """Return samples, float32[n, 2], as a WAV file of 16 bits, with one channel if both ears' samples are equal."""
    is_mono = bool(np.array_equal(samples[:, 0], samples[:, 1]))
    channels = samples[:, :1] if is_mono else samples
    encoded = io.BytesIO()
    with wave.open(encoded, "wb") as file:
        file.setnchannels(channels.shape[1])
        file.setsampwidth(2)
        file.setframerate(rate_hz)
        file.writeframes(np.round(channels * _MAX_SAMPLE).astype("<i2").tobytes())
    return encoded.getvalue()


def _route_to_ears(samples: NDArray[np.float64], ear: str) -> NDArray[np.float64]:
    """Return the samples for both ears, float64[n, 2], from one or two channels, float64[n, 1 or 2].

    If ``ear`` is "left" or "right", that ear gets the mean of the channels and the other ear silence.
    """
    if ear == "both":
        return np.repeat(samples, 2, axis=1) if samples.shape[1] == 1 else samples
    ear_samples = np.zeros((len(samples), 2))
    column = 0 if ear == "left" else 1
    ear_samples[:, column] = samples.mean(axis=1)
    return ear_samples


def _decode_file(name: str, files: Mapping[str, bytes], rate_hz: int) -> NDArray[np.float64]:
    """Return the samples of a sound file of one or two channels, resampled to a rate, as float64[n, 1 or 2].

    Raises:
        WorldError: if the file is missing, has another format or length, or cannot be decoded.
    """
    content = files.get(name)
    if content is None:
        raise WorldError(f"sound {name!r} is not in the protocol's folder; copy it there")
    soundfile = _import_soundfile(name)
    try:
        with soundfile.SoundFile(io.BytesIO(content)) as file:
            format_name, channels, file_rate_hz = file.format, file.channels, file.samplerate
            is_readable = format_name in SOUND_FORMATS and channels in (1, 2)
            is_readable = is_readable and 0 < file.frames <= LONGEST_SOUND_S * file_rate_hz
            samples = file.read(dtype="float64", always_2d=True) if is_readable else None
    except (soundfile.SoundFileError, RuntimeError, ValueError, TypeError) as error:
        raise WorldError(
            f"sound {name!r} is no WAV, FLAC or OGG ({type(error).__name__}); save it as one of these"
        ) from error
    if samples is None or not np.isfinite(samples).all():
        raise WorldError(
            f"sound {name!r} is {format_name} with {channels} channels; use WAV, FLAC or OGG with 1 or 2 channels of "
            f"finite samples, neither empty nor longer than {LONGEST_SOUND_S:g} s"
        )
    return _resample(samples, file_rate_hz, rate_hz)


def _resample(samples: NDArray[np.float64], from_hz: int, to_hz: int) -> NDArray[np.float64]:
    """Return channels, float64[n, 1 or 2], at another number of samples per second, by the Fourier transform.

    Frequencies that the lower rate cannot represent are removed. Silence is added around the samples for the transform,
    which treats them as periodic, and is removed afterwards.
    """
    if from_hz == to_hz:
        return samples
    unit = from_hz // math.gcd(from_hz, to_hz)  # the fewest samples that become a whole number of samples
    silence_length = unit * math.ceil(_SILENCE_S * from_hz / unit)
    count = unit * math.ceil((len(samples) + 2 * silence_length) / unit)
    padded = np.zeros((count, samples.shape[1]))
    padded[silence_length : silence_length + len(samples)] = samples
    new_count = count * to_hz // from_hz
    resampled = np.fft.irfft(np.fft.rfft(padded, axis=0), new_count, axis=0) * new_count / count
    begin = silence_length * to_hz // from_hz
    return resampled[begin : begin + round(len(samples) * to_hz / from_hz)]


def _import_soundfile(name: str) -> Any:
    """Return the module ``soundfile``, which decodes the sound of a given name.

    Raises:
        WorldError: if the package is not installed.
    """
    try:
        import soundfile
    except (ImportError, OSError) as error:  # OSError if the system's library is missing
        raise WorldError(f"sound {name!r} needs the package soundfile; {EXTRA}") from error
    return soundfile
