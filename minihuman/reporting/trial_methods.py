"""Sentences for the methods section on blocks of trials: stimuli, order and timing."""

from collections.abc import Iterator

from minihuman.experiment.machine.activity import find_installed_kind
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.protocol.model import BlockSpec
from minihuman.worlds.catalogue import TRIAL_WORLDS


def is_of_trials(plan: EpisodePlan, spec: BlockSpec | None) -> bool:
    """Return whether a block consists of trials, according to its kind or its world."""
    if plan.world in TRIAL_WORLDS:
        return True
    kind = find_installed_kind(spec.kind) if spec is not None else None
    return kind is not None and kind.has_trials


def describe_stimuli(spec: BlockSpec | None) -> str:
    """Describe the source of a block's options that differ by trial; "" if there is no table of stimuli."""
    if spec is None or spec.stimuli is None:
        return ""
    stimuli = spec.stimuli
    if stimuli.file:
        table = f"the table {stimuli.file!r}"
    else:
        table = f"a table of {len(stimuli.rows)} rows"
    if stimuli.order == "fixed":
        return f"{table}, in its order"
    constraints = []
    if stimuli.balanced_by:
        constraints.append(f"balanced by {' and '.join(stimuli.balanced_by)}")
    for column, longest_run in stimuli.max_run.items():
        constraints.append(f"at most {longest_run} trials with the same {column} in a row")
    return ", ".join([f"{table}, in an order drawn for each participant", *constraints])


def list_shared_options(plan: EpisodePlan, spec: BlockSpec | None) -> dict[str, object]:
    """Return the options common to all episodes of a block; for a trial without its protocol, only the responses."""
    if spec is not None and spec.stimuli is not None:
        return {name: plan.options[name] for name in spec.options if name in plan.options}
    if spec is None and plan.world in TRIAL_WORLDS:
        return {name: option for name, option in plan.options.items() if name == "responses"}
    return dict(plan.options)


def describe_trials(plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """Describe a block of trials except for its keys: what was shown, and when."""
    options = "".join(f", {name} = {option!r}" for name, option in sorted(list_shared_options(plan, spec).items()))
    parts = [f"{_describe_count(plan, spec)} of {plan.world}{options}"]
    stimuli = describe_stimuli(spec)
    if stimuli:
        parts.append(f"stimuli from {stimuli}")
    parts += _describe_clock(plan, spec)
    return "; ".join(parts)


def _describe_count(plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """State the number of trials, and the criterion that can end the block earlier."""
    count = plan.episodes_in_block
    criterion = None if spec is None else spec.stop_criterion
    if criterion is None:
        return f"{count} trials"
    return f"up to {count} trials (until {criterion.successes} of the last {criterion.of} were correct)"


def _describe_clock(plan: EpisodePlan, spec: BlockSpec | None) -> Iterator[str]:
    """Yield what was shown before and after the stimulus, and for how long."""
    before = list(_describe_waits(spec)) if spec is not None else []
    if before:
        yield f"before each {' and '.join(before)}"
    if spec is not None and spec.timeline is not None:
        yield from spec.timeline.describe(plan.response_deadline_ms)
    elif plan.response_deadline_ms:
        yield f"the stimulus stayed until the response, at most {plan.response_deadline_ms:g} ms"
    elif plan.pace == "on_key":
        yield "the stimulus stayed until the response"
    if spec is not None and spec.feedback:
        yield f"then feedback{f' for {spec.feedback_ms:g} ms' if spec.feedback_ms else ' until Enter'}"


def _describe_waits(spec: BlockSpec) -> Iterator[str]:
    """Yield what was shown between two trials, in order: an empty screen and a fixation cross."""
    interval = spec.inter_trial_interval_ms
    if isinstance(interval, tuple):
        yield f"an empty screen for {interval[0]:g} to {interval[1]:g} ms (drawn)"
    elif interval:
        yield f"an empty screen for {interval:g} ms"
    if spec.fixation_ms:
        yield f"a fixation cross for {spec.fixation_ms:g} ms"
