"""The protocol's check of a block's timeline: names, times and fields that go together."""

from collections.abc import Iterator
from typing import Any

from minihuman.activities.trials.plan import TimelineSpec, TimelineStimulus
from minihuman.activities.trials.schedule import LONGEST_MS, PREPARATION_MS
from minihuman.experiment.sounds import NOISE, TONE

_UNUSED = ("inter_trial_interval_ms", "fixation_ms", "feedback_ms")  # in a block with a rhythm of its own


def check_timeline(block: Any, pool: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Yield a (field, message) for each error of a block's timeline; nothing for a block without a timeline.

    ``pool``, the keys that may have an action, is not used.
    """
    timeline = block.timeline
    if timeline is None:
        return
    yield from _check_block(block, timeline)
    yield from _check_settings(timeline)
    yield from _check_rhythm(block, timeline)
    names: list[str] = []
    for index, stimulus in enumerate(timeline.stimuli):
        path = f"timeline.stimuli[{index}]"
        if not stimulus.name or stimulus.name in names:
            yield f"{path}.name", f"is {stimulus.name!r}; give each stimulus its own name"
        yield from _check_stimulus(stimulus, path, names)
        if not stimulus.feedback:
            names.append(stimulus.name)
        yield from _check_feedback(block, stimulus, path)


def _check_block(block: Any, timeline: TimelineSpec) -> Iterator[tuple[str, str]]:
    """Yield an error for each of the block's own fields that does not go with a timeline."""
    if block.pace != "on_key":
        yield "pace", "is 'real_time', but the timeline says when each trial ends; remove it"
    if block.max_steps != 1:
        yield "max_steps", f"is {block.max_steps}, but a trial with a timeline is one step; use 1"
    needs_noop = block.response_deadline_ms or timeline.ends == "time"
    if needs_noop and block.noop_action is None:
        yield "noop_action", "is missing; name what is done in a trial without a response, such as 'none'"
    if block.max_episode_s or block.max_block_s:
        yield "max_episode_s", "and max_block_s do not apply to trials with a timeline; remove them"
    if block.spot or block.axes:
        yield "spot", "and axes do not apply to trials with a timeline, which take keys; remove them"


def _check_settings(timeline: TimelineSpec) -> Iterator[tuple[str, str]]:
    """Yield the errors of the timeline's own fields, and an error if it has no stimulus other than feedback sounds."""
    names = [stimulus.name for stimulus in timeline.stimuli if not stimulus.feedback]
    if not names:
        yield "timeline.stimuli", "is empty; name what a trial shows"
    if timeline.target and timeline.target not in names:
        yield "timeline.target", f"is {timeline.target!r}, which is no stimulus; use one of {', '.join(names)}"
    if not 1 <= timeline.responses <= 100:
        yield "timeline.responses", f"is {timeline.responses}; use 1 to 100"
    if not 0 <= timeline.opens_ms <= LONGEST_MS:
        yield "timeline.opens_ms", f"is {timeline.opens_ms:g}; use 0 or more"


def _check_rhythm(block: Any, timeline: TimelineSpec) -> Iterator[tuple[str, str]]:
    """Yield the errors of a block whose trials begin at a fixed interval, ``soa_ms``; nothing for other blocks."""
    if not timeline.soa_ms:
        return
    if not PREPARATION_MS <= timeline.soa_ms <= LONGEST_MS:
        yield "timeline.soa_ms", f"is {timeline.soa_ms:g}; use {PREPARATION_MS:g} or more"
    if block.ready == "each":
        yield "ready", "is 'each', but trials follow each other by the clock; use 'first' or 'none'"
    for field in _UNUSED:
        if getattr(block, field):
            yield field, "does not fit into a rhythm; remove it, or show it in the timeline"
    if not block.response_deadline_ms and timeline.ends == "response":
        yield "response_deadline_ms", "is missing; trials with soa_ms end by the clock"
    elif block.response_deadline_ms > timeline.soa_ms - PREPARATION_MS:
        longest_ms = timeline.soa_ms - PREPARATION_MS
        yield (
            "response_deadline_ms",
            f"is {block.response_deadline_ms:g}; use at most {longest_ms:g}, as the next trial is prepared before it",
        )


def _check_stimulus(stimulus: TimelineStimulus, path: str, earlier_names: list[str]) -> Iterator[tuple[str, str]]:
    """Yield the errors of a stimulus.

    Args:
        stimulus: the stimulus, as the protocol has it.
        path: where it is, such as "timeline.stimuli[0]".
        earlier_names: the names of the stimuli before it, other than feedback sounds.
    """
    if not (stimulus.text or stimulus.shape or stimulus.image or stimulus.sound):
        yield path, "shows nothing; give it a text, shape, image or sound"
    if stimulus.sound:
        yield from _check_sound(stimulus, path)
    yield from _check_reference(stimulus, path, earlier_names)
    yield from _check_times(stimulus, path)


def _check_reference(stimulus: TimelineStimulus, path: str, earlier_names: list[str]) -> Iterator[tuple[str, str]]:
    """Yield the errors of ``after`` and ``since``, which name the earlier stimulus from which the onset counts."""
    for field in ("after", "since"):
        name = getattr(stimulus, field)
        if name and name not in earlier_names:
            yield f"{path}.{field}", f"is {name!r}, which is no stimulus before it"
    if stimulus.after and stimulus.since:
        yield f"{path}.after", "and since are both given; use one"


def _check_times(stimulus: TimelineStimulus, path: str) -> Iterator[tuple[str, str]]:
    """Yield the errors of a stimulus's onset and durations: missing, contradictory or outside the limits."""
    duration_fields = [field for field in ("duration_ms", "each_ms") if getattr(stimulus, field) is not None]
    has_end = bool(duration_fields or stimulus.until or stimulus.feedback)
    if len(duration_fields) > 1 or not has_end:
        yield f"{path}.duration_ms", "needs one of duration_ms, each_ms and until"
    for field in ("onset_ms", "duration_ms", "each_ms"):
        time = getattr(stimulus, field)
        if isinstance(time, tuple) and not 0 <= time[0] <= time[1] <= LONGEST_MS:
            yield f"{path}.{field}", f"is {list(time)}; give the shortest, then the longest"
        elif isinstance(time, int | float) and not 0 <= time <= LONGEST_MS:
            yield f"{path}.{field}", f"is {time:g}; use 0 or more"


def _check_sound(stimulus: TimelineStimulus, path: str) -> Iterator[tuple[str, str]]:
    """Yield the errors of a stimulus that has a sound, at a path such as "timeline.stimuli[0]"."""
    if stimulus.text or stimulus.shape or stimulus.image:
        yield f"{path}.sound", "stands beside what is shown; make it a stimulus of its own"
    if stimulus.each_ms is not None:
        yield f"{path}.each_ms", "applies to the words of a text; remove it"
    if isinstance(stimulus.duration_ms, tuple):
        yield f"{path}.duration_ms", "of a sound is not drawn, as sounds are prepared before the block; use a number"
    if stimulus.sound in (TONE, NOISE) and stimulus.duration_ms is None:
        yield f"{path}.duration_ms", f"is missing; say how long the {stimulus.sound} lasts"


def _check_feedback(block: Any, stimulus: TimelineStimulus, path: str) -> Iterator[tuple[str, str]]:
    """Yield the errors of a stimulus that sounds with a block's feedback; nothing for other stimuli."""
    if not stimulus.feedback:
        return
    if not stimulus.sound or stimulus.onset_ms is not None or stimulus.until or stimulus.after or stimulus.since:
        yield f"{path}.feedback", "is a sound that begins with the feedback; give it sound and duration_ms alone"
    has_text = isinstance(block.feedback, str) or stimulus.feedback in block.feedback
    if not block.feedback_ms or not has_text:
        outcome = stimulus.feedback
        yield f"{path}.feedback", f"sounds with the block's feedback; give that a text for {outcome!r}, and feedback_ms"
