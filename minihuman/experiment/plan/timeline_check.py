"""Checks of timelines before a study begins: the timeline of every row is resolved and each of its pictures drawn."""

from typing import Any

from minihuman.activities.trials.drawing import draw_stimuli
from minihuman.activities.trials.schedule import PREPARATION_MS, TrialSchedule, list_columns, resolve_trial
from minihuman.activities.trials.stimulus_table import COUNT, find_option_names, read_table
from minihuman.errors import WorldError
from minihuman.experiment.plan.part_plans import list_world_options
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol

_SIZE_PX = (320, 240)
_SHARES = (0.0, 1.0)  # of what is drawn from a range: the shortest and the longest


def find_timeline_mistakes(protocol: Protocol, block: BlockSpec) -> list[str]:
    """Return what prevents a block's timeline from being played, with row, stimulus and field; empty without one."""
    if block.timeline is None:
        return []
    shared = list_world_options(block)
    rows = read_table(block.stimuli, protocol.files) if block.stimuli is not None else []
    mistakes = _find_missing_columns(block, {column for row in rows for column in row.cells} | shared.keys())
    if mistakes:
        return mistakes
    if not rows:
        return _find_row_mistakes(protocol, block, shared, "every trial")
    for row in rows:
        mistakes += _find_row_mistakes(protocol, block, shared | row.cells, row.place)
    return mistakes


def list_shown_columns(block: BlockSpec) -> dict[str, str]:
    """Return the columns to which a block's timeline refers, each with the stimulus and field that does."""
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
    for column, user in list_shown_columns(block).items():
        has_default = column == "delay_ms" and options is not None
        if column not in known and not has_default:
            names = ", ".join(sorted(known - {COUNT, "", "responses"})) or "none"
            mistakes.append(f"{place}timeline: {user}: there is no column {column!r}; the columns are {names}")
    return mistakes


def _find_row_mistakes(protocol: Protocol, block: BlockSpec, cells: dict[str, Any], place: str) -> list[str]:
    assert block.timeline is not None
    design_option = str(block.design.settings.get("option", "")) if block.design is not None else ""
    cells = {"delay_ms": 0.0, design_option: 0.0} | cells
    mistakes: dict[str, None] = {}
    for share in _SHARES:
        try:
            schedule = resolve_trial(block.timeline, cells, block.response_deadline_ms, lambda _, share=share: share)
            for time_ns in schedule.changes_ns:
                contents = [stimulus.content for stimulus in schedule.find_visible(time_ns)]
                draw_stimuli(contents, _SIZE_PX, protocol.files, protocol.study.language)
        except WorldError as error:
            mistakes[f"{place}: {error}"] = None
            continue
        if excess := _find_excess(block, schedule):
            mistakes[f"{place}: {excess}"] = None
    return list(mistakes)


def _find_excess(block: BlockSpec, schedule: TrialSchedule) -> str:
    """Return why a trial does not fit into the block's rhythm; "" if it does."""
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
