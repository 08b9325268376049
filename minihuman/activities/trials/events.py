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
    frame: int  # 0 for the first
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
    target_ns: int  # the flip of the stimulus that response times count from
