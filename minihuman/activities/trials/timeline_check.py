"""What is odd about the trials of a timeline: stimuli that never appear, sounds that overlap, trials without an end.

It knows schedules alone, and neither the protocol nor the table that they come from.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

from minihuman.activities.trials.plan import TimelineSpec
from minihuman.activities.trials.schedule import NS_PER_MS, ScheduledSound, TrialSchedule
from minihuman.experiment.sounds import SoundContent

FRAME_MS = 1000.0 / 60.0  # of a display at 60 Hz
SoundDuration = Callable[[SoundContent], float]  # in milliseconds
PlacedSchedule = tuple[str, TrialSchedule]  # where the trial's cells come from, such as "words.csv:3"


def find_closed_window(timeline: TimelineSpec, deadline_ms: float) -> str:
    """Return why a block takes no responses, if its window for them ends before it opens; "" if it does not.

    ``deadline_ms`` is when the window ends, after the target's onset in milliseconds; 0 for no end.
    """
    if not deadline_ms or timeline.opens_ms < deadline_ms:
        return ""
    return (
        f"timeline: responses are taken from {timeline.opens_ms:g} ms after the onset of stimulus "
        f"{timeline.target_name!r}, but only until {deadline_ms:g} ms after it; raise response_deadline_ms or lower "
        "opens_ms"
    )


def find_endless_trial(schedule: TrialSchedule) -> str:
    """Return why nothing ends a trial; "" if a response or the clock does."""
    if schedule.end_ns is not None or _has_target(schedule):
        return ""
    return (
        f"timeline: nothing ends the trial, as responses are taken from the onset of stimulus {schedule.target!r}, "
        "which is not presented, and there is no response_deadline_ms; set that, or another target"
    )


def _has_target(schedule: TrialSchedule) -> bool:
    """Return whether a trial presents the target, as a sound or a picture, so that response times have an onset."""
    is_heard = any(sound.name == schedule.target for sound in schedule.sound_list)
    return is_heard or schedule.target_ns in schedule.changes_ns


def list_timeline_notices(
    timeline: TimelineSpec, trials: Sequence[PlacedSchedule], find_duration_ms: SoundDuration
) -> Iterator[str]:
    """Yield a sentence for each stimulus that is probably not presented as it was meant.

    Args:
        timeline: the block's timeline.
        trials: every trial that its table can have, each with its place.
        find_duration_ms: returns the full duration of a sound in milliseconds.
    """
    yield from _list_missing_stimuli(timeline, trials)
    yield from _list_short_sounds(trials, find_duration_ms)
    yield from _list_overlaps(trials, find_duration_ms)


def _list_missing_stimuli(timeline: TimelineSpec, trials: Sequence[PlacedSchedule]) -> Iterator[str]:
    """Yield a sentence for each stimulus that appears in no trial."""
    scheduled: set[str] = set()
    presented: set[str] = set()
    for _, schedule in trials:
        onsets_ns = {stimulus.name: stimulus.onset_ns for stimulus in schedule.stimuli}
        onsets_ns |= {sound.name: sound.onset_ns for sound in schedule.sound_list}
        scheduled |= onsets_ns.keys()
        end_ns = schedule.end_ns
        presented |= {name for name, onset_ns in onsets_ns.items() if end_ns is None or onset_ns < end_ns}
    for spec in timeline.stimuli:
        first_name = spec.name if spec.each_ms is None else f"{spec.name}-1"
        if spec.feedback or first_name in presented:
            continue
        if first_name in scheduled:
            yield (
                f"stimulus {spec.name!r} never appears, as every trial is over by its onset; begin it earlier, or let "
                "the trial last longer"
            )
        else:
            yield f"stimulus {spec.name!r} never appears, as its cell is empty in every row; fill it in, or remove it"


def _list_short_sounds(trials: Sequence[PlacedSchedule], find_duration_ms: SoundDuration) -> Iterator[str]:
    """Yield a sentence for each sound that is shorter than a frame, about the first trial in which it is."""
    short_sounds: dict[str, str] = {}
    for place, schedule in trials:
        for sound in schedule.sound_list:
            duration_ms = find_duration_ms(sound.content)
            if duration_ms < FRAME_MS:
                short_sounds.setdefault(
                    sound.name,
                    f"sound {sound.name!r} lasts {duration_ms:.3g} ms in {place}, which is shorter than a frame of "
                    f"{FRAME_MS:.3g} ms at 60 Hz; make it longer unless a click is meant",
                )
    yield from short_sounds.values()


def _list_overlaps(trials: Sequence[PlacedSchedule], find_duration_ms: SoundDuration) -> Iterator[str]:
    """Yield a sentence for each two sounds that overlap in one ear, about the first trial in which they do."""
    overlaps: dict[tuple[str, str], str] = {}
    for place, schedule in trials:
        for first, second in combinations(schedule.sound_list, 2):
            if not _shares_ear(first, second):
                continue
            begin_ns = max(first.onset_ns, second.onset_ns)
            end_ns = min(_find_end_ns(sound, schedule, find_duration_ms) for sound in (first, second))
            if begin_ns < end_ns:
                overlaps.setdefault(
                    (first.name, second.name),
                    f"sounds {first.name!r} and {second.name!r} overlap in one ear in {place}, from "
                    f"{begin_ns / NS_PER_MS:g} to {end_ns / NS_PER_MS:g} ms; change an onset, a duration or an ear "
                    "unless both are to be heard at once",
                )
    yield from overlaps.values()


def _shares_ear(first: ScheduledSound, second: ScheduledSound) -> bool:
    ears = {first.content.ear, second.content.ear}
    return len(ears) == 1 or "both" in ears


def _find_end_ns(sound: ScheduledSound, schedule: TrialSchedule, find_duration_ms: SoundDuration) -> int:
    """Return when a sound is over without a response: at its own end, or at the trial's."""
    own_end_ns = sound.onset_ns + round(find_duration_ms(sound.content) * NS_PER_MS)
    if schedule.end_ns is None:
        return own_end_ns
    return min(own_end_ns, schedule.end_ns)
