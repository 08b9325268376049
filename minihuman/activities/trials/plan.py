"""Plans of blocks of trials, the tables that their options come from, and the time course of a trial."""

from collections.abc import Iterator
from typing import Literal

import msgspec

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.sounds import NOISE, TONE

TimeSpec = float | tuple[float, float] | str  # ms; drawn from a range; or "{column}"
IMAGE_FORMATS = ("PNG", "JPEG", "WEBP")  # of a timeline's images
HZ = 1000.0  # of a tone that names no frequency
SYNTHETIC_LEVEL_DB = -20.0  # of tones and noise that name no level
PlaceSpec = float | str  # a number, or "{column}"
Corner = Literal["top left", "top right", "bottom left", "bottom right"]  # of the picture


class StimuliSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of ``[blocks.stimuli]`` in the protocol: a table of the world options of each trial."""

    file: str = ""  # CSV beside the protocol, columns by name
    rows: tuple[dict[str, str | int | float | bool], ...] = ()  # or the rows themselves
    order: Literal["shuffled", "fixed"] = "shuffled"
    labels: tuple[str, ...] = ()  # columns that say what kind of trial a row is, where the world's options do not tell
    balanced_by: tuple[str, ...] = ()  # columns whose levels keep their shares where part of the table is played
    max_run: dict[str, int] = {}  # column -> how often one of its levels comes in a row at most


class TimelineStimulus(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One stimulus of a timeline: what it shows, where, and from when to when.

    A text, shape, image, sound, colour, number or time may be ``"{column}"``, a cell of the trial's row or a world
    option. A stimulus whose text, shape, image or sound comes from an empty cell is not presented and keeps its time.
    """

    name: str
    text: str = ""
    shape: str = ""  # "circle", "square", "diamond"
    image: str = ""  # a picture beside the protocol
    colour: str = "#e8e6e1"
    size: PlaceSpec = 0.2  # of the picture's height
    x: PlaceSpec = 0.5  # of the width: a number, or "left", "centre", "right"
    y: PlaceSpec = 0.5  # of the height, from the top
    layout: Literal["line", "ring"] = "line"  # "ring": the words of the text stand around the centre
    layer: int = 0  # a higher one is in front
    onset_ms: TimeSpec | None = None  # since the trial's first picture; absent: when the stimulus before it ends
    after: str = ""  # onset_ms counts from this stimulus's end
    since: str = ""  # onset_ms counts from this stimulus's onset
    duration_ms: TimeSpec | None = None
    each_ms: TimeSpec | None = None  # the words of the text come one after the other, each for so long
    until: Literal["", "response", "end"] = ""  # it goes at the response, or stays to the trial's end
    # of a sound; unset where there is none, as plans were written before there were sounds
    sound: str | msgspec.UnsetType = msgspec.UNSET  # "tone", "noise", or a sound file beside the protocol
    hz: PlaceSpec | msgspec.UnsetType = msgspec.UNSET  # of a tone; 1000 unless said otherwise
    level_db: PlaceSpec | msgspec.UnsetType = msgspec.UNSET  # absent: -20 for tones and noise, 0 for a file
    ear: str | msgspec.UnsetType = msgspec.UNSET  # "both", "left", "right"
    feedback: Literal["goal", "failure", "timeout"] | msgspec.UnsetType = msgspec.UNSET  # it sounds with this feedback


class TimelineSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The time course of a block's trials, ``[blocks.timeline]`` in the protocol."""

    stimuli: tuple[TimelineStimulus, ...]
    target: str = ""  # response times count from its onset; "": the last stimulus
    opens_ms: float = 0.0  # responses are taken from so long after the target's onset
    responses: int = 1  # how many are taken; the last of them counts
    ends: Literal["response", "time"] = "response"  # "time": a response does not end the trial
    soa_ms: float = 0.0  # from one trial's first picture to the next one's, by the clock; 0: no rhythm
    # where a square for a photodiode is, white in a trial's first picture, black in its second, and so on; unset where
    # there is none, as plans were written before there were such squares
    photodiode: Corner | msgspec.UnsetType = msgspec.UNSET

    @property
    def target_name(self) -> str:
        """Return the name of the stimulus from whose onset response times count."""
        names = [stimulus.name for stimulus in self.stimuli if not stimulus.feedback]
        return self.target or names[-1]

    def describe(self, deadline_ms: float) -> Iterator[str]:
        """Yield phrases, for a methods section, on what a trial shows and when, and when responses are taken.

        ``deadline_ms`` is the time for a response after the target's onset in milliseconds; 0 for no deadline.
        """
        presented = [stimulus for stimulus in self.stimuli if not stimulus.feedback]
        yield "each trial showed " + ", ".join(_describe_stimulus(stimulus) for stimulus in presented)
        target = self.target_name
        opens = f" from {self.opens_ms:g} ms on" if self.opens_ms else ""
        until = f", at most {deadline_ms:g} ms" if deadline_ms else ""
        for stimulus in self.stimuli:
            if stimulus.feedback:
                yield f"{_describe_sound(stimulus)} began with the feedback after the outcome {stimulus.feedback!r}"
        yield f"response times count from the onset of {target!r}; responses were taken{opens} after it{until}"
        if self.ends == "time":
            yield "a response did not end the trial"
        if self.soa_ms:
            yield f"one trial began every {self.soa_ms:g} ms"
        if self.photodiode:
            yield f"a square for a photodiode ({self.photodiode}) changed between white and black with each picture"


class TrialsPlan(PlayPlan, frozen=True):
    """The plan of a block of trials."""

    timeline: TimelineSpec | msgspec.UnsetType = msgspec.UNSET  # unset where a trial is a single picture

    def describe_trials(self, deadline_ms: float) -> Iterator[str]:
        """Yield what a trial shows and when, and when responses are taken; nothing without a time course."""
        if self.timeline:
            yield from self.timeline.describe(deadline_ms)


def _describe_stimulus(stimulus: TimelineStimulus) -> str:
    """Return a stimulus's name with when it begins and how long it lasts."""
    parts = [f"{stimulus.name!r}"]
    if stimulus.sound:
        parts.append(f"({_describe_sound(stimulus)})")
    if stimulus.since:
        parts.append(f"{_describe_time(stimulus.onset_ms)} after the onset of {stimulus.since!r}")
    elif stimulus.after:
        parts.append(f"{_describe_time(stimulus.onset_ms)} after the end of {stimulus.after!r}")
    elif stimulus.onset_ms is not None:
        parts.append(f"from {_describe_time(stimulus.onset_ms)} on")
    if stimulus.each_ms is not None:
        parts.append(f"{_describe_time(stimulus.each_ms)} for each of its words")
    if stimulus.duration_ms is not None:
        parts.append(f"for {_describe_time(stimulus.duration_ms)}")
    if stimulus.until == "response":
        parts.append("until the response")
    elif stimulus.until == "end":
        parts.append("until the end of the trial")
    return " ".join(parts)


def _describe_sound(stimulus: TimelineStimulus) -> str:
    """Return what a sound is, how loud it is, and which ear hears it."""
    source = stimulus.sound or ""
    level_db = stimulus.level_db
    if source == TONE:
        hz = HZ if stimulus.hz is msgspec.UNSET else stimulus.hz
        description = f"a tone of {_describe_cell(hz, 'frequency', ' Hz')}"
    elif source == NOISE:
        description = "white noise"
    else:
        description = f"the sound {source!r}" if "{" not in source else _describe_cell(source, "sound", "")
    if level_db is msgspec.UNSET and source in (TONE, NOISE):
        level_db = SYNTHETIC_LEVEL_DB
    if level_db is not msgspec.UNSET:
        description += f" at {_describe_cell(level_db, 'level', ' dB')}"
    if stimulus.ear and stimulus.ear in ("left", "right"):
        description += f" for the {stimulus.ear} ear"
    elif stimulus.ear and stimulus.ear != "both":
        description += f" for {_describe_cell(stimulus.ear, 'ear', '')}"
    return description


def _describe_cell(written: PlaceSpec, noun: str, unit: str) -> str:
    """Return a number with its unit, or, for a reference such as "{hz}", the noun with the column's name."""
    if isinstance(written, str):
        return f"the {noun} in column {written.strip('{}')!r}"
    return f"{written:g}{unit}"


def _describe_time(time: TimeSpec | None) -> str:
    """Return a time in ms, the range from which it is drawn, or the column that has it; None is 0 ms."""
    if isinstance(time, tuple):
        return f"{time[0]:g} to {time[1]:g} ms (drawn)"
    if isinstance(time, str):
        return f"the time in column {time.strip('{}')!r}"
    return f"{time or 0:g} ms"
