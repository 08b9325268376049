"""The schedule of a trial: from when to when each stimulus is shown and responses are taken. No clock and no I/O.

A timeline and the cells of a trial's row resolve to times in nanoseconds since the trial's first picture. Windows, the
page, the session and `verify` all go by this schedule.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

import msgspec

from minihuman.activities.trials.plan import HZ, SYNTHETIC_LEVEL_DB, PlaceSpec, TimelineSpec, TimelineStimulus, TimeSpec
from minihuman.errors import WorldError
from minihuman.experiment.sounds import EARS, LOWEST_LEVEL_DB, NOISE, TONE, SoundContent

NS_PER_MS = 1_000_000
LONGEST_MS = 3_600_000.0
PREPARATION_MS = 100.0  # in a block with a rhythm, the time in which the next trial is prepared
MOST_STIMULI = 500  # in a trial
CUES_PER_TRIAL = MOST_STIMULI + 1  # the numbers of a trial's sounds; the last one is for the sound of its feedback
CUE_TRIALS_PER_PART = 100_000  # how many trials of a part have numbers of their own for their sounds, in a segment
DRAWS_PER_STIMULUS = 2  # random shares: one for its onset, one for its duration
SOUND_LEAD_MS = 150.0  # how long before it is due a device gets a sound: 9 frames at 60 Hz, 18 at 120 Hz
SOUND_LEAD_NS = round(SOUND_LEAD_MS * NS_PER_MS)
_REFERENCE = re.compile(r"\{([^{}]+)\}")
_LOWEST_HZ = 20.0  # of a tone: the lowest and the highest audible frequency
_HIGHEST_HZ = 20_000.0
_PLACES = {"left": 0.25, "centre": 0.5, "right": 0.75}
_TIME_DRAWS = {"onset_ms": 0, "duration_ms": 1, "each_ms": 1}  # which of a stimulus's random shares each field uses

Cells = Mapping[str, Any]  # of a trial's row, by column
DrawShare = Callable[[int], float]  # the random share, 0 to 1, of a number: two numbers per stimulus of the timeline


class StimulusContent(msgspec.Struct, frozen=True):
    """What a stimulus shows, and where; lengths are shares of the picture's width (x) and height."""

    text: str
    shape: str
    image: str
    colour: str
    size: float
    x: float
    y: float
    layout: Literal["line", "ring"]


class ScheduledStimulus(msgspec.Struct, frozen=True):
    """A stimulus of one trial, with its times since the trial's first picture."""

    name: str
    content: StimulusContent
    layer: int
    onset_ns: int
    end_ns: int | None  # None: it stays to the trial's end
    until_response: bool


class ScheduledSound(msgspec.Struct, frozen=True):
    """A sound of one trial, with its times since the trial's first picture."""

    name: str
    content: SoundContent
    onset_ns: int
    end_ns: int | None  # None: it plays to its end, or to the trial's
    until_response: bool

    @property
    def is_early(self) -> bool:
        """Return whether a device has to get the sound before the first picture is shown."""
        return self.onset_ns < SOUND_LEAD_NS


class TrialSchedule(msgspec.Struct, frozen=True):
    """The schedule of one trial; times are nanoseconds since its first picture."""

    stimuli: tuple[ScheduledStimulus, ...]  # those that are shown
    target: str
    target_ns: int
    opens_ns: int  # when responses begin to be taken
    closes_ns: int | None  # the deadline; None: there is none
    responses: int  # how many are taken
    ends_at_response: bool
    end_ns: int | None  # when the trial ends without a response; None: never
    sounds: tuple[ScheduledSound, ...] | msgspec.UnsetType = msgspec.UNSET  # unset where there are none
    feedback: dict[str, SoundContent] | msgspec.UnsetType = msgspec.UNSET  # by outcome; unset where there is none

    @property
    def sound_list(self) -> tuple[ScheduledSound, ...]:
        """Return the sounds, in the order of the timeline."""
        return self.sounds or ()

    @property
    def sound_contents(self) -> tuple[SoundContent, ...]:
        """Return the contents of all sounds, those of the feedback included."""
        return (*(sound.content for sound in self.sound_list), *(self.feedback or {}).values())

    @property
    def changes_ns(self) -> tuple[int, ...]:
        """Return the times at which the picture changes or the target begins, from 0 for the first picture."""
        candidates_ns = {0}
        for stimulus in self.stimuli:
            candidates_ns |= {stimulus.onset_ns, stimulus.end_ns or 0}
        sorted_ns = sorted(time_ns for time_ns in candidates_ns if self.end_ns is None or time_ns < self.end_ns)
        changes_ns = sorted_ns[:1]
        for time_ns in sorted_ns[1:]:
            if self.find_visible(time_ns) != self.find_visible(changes_ns[-1]) or time_ns == self.target_ns:
                changes_ns.append(time_ns)
        return tuple(changes_ns)

    def find_visible(self, time_ns: int, *, has_response: bool = False) -> tuple[ScheduledStimulus, ...]:
        """Return the stimuli that are visible at a time, the front one last.

        ``has_response`` leaves out the stimuli that a response removes.
        """
        visible = [
            stimulus
            for stimulus in self.stimuli
            if stimulus.onset_ns <= time_ns
            and (stimulus.end_ns is None or time_ns < stimulus.end_ns)
            and not (has_response and stimulus.until_response)
        ]
        return tuple(sorted(visible, key=lambda stimulus: stimulus.layer))

    def find_onset_ns(self, name: str) -> int | None:
        """Return when a stimulus or sound of a name begins; None if it is not presented."""
        onsets_ns = {sound.name: sound.onset_ns for sound in self.sound_list}
        onsets_ns |= {stimulus.name: stimulus.onset_ns for stimulus in self.stimuli}
        return onsets_ns.get(name)


def resolve_trial(timeline: TimelineSpec, cells: Cells, deadline_ms: float, draw: DrawShare) -> TrialSchedule:
    """Resolve a block's timeline for one trial, and return the trial's schedule.

    Args:
        timeline: the block's timeline.
        cells: the cells of the trial's row and its world options, by column.
        deadline_ms: how long after the target's onset responses are taken; 0 for no deadline.
        draw: returns the random share, from 0 to 1, of a number; each stimulus has `DRAWS_PER_STIMULUS` numbers.

    Raises:
        WorldError: if a cell is missing, or is not a valid time or number; the message names the stimulus and its
            field. Also if the trial has too many stimuli, or a stimulus has no known beginning.
    """
    spans = _Spans(timeline, cells, draw)
    stimuli = [stimulus for spec in timeline.stimuli for stimulus in spans.resolve(spec)]
    n_stimuli = len(stimuli) + len(spans.sounds)
    if n_stimuli > MOST_STIMULI:
        raise WorldError(f"timeline shows {n_stimuli} stimuli in a trial; use at most {MOST_STIMULI}")
    target = timeline.target_name
    target_ns = spans.onsets_ns[target]
    closes_ns = None
    if deadline_ms:
        closes_ns = target_ns + round(deadline_ms * NS_PER_MS)
    end_ns = closes_ns
    if timeline.ends == "time":
        ends_ns = [end for end in (*spans.ends_ns.values(), closes_ns) if end is not None]
        end_ns = max(ends_ns, default=target_ns)
    return TrialSchedule(
        stimuli=tuple(stimuli),
        target=target,
        target_ns=target_ns,
        opens_ns=target_ns + round(timeline.opens_ms * NS_PER_MS),
        closes_ns=closes_ns,
        responses=timeline.responses,
        ends_at_response=timeline.ends == "response",
        end_ns=end_ns,
        sounds=tuple(spans.sounds) or msgspec.UNSET,
        feedback=spans.feedback or msgspec.UNSET,
    )


def list_columns(stimulus: TimelineStimulus) -> dict[str, str]:
    """Return the columns to which a stimulus refers, each with the first field that refers to it."""
    columns: dict[str, str] = {}
    for field in stimulus.__struct_fields__:
        written = getattr(stimulus, field)
        if isinstance(written, str):
            for column in _REFERENCE.findall(written):
                columns.setdefault(column, field)
    return columns


def fill_references(written: str, cells: Cells) -> Any:
    """Return a text with each reference "{column}" replaced by that column's cell; a missing cell is an empty text.

    For a text that is a single reference, return the cell itself, which can be a number.
    """
    single_reference = _REFERENCE.fullmatch(written)
    if single_reference:
        return cells.get(single_reference[1], "")
    return _REFERENCE.sub(lambda match: str(cells.get(match[1], "")), written)


class _Spans:
    """The times of a trial's stimuli and sounds, which are resolved one after the other in the timeline's order."""

    def __init__(self, timeline: TimelineSpec, cells: Cells, draw: DrawShare) -> None:
        self.onsets_ns: dict[str, int] = {}
        self.ends_ns: dict[str, int | None] = {}
        self.sounds: list[ScheduledSound] = []
        self.feedback: dict[str, SoundContent] = {}
        self._last_end_ns: int | None = 0
        self._indices = {stimulus.name: index for index, stimulus in enumerate(timeline.stimuli)}
        self._cells = cells
        self._draw = draw

    def resolve(self, spec: TimelineStimulus) -> Iterator[ScheduledStimulus]:
        """Resolve the next stimulus and record its times; yield it, or each of its words, if it is shown.

        A sound is recorded in ``sounds``, and a sound of the feedback in ``feedback``.
        """
        if spec.feedback:
            self._resolve_feedback(spec)
            return
        content = self._read_content(spec)
        contents = [content] if content is not None else []
        onset_ns = self._find_begin_ns(spec) + round(self._read_time(spec, "onset_ms") * NS_PER_MS)
        end_ns: int | None = None
        each_ns = 0
        if spec.each_ms is not None:
            if content is not None:
                contents = [msgspec.structs.replace(content, text=word) for word in content.text.split()]
            each_ns = round(self._read_time(spec, "each_ms") * NS_PER_MS)
            end_ns = onset_ns + each_ns * len(contents)
        elif spec.duration_ms is not None:
            end_ns = onset_ns + round(self._read_time(spec, "duration_ms") * NS_PER_MS)
        self.onsets_ns[spec.name] = onset_ns
        self.ends_ns[spec.name] = self._last_end_ns = end_ns
        if sound := self._read_sound(spec, 0 if end_ns is None else end_ns - onset_ns):
            self.sounds.append(ScheduledSound(spec.name, sound, onset_ns, end_ns, spec.until == "response"))
        for index, word_content in enumerate(contents):
            name = spec.name
            word_end_ns = end_ns
            if spec.each_ms is not None:
                name = f"{spec.name}-{index + 1}"
                word_end_ns = onset_ns + each_ns * (index + 1)
            begin_ns = onset_ns + each_ns * index
            if word_end_ns is None or word_end_ns > begin_ns:
                yield ScheduledStimulus(name, word_content, spec.layer, begin_ns, word_end_ns, spec.until == "response")

    def _find_begin_ns(self, spec: TimelineStimulus) -> int:
        """Return the time from which a stimulus's onset counts; raise `WorldError` if it is an end that is unknown."""
        if spec.since:
            return self.onsets_ns[spec.since]
        begin_ns: int | None = 0
        if spec.after:
            begin_ns = self.ends_ns[spec.after]
        elif spec.onset_ms is None:
            begin_ns = self._last_end_ns
        if begin_ns is None:
            raise WorldError(
                f"timeline: stimulus {spec.name!r} begins when another ends, which has no duration_ms; give it one, or "
                "use since and onset_ms"
            )
        return begin_ns

    def _read_time(self, spec: TimelineStimulus, field: Literal["onset_ms", "duration_ms", "each_ms"]) -> float:
        """Return a stimulus's time in ms: as written, from the table, or drawn between two bounds; 0 if not given."""
        written: TimeSpec | None = getattr(spec, field)
        if written is None:
            return 0.0
        if isinstance(written, tuple):
            share = self._draw(DRAWS_PER_STIMULUS * self._indices[spec.name] + _TIME_DRAWS[field])
            return float(round(written[0] + share * (written[1] - written[0])))
        return self._read_number(spec, field, written, low=0.0, high=LONGEST_MS)

    def _read_number(self, spec: TimelineStimulus, field: str, written: PlaceSpec, *, low: float, high: float) -> float:
        """Return a field's number, as written or from the table; raise `WorldError` unless it is within the bounds."""
        cell: Any = written
        if isinstance(written, str):
            cell = fill_references(written, self._cells)
            cell = _PLACES.get(cell, cell) if field == "x" else cell
        try:
            number = float(cell)
        except (TypeError, ValueError):
            number = float("nan")
        if isinstance(cell, bool) or not low <= number <= high:
            raise WorldError(
                f"timeline: stimulus {spec.name!r}: {field} is {cell!r}; use a number from {low:g} to {high:g}"
            )
        return number

    def _resolve_feedback(self, spec: TimelineStimulus) -> None:
        """Record the sound that follows a trial with the outcome that the stimulus names, if it has one."""
        lasts_ns = round(self._read_time(spec, "duration_ms") * NS_PER_MS)
        content = self._read_sound(spec, lasts_ns)
        if spec.feedback and content is not None:
            self.feedback[spec.feedback] = content

    def _read_sound(self, spec: TimelineStimulus, lasts_ns: int) -> SoundContent | None:
        """Return the sound of a stimulus that lasts for ``lasts_ns``; None if it has no sound in this trial.

        A duration of 0 plays a sound file to its end.
        """
        source = str(fill_references(spec.sound or "", self._cells)).strip()
        if not source:
            return None
        hz = HZ if spec.hz is msgspec.UNSET else spec.hz
        default_level_db = SYNTHETIC_LEVEL_DB if source in (TONE, NOISE) else 0.0
        level_db = default_level_db if spec.level_db is msgspec.UNSET else spec.level_db
        ear: Any = str(fill_references(spec.ear or "both", self._cells)).strip()
        if ear not in EARS:
            raise WorldError(f"timeline: stimulus {spec.name!r}: ear is {ear!r}; use one of {', '.join(EARS)}")
        return SoundContent(
            source=source,
            hz=self._read_number(spec, "hz", hz, low=_LOWEST_HZ, high=_HIGHEST_HZ) if source == TONE else 0.0,
            level_db=self._read_number(spec, "level_db", level_db, low=LOWEST_LEVEL_DB, high=0.0),
            ear=ear,
            lasts_ms=lasts_ns / NS_PER_MS,
        )

    def _read_content(self, spec: TimelineStimulus) -> StimulusContent | None:
        """Return what a stimulus shows; None if it shows nothing in this trial."""
        text, shape, image = (
            str(fill_references(getattr(spec, field), self._cells)) for field in ("text", "shape", "image")
        )
        if not (text or shape or image):
            return None
        return StimulusContent(
            text=text,
            shape=shape,
            image=image,
            colour=str(fill_references(spec.colour, self._cells)),
            size=self._read_number(spec, "size", spec.size, low=0.001, high=2.0),
            x=self._read_number(spec, "x", spec.x, low=0.0, high=1.0),
            y=self._read_number(spec, "y", spec.y, low=0.0, high=1.0),
            layout=spec.layout,
        )
