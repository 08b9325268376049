"""Checks of stimulus tables before a study begins: every row's world is played once, and its timeline drawn."""

import difflib
import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import cache
from typing import Any

from minihuman.activities.trials.drawing import draw_stimuli
from minihuman.activities.trials.plan import StimuliSpec
from minihuman.activities.trials.schedule import PREPARATION_MS, DrawShare, TrialSchedule, list_columns, resolve_trial
from minihuman.activities.trials.stimulus_table import (
    COUNT,
    IMAGE,
    OptionNames,
    find_option_names,
    is_label,
    read_table,
)
from minihuman.activities.trials.timeline_check import find_closed_window, find_endless_trial, list_timeline_notices
from minihuman.errors import ProtocolError, WorldError
from minihuman.experiment.plan.part_plans import list_world_options
from minihuman.experiment.plan.session_plan import name_label_column
from minihuman.experiment.plan.trials import TrialStimulus, list_label_columns, list_trial_cells, read_stimuli
from minihuman.experiment.protocol.design_spec import check_weighted_conditions
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import apply_overrides
from minihuman.experiment.sounds import SoundContent, render_sound
from minihuman.worlds.adapters.world import World

_MAX_LINES = 20  # listed mistakes of a table, as a wrong column is wrong in every row
_MAX_STEPS = 10  # of a trial that is played
_DRAWN_PX = (320, 240)  # size of a timeline's pictures
_RENDERED_HZ = 8_000  # rate at which sounds are rendered
_SHARES = (0.0, 1.0)  # random numbers that draw the least and the most of a range
_MIN_SIMILARITY = 0.8  # of names, from which a column probably is a misspelt option
_MAX_NAMED_LEVELS = 10  # in a message


def check_stimuli(protocol: Protocol, source: str) -> list[str]:
    """Play every row of every stimulus table once, as each group has it, and draw the timelines.

    ``source`` names the protocol's file in errors.

    Returns:
        Notices about tables that can be played, one per line.

    Raises:
        ProtocolError: if a row cannot be played, with a line for each that names row, column, value and correction.
    """
    _check_used_labels(protocol, source)
    notices: dict[str, None] = {}  # in order, each once
    for number, block in enumerate(protocol.blocks):
        place = f"{source}: $.blocks[{number}].stimuli"
        for group in ("", *block.group_overrides):
            block_of_group = apply_overrides(block, group)
            if block_of_group.stimuli is not None:
                _check_table(protocol, block_of_group, place)
                notices |= dict.fromkeys(_list_table_notices(protocol, block_of_group))
            elif mistakes := _find_timeline_mistakes(protocol, block_of_group):
                _refuse(f"{source}: $.blocks[{number}].timeline", mistakes)
            notices |= dict.fromkeys(_list_timeline_notices(protocol, block_of_group))
    return list(notices)


def _check_table(protocol: Protocol, block: BlockSpec, place: str) -> None:
    """Check a block's table of stimuli; ``place`` is where the table is, for errors.

    Raises:
        ProtocolError: if the table has mistakes, with a line for each of the first ones.
    """
    mistakes = [*_find_misspelt_columns(protocol, block), *_find_unnameable_labels(protocol, block)]
    mistakes += _find_empty_rows(protocol, block)
    mistakes += _find_unplayable_rows(block, read_stimuli(protocol, block))
    mistakes += _find_timeline_mistakes(protocol, block)
    if mistakes:
        _refuse(place, mistakes)


def _refuse(place: str, mistakes: Sequence[str]) -> None:
    """Refuse a block for its mistakes.

    Raises:
        ProtocolError: always, with a line for each of the first mistakes.
    """
    lines = [f"{place}: {mistake}" for mistake in mistakes[:_MAX_LINES]]
    if len(mistakes) > _MAX_LINES:
        lines.append(f"{place}: {len(mistakes) - _MAX_LINES} more mistakes of this table are not listed")
    raise ProtocolError("\n".join(lines))


def _check_used_labels(protocol: Protocol, source: str) -> None:
    """Check that each label and level that the analysis or an exclusion rule names is in a table of stimuli.

    Raises:
        ProtocolError: if any is not, with a line for each.
    """
    levels = list_levels(protocol)
    if levels:
        labels_text = f"its labels are {', '.join(levels)}"
    else:
        labels_text = "its tables of stimuli have no labels"
    mistakes = []
    if (label := protocol.analysis.condition_label) and label not in levels:
        mistakes.append(f"$.analysis.conditions: has 'label:{label}', which is no label; {labels_text}")
    elif label:
        mistakes += _find_unknown_conditions(protocol, list(map(str, levels[label])))
    mistakes += _find_unknown_exclusion_labels(protocol, levels, labels_text)
    if mistakes:
        raise ProtocolError("\n".join(f"{source}: {mistake}" for mistake in mistakes))


def _find_unknown_exclusion_labels(protocol: Protocol, levels: dict[str, list[Any]], labels_text: str) -> Iterator[str]:
    """Yield an error for each label or level in an exclusion rule that is in no table.

    Args:
        protocol: the protocol.
        levels: the levels of each label in its tables.
        labels_text: the clause of the errors that lists the labels.
    """
    for number, rule in enumerate(protocol.exclusions):
        path = f"$.exclusions[{number}]"
        if rule.measured_label and rule.measured_label not in levels:
            yield f"{path}.measure: is {rule.measure!r}, which is no label; {labels_text}"
        for name, level in rule.where.items():
            if name not in levels:
                yield f"{path}.where: has {name!r}, which is no label; {labels_text}"
            elif level not in levels[name]:
                examples = ", ".join(map(repr, levels[name][:_MAX_NAMED_LEVELS]))
                yield f"{path}.where: has {name} = {level!r}, which no row has; its levels are {examples}"


def _find_unknown_conditions(protocol: Protocol, levels: list[str]) -> Iterator[str]:
    """Yield an error for each condition in a contrast that is none of the compared label's levels."""
    for number, contrast in enumerate(protocol.design.contrasts):
        weights_path = f"$.design.contrasts[{number}].weights"
        for path, message in check_weighted_conditions(weights_path, contrast.weights, levels):
            yield f"{path}: {message}"


def list_levels(protocol: Protocol) -> dict[str, list[Any]]:
    """Return, by label, the levels of each label in a protocol's tables of stimuli, in any group."""
    levels: dict[str, list[Any]] = {}
    for block in protocol.blocks:
        for group in ("", *block.group_overrides):
            block_of_group = apply_overrides(block, group)
            if block_of_group.stimuli is None:
                continue
            for stimulus in read_stimuli(protocol, block_of_group):
                for name, level in stimulus.labels.items():
                    if level not in levels.setdefault(name, []):
                        levels[name].append(level)
    return levels


def _find_header_place(stimuli: StimuliSpec, rows_place: str) -> str:
    """Return the place of a table's column names in errors: the file's first row, or ``rows_place`` without a file."""
    if stimuli.file:
        return f"{stimuli.file}:1"
    return rows_place


def _find_unnameable_labels(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    """Yield an error for each label that cannot be a table column or whose column would clash with another."""
    assert block.stimuli is not None
    label_of_column: dict[str, str] = {}
    place = _find_header_place(block.stimuli, "rows[0]")
    for label in list_label_columns(protocol, block):
        column = name_label_column(label)
        if '"' in label or column == "label_":
            yield f"{place}: column {label!r}: a label's name has letters or digits and no quotation marks"
        elif (first_label := label_of_column.setdefault(column, label)) != label:
            yield f"{place}: column {label!r}: in tables it would be {column}, as column {first_label!r}; rename one"


def _find_misspelt_columns(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    """Yield an error for each label that resembles an option, since a misspelt option would silently have no effect."""
    assert block.stimuli is not None
    options = find_option_names(block.world) or OptionNames(())
    option_names = (*options.names, COUNT, IMAGE)
    declared_columns = (*block.stimuli.labels, *_list_shown_columns(block))
    rows = read_table(block.stimuli, protocol.files)
    for column in list_label_columns(protocol, block):
        similar = difflib.get_close_matches(column.strip().lower(), option_names, n=1, cutoff=_MIN_SIMILARITY)
        if similar and column not in declared_columns:
            place = _find_header_place(block.stimuli, rows[0].place)
            yield (
                f"{place}: column {column!r}: {block.world} has no such option; did you mean {similar[0]!r}? If it is "
                f"a label, say so: labels = [{json.dumps(column)}]"
            )


def _find_empty_rows(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    assert block.stimuli is not None
    for row in read_table(block.stimuli, protocol.files):
        if not row.cells:
            yield f"{row.place}: this row is empty; fill in its columns or delete it"


def _find_unplayable_rows(block: BlockSpec, stimuli: list[TrialStimulus]) -> Iterator[str]:
    """Yield an error for each column of a row because of which the block's world cannot be played."""
    block_options = list_world_options(block)
    needs_table = bool(_try_options(block, block_options))
    mistakes: dict[str, list[str]] = {}  # by the row's options: equal rows have equal mistakes
    for stimulus in {stimulus.place: stimulus for stimulus in stimuli}.values():  # a repeated row once
        key = json.dumps(stimulus.options, sort_keys=True)
        if key not in mistakes:
            mistakes[key] = list(_explain_unplayable(block, block_options, stimulus.options, needs_table=needs_table))
        yield from (f"{stimulus.place}: {mistake}" for mistake in mistakes[key])


def _explain_unplayable(
    block: BlockSpec, block_options: dict[str, Any], row_options: dict[str, Any], *, needs_table: bool
) -> Iterator[str]:
    """Yield which columns of a row are wrong and why; nothing if the row can be played.

    Args:
        block: the block.
        block_options: the options of the block's world that are not in the table.
        row_options: the row's options, by column.
        needs_table: whether the world cannot be played with the block's options alone.
    """
    reason = _try_options(block, block_options | row_options)
    if not reason:
        return
    reasons: dict[str, str] = {}  # by column
    if not needs_table:
        reasons = _try_each_column(block, block_options, row_options)
    if not reasons:  # no column is wrong by itself, so name those without which the others can be played
        for column in row_options:
            other_options = {name: option for name, option in row_options.items() if name != column}
            if not _try_options(block, block_options | other_options):
                reasons[column] = reason
    for column, column_reason in reasons.items():
        yield f"column {column!r}, value {row_options[column]!r}: {column_reason}"
    if not reasons:
        yield f"columns {', '.join(map(repr, row_options))}: {reason}"


def _try_each_column(block: BlockSpec, block_options: dict[str, Any], row_options: dict[str, Any]) -> dict[str, str]:
    """Return the columns of a row that cannot be played even without the row's other columns, each with the reason."""
    reasons = {column: _try_options(block, block_options | {column: option}) for column, option in row_options.items()}
    return {column: reason for column, reason in reasons.items() if reason}


def _try_options(block: BlockSpec, options: dict[str, Any]) -> str:
    """Draw a block's world with the given options, and play a trial with each of the block's actions.

    Return the text of the error if this fails, otherwise "".
    """
    try:
        with closing(World(block.world, options)) as world:
            world.name_actions(block.actions)
            world.reset(0)
            world.frame(block.view, palette=block.palette)
            for action in dict.fromkeys((*block.actions, *block.distractors, *filter(None, (block.noop_action,)))):
                _play_trial(world, world.action_names.index(action), min(block.max_steps, _MAX_STEPS))
    except Exception as error:  # whatever a world raises would end a participant's session
        if isinstance(error, WorldError):
            cause = error.__cause__
            reason = cause if isinstance(cause, WorldError | TypeError | ValueError) else error
            return str(reason).removeprefix(f"{block.world}: ")
        return f"{type(error).__name__}: {error}"
    return ""


def _play_trial(world: World, action: int, max_steps: int) -> None:
    """Reset a world and repeat an action until the trial ends, for at most ``max_steps`` steps."""
    world.reset(0)
    for _ in range(max_steps):
        step = world.step(action)
        if step.terminated or step.truncated:
            break


def _list_table_notices(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    """Yield notices about a table's labels, which are not shown, and about correct responses that have no key."""
    assert block.stimuli is not None
    shown_columns = _list_shown_columns(block)
    if labels := [column for column in list_label_columns(protocol, block) if column not in shown_columns]:
        yield f"block {block.name!r}: its table of stimuli has labels, which are not shown: {', '.join(labels)}"
    for row in read_table(block.stimuli, protocol.files):
        correct = row.cells.get("correct")
        if correct is None or is_label("correct", block.world, block.stimuli.labels):
            continue
        if str(correct) not in (*block.actions, block.noop_action):
            yield f"block {block.name!r}: {row.place}: no key does {correct!r}, which is the correct response"


def _find_timeline_mistakes(protocol: Protocol, block: BlockSpec) -> list[str]:
    """Return the errors because of which a block's timeline cannot be played; empty if the block has no timeline."""
    if block.timeline is None:
        return []
    options = list_world_options(block)
    rows = read_table(block.stimuli, protocol.files) if block.stimuli is not None else []
    mistakes = _find_missing_columns(block, {column for row in rows for column in row.cells} | options.keys())
    if closed := find_closed_window(block.timeline, block.response_deadline_ms):
        mistakes.append(f"block {block.name!r}: {closed}")
    if mistakes:
        return mistakes
    if not rows:
        return _find_row_mistakes(protocol, block, options, "every trial")
    for row in rows:
        mistakes += _find_row_mistakes(protocol, block, options | row.cells, row.place)
    return mistakes


def _list_shown_columns(block: BlockSpec) -> dict[str, str]:
    """Return the columns to which a block's timeline refers, each with the first stimulus and field that names it."""
    columns: dict[str, str] = {}
    for stimulus in block.timeline.stimuli if block.timeline is not None else ():
        for column, field in list_columns(stimulus).items():
            columns.setdefault(column, f"stimulus {stimulus.name!r}, {field}")
    return columns


def _find_missing_columns(block: BlockSpec, columns: set[str]) -> list[str]:
    """Return an error for each column that the timeline names and that is neither in ``columns`` nor the design's."""
    available = set(columns)
    if block.design is not None:
        available.add(str(block.design.settings.get("option", "")))
    options = find_option_names(block.world)
    mistakes = []
    prefix = f"{block.stimuli.file}:1: " if block.stimuli is not None and block.stimuli.file else ""
    for column, user in _list_shown_columns(block).items():
        has_default = column == "delay_ms" and options is not None
        if column not in available and not has_default:
            names = ", ".join(sorted(available - {COUNT, "", "responses"})) or "none"
            mistakes.append(f"{prefix}timeline: {user}: there is no column {column!r}; the columns are {names}")
    return mistakes


def _find_row_mistakes(protocol: Protocol, block: BlockSpec, cells: dict[str, Any], place: str) -> list[str]:
    """Return the errors because of which a row's trial cannot be drawn, heard or ended.

    The trial is tried twice: with each drawn time at the least and at the most of its range. ``cells`` has the world's
    options and the row's cells, and ``place`` is where the row is.
    """
    assert block.timeline is not None
    design_option = str(block.design.settings.get("option", "")) if block.design is not None else ""
    cells = {"delay_ms": 0.0, design_option: 0.0} | cells
    mistakes: dict[str, None] = {}  # in order, each once
    for share in _SHARES:
        try:
            schedule = resolve_trial(block.timeline, cells, block.response_deadline_ms, _make_constant_draw(share))
            for time_ns in schedule.changes_ns:
                contents = [stimulus.content for stimulus in schedule.find_visible(time_ns)]
                draw_stimuli(contents, _DRAWN_PX, protocol.files, protocol.study.language)
            for content in schedule.sound_contents:
                render_sound(content, protocol.files, _RENDERED_HZ)
        except WorldError as error:
            mistakes[f"{place}: {error}"] = None
            continue
        if excess := _describe_excess(block, schedule):
            mistakes[f"{place}: {excess}"] = None
        if endless := find_endless_trial(schedule):
            mistakes[f"{place}: block {block.name!r}: {endless}"] = None
    return list(mistakes)


def _list_timeline_notices(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    """Yield a sentence about each stimulus of a timeline that is probably not presented as it was meant."""
    if block.timeline is None:
        return

    @cache
    def find_duration_ms(content: SoundContent) -> float:
        return 1000 * len(render_sound(content, protocol.files, _RENDERED_HZ)) / _RENDERED_HZ

    trials = [
        (place, resolve_trial(block.timeline, cells, block.response_deadline_ms, _make_constant_draw(share)))
        for place, cells in list_trial_cells(protocol, block)
        for share in _SHARES
    ]
    for notice in list_timeline_notices(block.timeline, trials, find_duration_ms):
        yield f"block {block.name!r}: {notice}"


def _make_constant_draw(share: float) -> DrawShare:
    """Return a function that returns ``share``, 0 to 1, as the random number of each place in a timeline."""
    return lambda place: share


def _describe_excess(block: BlockSpec, schedule: TrialSchedule) -> str:
    """Return a message about a trial that lasts too long for the timeline's ``soa_ms``; "" for any other trial."""
    assert block.timeline is not None
    soa_ms = block.timeline.soa_ms
    if not soa_ms or schedule.end_ns is None:
        return ""
    longest_ms = soa_ms - PREPARATION_MS
    if schedule.end_ns / 1e6 <= longest_ms:
        return ""
    return (
        f"timeline: the trial lasts {schedule.end_ns / 1e6:g} ms; with soa_ms = {soa_ms:g} it lasts {longest_ms:g} at "
        "most, as the next one is prepared before it begins"
    )
