"""Events of trials with a time course."""

from dataclasses import dataclass

from minihuman.experiment.machine.events import ActivityEvent


@dataclass(frozen=True, slots=True)
class TrialResolved(ActivityEvent):
    """A trial's timeline was resolved; this precedes its first picture."""

    part: int
    episode: int
    schedule: str  # JSON of a `TrialSchedule`
    start_ns: int  # when the first picture is due; 0: at once


@dataclass(frozen=True, slots=True)
class StimuliShown(ActivityEvent):
    """A picture of a trial reached the display."""

    part: int
    episode: int
    frame: int  # 0 for the first; -1 for the empty one before it, in trials whose first sound needs it
    stimuli: tuple[str, ...]  # their names, the front one last
    due_ns: int  # when it was to be there; 0: as soon as possible
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class ResponseTaken(ActivityEvent):
    """A key was pressed while the trial took responses."""

    part: int
    episode: int
    number: int  # 1 for the trial's first
    key: str
    action: int
    pressed_ns: int
    target_ns: int  # the onset of the stimulus that response times count from


@dataclass(frozen=True, slots=True)
class SoundPlayed(ActivityEvent):
    """A sound of a trial began."""

    part: int
    episode: int
    sound: str  # its name
    cue: int  # tells it from all others of the segment
    due_ns: int  # when the schedule intended it: so long after the first picture's flip
    scheduled_ns: int  # for when the device was told to begin it
    onset_ns: int  # when it began, as the device says
    uncertainty_ms: float  # of that: 99 % of the errors are smaller, but for a constant delay of the device
