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

_MOST_LINES = 20  # listed mistakes of a table, as a wrong column is wrong in every row
_MOST_STEPS = 10  # of a trial that is played
_DRAWN_PX = (320, 240)  # size of a timeline's pictures
_HEARD_HZ = 8_000  # rate at which sounds are rendered
_SHARES = (0.0, 1.0)  # random numbers that draw the least and the most of a range
_CLOSE = 0.8  # similarity of names from which a column probably is a misspelt option


def check_stimuli(protocol: Protocol, source: str) -> list[str]:
    """Play every row of every stimulus table once, as each group has it; ``source`` names the file in errors.

    Returns:
        Notices about tables that can be played, one per line.

    Raises:
        ProtocolError: if a row cannot be played, with a line for each that names row, column, value and correction.
    """
    _check_uses(protocol, source)
    notices: dict[str, None] = {}
    for number, block in enumerate(protocol.blocks):
        place = f"{source}: $.blocks[{number}].stimuli"
        for group in ("", *block.group_overrides):
            block_of_group = apply_overrides(block, group)
            if block_of_group.stimuli is not None:
                _check_table(protocol, block_of_group, place)
                notices |= dict.fromkeys(_list_notices(protocol, block_of_group))
            elif mistakes := _find_timeline_mistakes(protocol, block_of_group):
                _refuse(f"{source}: $.blocks[{number}].timeline", mistakes)
            notices |= dict.fromkeys(_list_timeline_notices(protocol, block_of_group))
    return list(notices)


def _check_table(protocol: Protocol, block: BlockSpec, place: str) -> None:
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
    lines = [f"{place}: {mistake}" for mistake in mistakes[:_MOST_LINES]]
    if len(mistakes) > _MOST_LINES:
        lines.append(f"{place}: {len(mistakes) - _MOST_LINES} more mistakes of this table are not listed")
    raise ProtocolError("\n".join(lines))


def _check_uses(protocol: Protocol, source: str) -> None:
    """Check that the labels and levels that the analysis and the exclusions name are in a table.

    Raises:
        ProtocolError: if any is not, with a line for each.
    """
    levels = list_levels(protocol)
    if levels:
        known = f"its labels are {', '.join(levels)}"
    else:
        known = "its tables of stimuli have no labels"
    mistakes = []
    if (label := protocol.analysis.condition_label) and label not in levels:
        mistakes.append(f"$.analysis.conditions: has 'label:{label}', which is no label; {known}")
    elif label:
        mistakes += _find_unknown_levels(protocol, list(map(str, levels[label])))
    for number, rule in enumerate(protocol.exclusions):
        path = f"$.exclusions[{number}]"
        if rule.measured_label and rule.measured_label not in levels:
            mistakes.append(f"{path}.measure: is {rule.measure!r}, which is no label; {known}")
        for name, level in rule.where.items():
            if name not in levels:
                mistakes.append(f"{path}.where: has {name!r}, which is no label; {known}")
            elif level not in levels[name]:
                known_levels = ", ".join(map(repr, list(levels[name])[:10]))
                mistakes.append(
                    f"{path}.where: has {name} = {level!r}, which no row has; its levels are {known_levels}"
                )
    if mistakes:
        raise ProtocolError("\n".join(f"{source}: {mistake}" for mistake in mistakes))


def _find_unknown_levels(protocol: Protocol, levels: list[str]) -> Iterator[str]:
    """Yield an error for each name in a contrast that is no level of the label whose levels are compared."""
    for number, contrast in enumerate(protocol.design.contrasts):
        place = f"$.design.contrasts[{number}].weights"
        for path, message in check_weighted_conditions(place, contrast.weights, levels):
            yield f"{path}: {message}"


def list_levels(protocol: Protocol) -> dict[str, list[Any]]:
    """Return the levels of each label of a protocol's tables."""
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


def _name_header(stimuli: StimuliSpec, place: str) -> str:
    """Return where a table's column names are: the file's first row, or ``place`` for rows in the protocol."""
    if stimuli.file:
        return f"{stimuli.file}:1"
    return place


def _find_unnameable_labels(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    """Yield an error for each label that cannot be a table column or whose column would clash with another."""
    assert block.stimuli is not None
    columns: dict[str, str] = {}
    place = _name_header(block.stimuli, "rows[0]")
    for label in list_label_columns(protocol, block):
        column = name_label_column(label)
        if '"' in label or column == "label_":
            yield f"{place}: column {label!r}: a label's name has letters or digits and no quotation marks"
        elif (other := columns.setdefault(column, label)) != label:
            yield f"{place}: column {label!r}: in tables it would be {column}, as column {other!r}; rename one"


def _find_misspelt_columns(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    """Yield an error for each label that resembles an option, since a misspelt stimulus would silently not be shown."""
    assert block.stimuli is not None
    options = find_option_names(block.world) or OptionNames(())
    known = (*options.names, COUNT, IMAGE)
    first = read_table(block.stimuli, protocol.files)[:1]
    for column in list_label_columns(protocol, block):
        close = difflib.get_close_matches(column.strip().lower(), known, n=1, cutoff=_CLOSE)
        if column not in (*block.stimuli.labels, *_list_shown_columns(block)) and close:
            place = _name_header(block.stimuli, first[0].place)
            yield (
                f"{place}: column {column!r}: {block.world} has no such option; did you mean {close[0]!r}? If it is a "
                f"label, say so: labels = [{json.dumps(column)}]"
            )


def _find_empty_rows(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    assert block.stimuli is not None
    for row in read_table(block.stimuli, protocol.files):
        if not row.cells:
            yield f"{row.place}: this row is empty; fill in its columns or delete it"


def _find_unplayable_rows(block: BlockSpec, stimuli: list[TrialStimulus]) -> Iterator[str]:
    """Yield an error for each column of a row because of which the block's world cannot be played."""
    shared = list_world_options(block)
    needs_table = bool(_try_options(block, shared))
    mistakes: dict[str, list[str]] = {}  # by the row's options: equal rows have equal mistakes
    for stimulus in {stimulus.place: stimulus for stimulus in stimuli}.values():
        key = json.dumps(stimulus.options, sort_keys=True)
        if key not in mistakes:
            mistakes[key] = list(_explain_unplayable(block, shared, stimulus.options, needs_table=needs_table))
        yield from (f"{stimulus.place}: {mistake}" for mistake in mistakes[key])


def _explain_unplayable(
    block: BlockSpec, shared: dict[str, Any], options: dict[str, Any], *, needs_table: bool
) -> Iterator[str]:
    """Yield which columns of a row are wrong and why; nothing if the row can be played."""
    reason = _try_options(block, shared | options)
    if not reason:
        return
    reasons: dict[str, str] = {}  # by column
    if not needs_table:
        reasons = _try_each_column(block, shared, options)
    if not reasons:  # no column is wrong by itself, so name those without which the others can be played
        for column in options:
            others = {name: option for name, option in options.items() if name != column}
            if not _try_options(block, shared | others):
                reasons[column] = reason
    for column, column_reason in reasons.items():
        yield f"column {column!r}, value {options[column]!r}: {column_reason}"
    if not reasons:
        yield f"columns {', '.join(map(repr, options))}: {reason}"


def _try_each_column(block: BlockSpec, shared: dict[str, Any], options: dict[str, Any]) -> dict[str, str]:
    """Return the columns that cannot be played even by themselves, each with the reason."""
    reasons = {column: _try_options(block, shared | {column: option}) for column, option in options.items()}
    return {column: reason for column, reason in reasons.items() if reason}


def _try_options(block: BlockSpec, options: dict[str, Any]) -> str:
    """Draw a world with these options, and play a trial with each of the block's actions; return the error or ""."""
    try:
        with closing(World(block.world, options)) as world:
            world.name_actions(block.actions)
            world.reset(0)
            world.frame(block.view, palette=block.palette)
            for action in dict.fromkeys((*block.actions, *block.distractors, *filter(None, (block.noop_action,)))):
                _play_trial(world, world.action_names.index(action), min(block.max_steps, _MOST_STEPS))
    except Exception as error:  # whatever a world raises would end a participant's session
        if isinstance(error, WorldError):
            cause = error.__cause__
            if isinstance(cause, WorldError | TypeError | ValueError):
                reason = cause
            else:
                reason = error
            return str(reason).removeprefix(f"{block.world}: ")
        return f"{type(error).__name__}: {error}"
    return ""


def _play_trial(world: World, action: int, most_steps: int) -> None:
    world.reset(0)
    for _ in range(most_steps):
        step = world.step(action)
        if step.terminated or step.truncated:
            break


def _list_notices(protocol: Protocol, block: BlockSpec) -> Iterator[str]:
    """Yield notices about a table's labels, which are not shown, and about correct responses that have no key."""
    assert block.stimuli is not None
    shown = _list_shown_columns(block)
    if labels := [column for column in list_label_columns(protocol, block) if column not in shown]:
        yield f"block {block.name!r}: its table of stimuli has labels, which are not shown: {', '.join(labels)}"
    for row in read_table(block.stimuli, protocol.files):
        correct = row.cells.get("correct")
        if correct is None or is_label("correct", block.world, block.stimuli.labels):
            continue
        if str(correct) not in (*block.actions, block.noop_action):
            yield f"block {block.name!r}: {row.place}: no key does {correct!r}, which is the correct response"


def _find_timeline_mistakes(protocol: Protocol, block: BlockSpec) -> list[str]:
    """Return what prevents a block's timeline from being played, with row, stimulus and field; empty without one."""
    if block.timeline is None:
        return []
    shared = list_world_options(block)
    rows = read_table(block.stimuli, protocol.files) if block.stimuli is not None else []
    mistakes = _find_missing_columns(block, {column for row in rows for column in row.cells} | shared.keys())
    if closed := find_closed_window(block.timeline, block.response_deadline_ms):
        mistakes.append(f"block {block.name!r}: {closed}")
    if mistakes:
        return mistakes
    if not rows:
        return _find_row_mistakes(protocol, block, shared, "every trial")
    for row in rows:
        mistakes += _find_row_mistakes(protocol, block, shared | row.cells, row.place)
    return mistakes


def _list_shown_columns(block: BlockSpec) -> dict[str, str]:
    """Return the columns to which a block's timeline refers, each with the first stimulus and field that names it."""
    columns: dict[str, str] = {}
    for stimulus in block.timeline.stimuli if block.timeline is not None else ():
        for column, field in list_columns(stimulus).items():
            columns.setdefault(column, f"stimulus {stimulus.name!r}, {field}")
    return columns


def _find_missing_columns(block: BlockSpec, columns: set[str]) -> list[str]:
    """Return an error for each column that the timeline names and neither the table nor the design has."""
    known = set(columns)
    if block.design is not None:
        known.add(str(block.design.settings.get("option", "")))
    options = find_option_names(block.world)
    mistakes = []
    place = f"{block.stimuli.file}:1: " if block.stimuli is not None and block.stimuli.file else ""
    for column, user in _list_shown_columns(block).items():
        has_default = column == "delay_ms" and options is not None
        if column not in known and not has_default:
            names = ", ".join(sorted(known - {COUNT, "", "responses"})) or "none"
            mistakes.append(f"{place}timeline: {user}: there is no column {column!r}; the columns are {names}")
    return mistakes


def _find_row_mistakes(protocol: Protocol, block: BlockSpec, cells: dict[str, Any], place: str) -> list[str]:
    """Return what prevents a row's trial from being drawn, heard or ended, with its drawn times short and long."""
    assert block.timeline is not None
    design_option = str(block.design.settings.get("option", "")) if block.design is not None else ""
    cells = {"delay_ms": 0.0, design_option: 0.0} | cells
    mistakes: dict[str, None] = {}
    for share in _SHARES:
        try:
            schedule = resolve_trial(block.timeline, cells, block.response_deadline_ms, _draw_always(share))
            for time_ns in schedule.changes_ns:
                contents = [stimulus.content for stimulus in schedule.find_visible(time_ns)]
                draw_stimuli(contents, _DRAWN_PX, protocol.files, protocol.study.language)
            for content in schedule.sound_contents:
                render_sound(content, protocol.files, _HEARD_HZ)
        except WorldError as error:
            mistakes[f"{place}: {error}"] = None
            continue
        if excess := _find_excess(block, schedule):
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
        return 1000 * len(render_sound(content, protocol.files, _HEARD_HZ)) / _HEARD_HZ

    trials = [
        (place, resolve_trial(block.timeline, cells, block.response_deadline_ms, _draw_always(share)))
        for place, cells in list_trial_cells(protocol, block)
        for share in _SHARES
    ]
    for notice in list_timeline_notices(block.timeline, trials, find_duration_ms):
        yield f"block {block.name!r}: {notice}"


def _draw_always(share: float) -> DrawShare:
    """Return a function that ignores how many random numbers are requested and always draws the same share."""
    return lambda place: share


def _find_excess(block: BlockSpec, schedule: TrialSchedule) -> str:
    """Return why a trial lasts too long for the timeline's ``soa_ms``; "" if it does not."""
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
