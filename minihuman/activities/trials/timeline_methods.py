"""Sentences for the methods section on the time course of trials."""

from collections.abc import Iterator

from minihuman.activities.trials.plan import TimelineSpec, TimelineStimulus, TimeSpec


def describe_timeline(timeline: TimelineSpec, deadline_ms: float) -> Iterator[str]:
    """Yield what a trial showed from when to when, when responses were taken, and how trials followed each other."""
    yield "each trial showed " + ", ".join(_describe_stimulus(stimulus) for stimulus in timeline.stimuli)
    target = timeline.target or timeline.stimuli[-1].name
    opens = f" from {timeline.opens_ms:g} ms on" if timeline.opens_ms else ""
    until = f", at most {deadline_ms:g} ms" if deadline_ms else ""
    yield f"response times count from the onset of {target!r}; responses were taken{opens} after it{until}"
    if timeline.ends == "time":
        yield "a response did not end the trial"
    if timeline.soa_ms:
        yield f"one trial began every {timeline.soa_ms:g} ms"


def _describe_stimulus(stimulus: TimelineStimulus) -> str:
    parts = [f"{stimulus.name!r}"]
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


def _describe_time(time: TimeSpec | None) -> str:
    if isinstance(time, tuple):
        return f"{time[0]:g} to {time[1]:g} ms (drawn)"
    if isinstance(time, str):
        return f"the time in column {time.strip('{}')!r}"
    return f"{time or 0:g} ms"
