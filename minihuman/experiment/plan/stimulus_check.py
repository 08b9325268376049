"""Checks of stimulus tables before a study begins: the world of every row is created, drawn and played once."""

import difflib
import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any

from minihuman.activities.trials.plan import StimuliSpec
from minihuman.activities.trials.stimulus_table import (
    COUNT,
    IMAGE,
    OptionNames,
    find_option_names,
    is_label,
    read_table,
)
from minihuman.errors import ProtocolError, WorldError
from minihuman.experiment.plan.part_plans import list_world_options
from minihuman.experiment.plan.session_plan import name_label_column
from minihuman.experiment.plan.timeline_check import find_timeline_mistakes, list_shown_columns
from minihuman.experiment.plan.trials import TrialStimulus, list_label_columns, read_stimuli
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import apply_overrides
from minihuman.worlds.adapters.world import World

_MOST_LINES = 20  # of a table's mistakes; a wrong column is wrong in every row
_MOST_STEPS = 10  # of a trial that is tried
_CLOSE = 0.8  # how similar a column's name is to an option's that it was probably meant to be


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
            elif mistakes := find_timeline_mistakes(protocol, block_of_group):
                _refuse(f"{source}: $.blocks[{number}].timeline", mistakes)
    return list(notices)


def _check_table(protocol: Protocol, block: BlockSpec, place: str) -> None:
    mistakes = [*_find_misspelt_columns(protocol, block), *_find_unnameable_labels(protocol, block)]
    mistakes += _find_empty_rows(protocol, block)
    mistakes += _find_unplayable_rows(block, read_stimuli(protocol, block))
    mistakes += find_timeline_mistakes(protocol, block)
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
        if column not in (*block.stimuli.labels, *list_shown_columns(block)) and close:
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
    shared = list_world_options(block)
    needs_table = bool(_play(block, shared))
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
    reason = _play(block, shared | options)
    if not reason:
        return
    if needs_table:
        guilty = {}
    else:
        guilty = {column: _play(block, shared | {column: options[column]}) for column in options}
    if not any(guilty.values()):  # no column is wrong by itself: which one, if left out, lets the others be played?
        options_without = {column: {name: options[name] for name in options if name != column} for column in options}
        guilty = {column: reason for column in options if not _play(block, shared | options_without[column])}
    for column, why in guilty.items():
        if why:
            yield f"column {column!r}, value {options[column]!r}: {why}"
    if not guilty:
        yield f"columns {', '.join(map(repr, options))}: {reason}"


def _play(block: BlockSpec, options: dict[str, Any]) -> str:
    """Create, draw and play a trial with each of the block's actions; return the error, or "" if there was none."""
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
    assert block.stimuli is not None
    shown = list_shown_columns(block)
    if labels := [column for column in list_label_columns(protocol, block) if column not in shown]:
        yield f"block {block.name!r}: its table of stimuli has labels, which are not shown: {', '.join(labels)}"
    for row in read_table(block.stimuli, protocol.files):
        correct = row.cells.get("correct")
        if correct is None or is_label("correct", block.world, block.stimuli.labels):
            continue
        if str(correct) not in (*block.actions, block.noop_action):
            yield f"block {block.name!r}: {row.place}: no key does {correct!r}, which is the correct response"
