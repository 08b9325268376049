"""What a log says of each trial with a time course: its schedule, and what was shown, heard and pressed."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec

from minihuman.activities.trials.activity import FEEDBACK
from minihuman.activities.trials.events import ResponseTaken, SoundPlayed, StimuliShown, TrialResolved
from minihuman.activities.trials.schedule import NS_PER_MS, ScheduledSound, TrialSchedule
from minihuman.dataset.presented_stimuli import Presentation
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.sounds import SoundContent
from minihuman.log.model.session_log import EpisodeLog, Segment, SessionLog


@dataclass(slots=True)
class TrialRecord:
    """An attempt at a trial with a time course; times are session time in nanoseconds."""

    episode: EpisodeLog
    part: int
    schedule: TrialSchedule
    end_ns: int  # when it was over, or void
    pictures: list[StimuliShown] = field(default_factory=list)
    sounds: list[SoundPlayed] = field(default_factory=list)
    responses: list[ResponseTaken] = field(default_factory=list)

    @property
    def first_flip_ns(self) -> int | None:
        """Return when the first picture was on the display; None if it never was."""
        return next((picture.flip_ns for picture in self.pictures if picture.frame == 0), None)

    def list_missing_sounds(self) -> Iterator[tuple[str, int]]:
        """Yield the name and the intended onset of each sound that was due and did not begin before the trial's end."""
        started_names = {sound.sound for sound in self.sounds}
        for sound in self.schedule.sound_list:
            due_ns = self._find_due_ns(sound)
            if due_ns is not None and sound.name not in started_names:
                yield sound.name, due_ns
        if self.feedback is not None and FEEDBACK not in started_names:
            yield FEEDBACK, self.end_ns

    def _find_due_ns(self, sound: ScheduledSound) -> int | None:
        """Return when a sound was intended to begin; None if the trial's end or a response came before that.

        None also stands for a trial whose first picture never was on the display.
        """
        if self.first_flip_ns is None:
            return None
        due_ns = self.first_flip_ns + sound.onset_ns
        is_removed = sound.until_response and any(response.t_ns <= due_ns for response in self.responses)
        if is_removed or due_ns >= self.end_ns:
            return None
        return due_ns

    @property
    def feedback(self) -> SoundContent | None:
        """Return the sound that the trial's outcome gave as feedback; None if the schedule has none for it."""
        return (self.schedule.feedback or {}).get(str(self.episode.outcome))

    def find_content(self, sound: str) -> SoundContent | None:
        """Return what a sound of the trial consists of, by its name in the log; None if the schedule has none."""
        if sound == FEEDBACK:
            return self.feedback
        contents = {scheduled.name: scheduled.content for scheduled in self.schedule.sound_list}
        return contents.get(sound)

    def find_image(self, picture: StimuliShown) -> str:
        """Return the file of the front image among a picture's new stimuli; "" if none of them has an image.

        New stimuli are those that the trial's previous picture did not show.
        """
        files = {stimulus.name: stimulus.content.image for stimulus in self.schedule.stimuli}
        index = self.pictures.index(picture)
        previous_names = self.pictures[index - 1].stimuli if index else ()
        new_images = [files.get(name, "") for name in picture.stimuli if name not in previous_names]
        return next((image for image in reversed(new_images) if image), "")


def read_trials(log: SessionLog) -> list[TrialRecord]:
    """Return every attempt at a trial with a time course, in the order in which they began."""
    records: list[TrialRecord] = []
    for segment in log.segments:
        record: TrialRecord | None = None
        for event in segment.part_events:
            match event:
                case TrialResolved():
                    record = _begin_record(event, segment, log)
                    if record is not None:
                        records.append(record)
                case StimuliShown() if record is not None:
                    record.pictures.append(event)
                case SoundPlayed() if record is not None:
                    record.sounds.append(event)
                case ResponseTaken() if record is not None:
                    record.responses.append(event)
    return records


def _begin_record(event: TrialResolved, segment: Segment, log: SessionLog) -> TrialRecord | None:
    """Return the record of a trial that begins; None if the log lacks its episode."""
    attempts = [
        episode
        for episode in log.episodes
        if episode.segment == segment.number
        and episode.plan.episode == event.episode
        and episode.start.t_ns <= event.t_ns
    ]
    if not attempts:
        return None
    episode = attempts[-1]
    if len(episode.actions):
        end_ns = int(episode.t_ns[-1])
    else:
        end_ns = _find_interruption_ns(event.t_ns, segment)
    schedule = msgspec.json.decode(event.schedule, type=TrialSchedule)
    return TrialRecord(episode, event.part, schedule, end_ns)


def _find_interruption_ns(begin_ns: int, segment: Segment) -> int:
    """Return the time at which a trial that began at ``begin_ns`` was interrupted, in ns.

    It is the time of the next phase that is not play, or of the segment's end.
    """
    for note in segment.notes:
        is_phase = isinstance(note, Noted) and note.kind == "phase" and note.text != Phase.PLAYING
        if is_phase and note.t_ns >= begin_ns:
            return note.t_ns
    return segment.end_ns


def list_presentations(log: SessionLog) -> Iterator[Presentation]:
    """Yield every picture and sound that the trials with a time course presented, trial by trial."""
    for record in read_trials(log):
        for picture in record.pictures:
            if picture.frame >= 0:
                yield Presentation("flip", record.episode, picture.flip_ns, picture.stimuli, record.find_image(picture))
        for sound in record.sounds:
            content = record.find_content(sound.sound)
            if content is None:
                continue
            duration_ms = content.lasts_ms or None
            if duration_ms is not None and sound.sound != FEEDBACK:  # a sound of the trial stops at its end
                duration_ms = min(duration_ms, (record.end_ns - sound.onset_ns) / NS_PER_MS)
            yield Presentation("sound", record.episode, sound.onset_ns, (sound.sound,), content.file, duration_ms)
