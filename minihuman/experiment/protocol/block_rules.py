"""Validation rules of a block: its episodes, actions, keys, times, texts and kind, and fields without effect."""

import re
from collections import Counter
from collections.abc import Iterator
from string import Formatter

from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.trials.plan import StimuliSpec
from minihuman.errors import ProtocolError
from minihuman.experiment.keys import AXES, MOUSE_AXES
from minihuman.experiment.machine.activity import find_installed_kind, find_kind, list_kinds
from minihuman.experiment.plan.designs import make_design
from minihuman.experiment.protocol.model import MAX_SEED, BlockSpec, KeysSpec, Protocol
from minihuman.experiment.protocol.validation_errors import FieldError
from minihuman.worlds.catalogue import is_first_person
from minihuman.worlds.outcomes import normalize_outcome_rule

_FORMAT = re.compile(r"[<>^=+\- ,]{0,3}\d{0,3}(\.\d{1,2})?[a-z%]?")  # an allowed format of a placeholder
_DAY_MS = 86_400_000
_MOUSE_SCALE_HELP = "it is the share of a whole step that one pixel of motion makes; write scale = 0.01, say"
_MAX_MOUSE_SCALE = 0.25  # a hand moves by tens of pixels between two ticks
_TIMES = ("max_episode_s", "max_block_s", "inter_trial_interval_ms", "fixation_ms", "final_frame_ms", "feedback_ms")


def check_block(block: BlockSpec, protocol: Protocol) -> Iterator[FieldError]:
    """Yield a (field, message) for each error of a block whose values have the right types."""
    if not block.world:
        yield "world", "is empty; `minihuman worlds` lists ours"
    yield from _check_episodes(block)
    yield from _check_seeds(block)
    yield from _check_stop_criterion(block)
    yield from _check_actions(block, protocol.keys)
    yield from _check_fixed_keys(block, protocol.keys.pool)
    yield from _check_pace(block)
    yield from _check_times(block)
    yield from _check_motion(block)
    yield from _check_stimuli(block.stimuli)
    yield from _check_feedback(block)
    yield from _check_kind(block, protocol.keys.pool)
    yield from _check_page_computation(block)
    yield from _check_outcome(block)
    yield from _check_design(block)


def check_useless_fields(block: BlockSpec, keys: KeysSpec) -> Iterator[FieldError]:
    """Yield a (field, message) for each field that is given but has no effect."""
    if keys.spare_keys == "ignore" and block.distractors:
        yield "distractors", "has actions, but $.keys.spare_keys is 'ignore'; set it to 'distractor'"
    if block.response_deadline_ms and block.noop_action is None:
        yield "response_deadline_ms", "needs noop_action, which is done at the deadline; name one"
    if block.pace == "on_key":
        yield from _refuse_real_time_fields(block)
    elif block.pace == "real_time":
        yield from _refuse_on_key_fields(block)
    yield from _check_axes(block)


def check_unused_tables(block: BlockSpec) -> Iterator[FieldError]:
    """Yield a (field, message) for each table of a block that is given but has no effect for any group.

    A group's overrides may change the block's key map or kind, and so give the table an effect.
    """
    overrides_of_groups = ({}, *block.group_overrides.values())
    key_maps = [overrides.get("key_map", block.key_map) for overrides in overrides_of_groups]
    if block.fixed_keys and "fixed" not in key_maps:
        yield "fixed_keys", f"is given, but key_map is {block.key_map!r}; set it to 'fixed'"
    kinds = [overrides.get("kind", block.kind) for overrides in overrides_of_groups]
    for table in ("agent", "team", "timeline"):
        if getattr(block, table) is not None and not any(_has_table(kind, table) for kind in kinds):
            yield table, f"is given, but a {block.kind} block has none; use kind = {_name_kinds_with(table)}"


def _check_episodes(block: BlockSpec) -> Iterator[FieldError]:
    if not 1 <= block.episodes <= 10_000:
        yield "episodes", f"is {block.episodes}; an episode count is 1 to 10000"
    if not 1 <= block.max_steps <= 1_000_000:
        yield "max_steps", f"is {block.max_steps}; use 1 to 1000000"


def _check_seeds(block: BlockSpec) -> Iterator[FieldError]:
    if not isinstance(block.seeds, tuple):
        return
    if len(block.seeds) != block.episodes:
        yield "seeds", f"has {len(block.seeds)} seeds for {block.episodes} episodes; give one per episode"
    if any(not 0 <= seed <= MAX_SEED for seed in block.seeds):
        yield "seeds", f"has a seed that is not from 0 to {MAX_SEED}; a seed is 0 or more"


def _check_stop_criterion(block: BlockSpec) -> Iterator[FieldError]:
    criterion = block.stop_criterion
    if criterion and not 1 <= criterion.successes <= criterion.of <= block.episodes:
        asked_for = f"asks for {criterion.successes} of {criterion.of} in {block.episodes} episodes"
        yield "stop_criterion", f"{asked_for}; use successes <= of <= episodes"


def _check_actions(block: BlockSpec, keys: KeysSpec) -> Iterator[FieldError]:
    if not block.actions:
        yield "actions", "is empty; name the actions that get a key"
    counts = Counter(block.actions + block.distractors)
    duplicates = [name for name, count in counts.items() if count > 1]
    if duplicates:
        yield "actions", f"and distractors name {', '.join(map(repr, duplicates))} twice; name each once"
    if len(block.actions) > len(keys.pool):
        yield "actions", f"has {len(block.actions)} for {len(keys.pool)} keys in $.keys.pool; add keys"
    if keys.spare_keys == "distractor" and not block.distractors:
        yield "distractors", "is empty, but $.keys.spare_keys is 'distractor'; name the actions to deal out"


def _check_fixed_keys(block: BlockSpec, pool: tuple[str, ...]) -> Iterator[FieldError]:
    if block.key_map == "fixed" and set(block.fixed_keys.values()) != set(block.actions):
        yield (
            "fixed_keys",
            "gives keys to other actions than those of the block; give each a key: fixed_keys = { 1 = 'left' }",
        )
    for key in block.fixed_keys:
        if key not in pool:
            yield "fixed_keys", f"has the key {key!r}, which is not in $.keys.pool; add it there, or use another key"


def _check_pace(block: BlockSpec) -> Iterator[FieldError]:
    if block.pace == "real_time" and not 5 <= block.step_period_ms <= 60_000:
        yield "step_period_ms", f"is {block.step_period_ms}; real_time needs 5 to 60000 ms"
    if not 0 <= block.response_deadline_ms <= 3_600_000:
        yield "response_deadline_ms", f"is {block.response_deadline_ms:g}; use 0 to 3600000 ms"


def _check_times(block: BlockSpec) -> Iterator[FieldError]:
    for field in _TIMES:
        duration = getattr(block, field)
        if not isinstance(duration, tuple) and not 0 <= duration <= _DAY_MS:
            yield field, f"is {duration:g}; use 0 to {_DAY_MS}"
    interval = block.inter_trial_interval_ms
    if isinstance(interval, tuple) and not 0 <= interval[0] <= interval[1] <= _DAY_MS:
        yield "inter_trial_interval_ms", f"is {list(interval)}; give the shortest, then the longest, up to {_DAY_MS}"


def _check_motion(block: BlockSpec) -> Iterator[FieldError]:
    longest_ms = min(1000.0, block.step_period_ms or 1000.0)
    has_motion = is_first_person(block.world) and block.view == "partial"
    if block.motion_ms and not has_motion:
        yield "motion_ms", "is for built-in first-person worlds with view = 'partial'; remove it"
    if not 0 <= block.motion_ms <= longest_ms:
        yield "motion_ms", f"is {block.motion_ms:g}; use 0 to {longest_ms:g} ms"


def _check_stimuli(stimuli: StimuliSpec | None) -> Iterator[FieldError]:
    if stimuli is None:
        return
    has_neither = not stimuli.file and not stimuli.rows
    has_both = bool(stimuli.file and stimuli.rows)
    if has_neither or has_both:
        yield "stimuli", "needs a file or rows, and not both"
    if stimuli.order == "fixed" and (stimuli.balanced_by or stimuli.max_run):
        yield "stimuli.order", "is 'fixed', but balanced_by and max_run draw one; use 'shuffled'"
    for column, most in stimuli.max_run.items():
        if most < 1:
            yield "stimuli.max_run", f"has {column} = {most}; use 1 or more"


def _check_feedback(block: BlockSpec) -> Iterator[FieldError]:
    if block.feedback_ms and not block.feedback:
        yield "feedback_ms", f"is {block.feedback_ms:g}, but the block has no feedback; give it some"
    texts = [block.feedback] if isinstance(block.feedback, str) else block.feedback.values()
    for text in texts:
        try:
            _require_short_placeholders(text)
            text.format(outcome="", reward=0.0, steps=0, episode=0, episodes=0, points=0.0, total=0.0)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            fields = "outcome, reward, steps, episode, episodes, points, total"
            yield "feedback", f"has a bad placeholder ({error}); use {fields}"


def _require_short_placeholders(text: str) -> None:
    """Check that each placeholder in a template is only a field's name and a short format.

    Other placeholders could produce a text of any size.

    Raises:
        ValueError: if a placeholder has a conversion, a longer format or anything else than a name.
    """
    for _, field, format_spec, conversion in Formatter().parse(text):
        if field is None:  # text without a placeholder
            continue
        is_short = field.isidentifier() and _FORMAT.fullmatch(format_spec or "")
        if conversion or not is_short:
            separator = ":" if format_spec else ""
            raise ValueError(f"{{{field}{separator}{format_spec}}}")


def _check_kind(block: BlockSpec, pool: tuple[str, ...]) -> Iterator[FieldError]:
    """Yield an error if a block's kind does not exist or is not for blocks; else the errors by the kind's own check."""
    try:
        kind = find_kind(block.kind)
    except ProtocolError as error:
        yield "kind", f"is {block.kind!r}: {error}"
        return
    if not issubclass(kind.plan, PlayPlan):
        yield "kind", f"is {block.kind!r}, which is not a kind of block; list it in [[activities]]"
    elif kind.check_block is not None:
        yield from kind.check_block(block, pool)


def _check_page_computation(block: BlockSpec) -> Iterator[FieldError]:
    """Yield an error for each reason why a page cannot compute a block that is to be computed by the page."""
    if block.computed != "page":
        return
    if not _can_page_compute(block.kind):
        yield "computed", f"is 'page' for a {block.kind} block; a page computes play alone: use 'server'"
    if block.view == "text":
        yield "computed", "is 'page', but view is 'text', which a page does not draw: use 'server'"
    if block.design is not None:
        yield "computed", "is 'page', but a design resolves each episode on the server; use 'server'"


def _check_outcome(block: BlockSpec) -> Iterator[FieldError]:
    """Yield the errors of a block's rule for success, and of the keys of the world's ``info`` that it records."""
    if block.success is not None:
        try:
            normalize_outcome_rule(block.success, at_any_step=False)
        except ProtocolError as error:
            yield "success", str(error)
    for key in block.record_info:
        if not key.strip() or '"' in key or block.record_info.count(key) > 1:
            yield "record_info", f"has {key!r}; name each key of the world's info once, without quotation marks"


def _check_design(block: BlockSpec) -> Iterator[FieldError]:
    if block.design is None:
        return
    try:
        make_design(block.design)
    except ProtocolError as error:
        yield "design", f"{block.design.name!r}: {error}"


def _refuse_real_time_fields(block: BlockSpec) -> Iterator[FieldError]:
    """Yield an error for each field of a block paced by key presses that only real-time blocks use."""
    if block.step_period_ms or (block.noop_action and not block.response_deadline_ms):
        yield "pace", "is 'on_key', which has no step_period_ms and no noop_action; remove them or use 'real_time'"
    if block.hold != "once":
        yield "hold", "is for 'real_time'; in 'on_key' each press is a step: remove it, or see auto_repeat"
    if block.stimulus_onset != "world":
        yield "stimulus_onset", "is for 'real_time'; in 'on_key' every picture is an onset; remove it"


def _refuse_on_key_fields(block: BlockSpec) -> Iterator[FieldError]:
    """Yield an error for each field of a real-time block that only blocks paced by key presses use."""
    if block.response_deadline_ms:
        yield "response_deadline_ms", "is for 'on_key'; in 'real_time' a tick decides: remove it"
    if block.auto_repeat:
        yield "auto_repeat", "is for 'on_key'; in 'real_time' a tick decides"


def _check_axes(block: BlockSpec) -> Iterator[FieldError]:
    is_for_agents = not is_played_alone(block.kind)
    for field in ("axes", "spot"):
        if getattr(block, field) and is_for_agents:
            yield field, f"is for blocks that only the participant plays, not for kind {block.kind!r}; remove it"
    if block.axes and block.hold != "repeat":
        yield "axes", "are read at each tick; use pace = 'real_time' and hold = 'repeat'"
    if block.spot and block.hold == "repeat":
        yield "spot", "is an action of its own, but held keys combine; use hold = 'once'"
    for axis, binding in block.axes.items():
        if axis not in AXES:
            yield "axes", f"has {axis!r}, which is no axis; axes: {', '.join(AXES)}"
        if axis in MOUSE_AXES and abs(binding.scale) > _MAX_MOUSE_SCALE:
            yield "axes", f"has {axis} with the scale {binding.scale}, at most {_MAX_MOUSE_SCALE}: {_MOUSE_SCALE_HELP}"


def is_played_alone(kind: str) -> bool:
    """Return whether only the participant acts in blocks of a kind; true for a kind that is not installed.

    A kind that is not installed is reported as an error elsewhere.
    """
    installed = find_installed_kind(kind)
    return installed is None or installed.is_played_alone


def _can_page_compute(kind: str) -> bool:
    """Return whether a page can compute blocks of a kind; true for a kind that is not installed."""
    installed = find_installed_kind(kind)
    return installed is None or installed.is_plain_play


def _has_table(kind: str, table: str) -> bool:
    """Return whether blocks of a kind can have a table of a given name, such as "agent".

    Return True for a kind that is not for blocks or not installed, which is reported as an error elsewhere.
    """
    installed = find_installed_kind(kind)
    return installed is None or not issubclass(installed.plan, PlayPlan) or table in installed.plan_fields


def _name_kinds_with(table: str) -> str:
    kinds = list_kinds(lambda kind: issubclass(kind.plan, PlayPlan) and table in kind.plan_fields)
    return " or ".join(map(repr, kinds))
