"""A trial while it runs: which picture is due, which responses are taken, and when it ends. No clock and no I/O."""

from dataclasses import dataclass

from minihuman.activities.trials.schedule import (
    NS_PER_MS,
    SOUND_LEAD_NS,
    ScheduledSound,
    ScheduledStimulus,
    TrialSchedule,
)

PREPARATION_NS = 40 * NS_PER_MS  # how long before it is due a picture is handed over to be drawn
_BEFORE_FIRST = -1  # the screen is empty until the first picture is due


@dataclass(frozen=True, slots=True)
class ResponseRecord:
    """A response that was taken."""

    key: str
    action: int
    pressed_ns: int


class TrialRun:
    """The state of a running trial.

    Pictures are numbered from 0 as the schedule changes them, and none is left out. After a response that removes
    stimuli, the same numbers show what remains.

    A sound has to be handed over before it is due. One that is due at the first picture or soon after it counts from
    the time at which that picture is due; any other counts from the picture's flip. Without a rhythm, the first picture
    of a trial with an early sound of this kind is due a fixed time after an empty one.

    Args:
        schedule: the trial's schedule.
        start_ns: when its first picture is due in a block with a rhythm; None: at once.
    """

    def __init__(self, schedule: TrialSchedule, start_ns: int | None = None) -> None:
        self.schedule = schedule
        self.changes_ns = schedule.changes_ns
        self.has_lead = start_ns is None and any(sound.is_early for sound in schedule.sound_list)
        self.frame = 0 if start_ns is None and not self.has_lead else _BEFORE_FIRST
        self.responses: list[ResponseRecord] = []
        self.first_flip_ns: int | None = None
        self.target_onset_ns: int | None = None  # the flip of a picture, or the onset of a sound
        self.rhythm_start_ns = start_ns
        self._start_ns = start_ns
        self._seen_frame = _BEFORE_FIRST

    @property
    def has_response(self) -> bool:
        """Return whether a response has been taken."""
        return bool(self.responses)

    @property
    def is_seen(self) -> bool:
        """Return whether a picture of the present number has reached the display, before or after a response."""
        return self._seen_frame == self.frame

    @property
    def visible(self) -> tuple[ScheduledStimulus, ...]:
        """Return the stimuli of the present picture, the front one last."""
        return self.find_visible(self.frame, has_response=self.has_response)

    def find_visible(self, frame: int, *, has_response: bool) -> tuple[ScheduledStimulus, ...]:
        """Return the stimuli of a picture before or after a response; none for the empty picture, numbered -1."""
        if frame < 0:
            return ()
        return self.schedule.find_visible(self.changes_ns[frame], has_response=has_response)

    def find_due_ns(self, frame: int) -> int | None:
        """Return when a picture is due, in session time.

        None means, for the first picture, that it is due at once; for a later picture, that the first one has not
        reached the display yet.
        """
        if frame <= 0:
            return self._start_ns
        if self.first_flip_ns is None:
            return None
        return self.first_flip_ns + self.changes_ns[frame]

    @property
    def end_ns(self) -> int | None:
        """Return when the trial ends by the clock, in session time; None if it does not, or has not begun."""
        if self.first_flip_ns is None or self.schedule.end_ns is None:
            return None
        return self.first_flip_ns + self.schedule.end_ns

    @property
    def next_tick_ns(self) -> int | None:
        """Return when the next picture has to be prepared or the trial ends; None while nothing is due by the clock."""
        times_ns = (self._next_preparation_ns, self.end_ns)
        return min((t_ns for t_ns in times_ns if t_ns is not None), default=None)

    @property
    def _next_preparation_ns(self) -> int | None:
        """Return when the next picture has to be prepared; None without one, or until the present one is seen."""
        if not self.is_seen or self.frame + 1 >= len(self.changes_ns):
            return None
        due_ns = self.find_due_ns(self.frame + 1)
        if due_ns is None:  # of the first picture, before the empty one was seen
            return None
        return due_ns - PREPARATION_NS

    def pass_time(self, now_ns: int) -> None:
        """Advance to the next picture if it has to be prepared by now and the present one was seen."""
        preparation_ns = self._next_preparation_ns
        if preparation_ns is not None and now_ns >= preparation_ns:
            self.frame += 1

    def is_over(self, now_ns: int) -> bool:
        """Return whether the trial has ended, by the clock or by its last response."""
        if self.schedule.ends_at_response and len(self.responses) >= self.schedule.responses:
            return True
        return self.end_ns is not None and now_ns >= self.end_ns

    def record_flip(self, flip_ns: int, frame: int | None = None) -> int | None:
        """Record that a picture reached the display, and the target's onset if the picture shows it.

        Args:
            flip_ns: when it reached the display.
            frame: the picture's number; None means the present picture.

        Returns:
            When the picture was due; None if it was due at once, was seen before, or is the empty one.
        """
        if frame is not None and self.frame < frame < len(self.changes_ns):
            self.frame = frame
        if self.frame < 0:
            if self.has_lead and self._start_ns is None:
                self._start_ns = flip_ns + SOUND_LEAD_NS
            return None
        due_ns = None if self.is_seen else self.find_due_ns(self.frame)
        if self.first_flip_ns is None:
            self.first_flip_ns = flip_ns
        shows_target = self.changes_ns[self.frame] == self.schedule.target_ns and not self.target_is_sound
        if shows_target and self.target_onset_ns is None:
            self.target_onset_ns = flip_ns
        self._seen_frame = self.frame
        return due_ns

    @property
    def target_is_sound(self) -> bool:
        """Return whether response times count from the onset of a sound."""
        return any(sound.name == self.schedule.target for sound in self.schedule.sound_list)

    @property
    def foresees_responses(self) -> bool:
        """Return whether every press from the target on is a response, so that a page need not ask."""
        schedule = self.schedule
        is_open = schedule.opens_ns == schedule.target_ns and schedule.closes_ns in (None, schedule.end_ns)
        return is_open and not self.target_is_sound

    def find_sound_due_ns(self, sound: ScheduledSound) -> int | None:
        """Return when a sound is due, in session time; None if the time from which it counts is not known yet.

        An early sound counts from the time at which the first picture is due, any other from that picture's flip.
        """
        base_ns = self._start_ns if sound.is_early else self.first_flip_ns
        if base_ns is None:
            return None
        return base_ns + sound.onset_ns

    def list_due_sounds(self) -> dict[int, tuple[ScheduledSound, int]]:
        """Return the sounds to be played, each with the time at which it is due, by their indices in the schedule."""
        due_sounds: dict[int, tuple[ScheduledSound, int]] = {}
        for index, sound in enumerate(self.schedule.sound_list):
            due_ns = self.find_sound_due_ns(sound)
            if due_ns is not None and not (self.has_response and sound.until_response):
                due_sounds[index] = (sound, due_ns)
        return due_sounds

    def record_sound(self, index: int, onset_ns: int) -> tuple[ScheduledSound, int] | None:
        """Record that the sound of an index began, and return it with the time at which it was due.

        If it is the target, its onset is that from which response times count. None means that the trial has no such
        sound, or that it began before the time from which it counts was known.
        """
        if not 0 <= index < len(self.schedule.sound_list):
            return None
        sound = self.schedule.sound_list[index]
        base_ns = self._start_ns if self.first_flip_ns is None else self.first_flip_ns
        if base_ns is None:
            return None
        if sound.name == self.schedule.target and self.target_onset_ns is None:
            self.target_onset_ns = onset_ns
        return sound, base_ns + sound.onset_ns

    def is_open(self, pressed_ns: int) -> bool:
        """Return whether the trial takes a key that was pressed at the given session time as a response."""
        if self.first_flip_ns is None or self.target_onset_ns is None:
            return False
        if len(self.responses) >= self.schedule.responses:
            return False
        opens_ns = self.target_onset_ns + self.schedule.opens_ns - self.schedule.target_ns
        closes_ns = self.schedule.closes_ns
        return pressed_ns >= opens_ns and (closes_ns is None or pressed_ns < self.first_flip_ns + closes_ns)
