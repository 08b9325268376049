"""The trials of a block: rows of its stimulus table in the participant's own order, with drawn intervals."""

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

import msgspec

from minihuman.activities.play.plan import TrialRules
from minihuman.activities.trials.plan import IMAGE_FORMATS, StimuliSpec
from minihuman.activities.trials.schedule import fill_references, list_columns
from minihuman.activities.trials.stimulus_table import (
    COUNT,
    IMAGE,
    Row,
    TableRow,
    clean_label,
    is_label,
    list_images,
    read_table,
)
from minihuman.activities.trials.trial_order import OrderStream, draw_order
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import apply_overrides
from minihuman.worlds.hashing import refer_to_file

TIMELINE_IMAGE_FORMATS = IMAGE_FORMATS
_MAX_ROWS = 10_000


class TrialStimulus(msgspec.Struct, frozen=True):
    """The stimulus of one trial: a row of a block's table, with images by reference."""

    place: str = ""  # of the row: "words.csv:3"; "" without a table
    options: Row = {}  # of the world
    labels: Row = {}  # that the world never sees


def plan_rules(block: BlockSpec, seed: int, purpose: str, participant: int) -> TrialRules | msgspec.UnsetType:
    """Plan the rules of a block of trials, with drawn intervals; unset for other blocks."""
    intervals_ms: tuple[float, ...] = ()
    if isinstance(block.inter_trial_interval_ms, tuple):
        shortest_ms, longest_ms = block.inter_trial_interval_ms
        words = draw_words(block.episodes, seed=seed, purpose=f"intervals-{purpose}", index=participant)
        shares = words / 2.0**64
        intervals_ms = tuple(
            float(round(shortest_ms + share * (longest_ms - shortest_ms))) for share in shares.tolist()
        )
    rules = TrialRules(block.ready, block.feedback_ms, intervals_ms)
    if rules == TrialRules():
        return msgspec.UNSET
    return rules


def plan_stimuli(protocol: Protocol, block: BlockSpec, purpose: str, participant: int) -> list[TrialStimulus]:
    """Plan the stimulus of each of a block's trials, without the block's own options.

    Raises:
        ProtocolError: if the table cannot be read or no order meets the requested constraints.
    """
    spec = block.stimuli
    if spec is None:
        return [TrialStimulus()] * block.episodes
    stimuli = read_stimuli(protocol, block)
    columns = {name: _find_column(block, stimuli, name) for name in (*spec.balanced_by, *spec.max_run)}
    stream = OrderStream(protocol.study.seed, purpose, participant)
    try:
        order = draw_order(spec, columns, len(stimuli), block.episodes, stream)
    except ProtocolError as error:
        raise ProtocolError(f"block {block.name!r}: {error}") from error
    return [stimuli[row] for row in order]


def _find_column(block: BlockSpec, stimuli: list[TrialStimulus], name: str) -> list[Any]:
    """Return a column's cell for each stimulus; raise ProtocolError if no stimulus has one."""
    rows = [stimulus.options | stimulus.labels for stimulus in stimuli]
    cells = [row.get(name) for row in rows]
    if all(cell is None for cell in cells):
        columns = dict.fromkeys(chain.from_iterable(rows))
        raise ProtocolError(
            f"block {block.name!r}: the order of its stimuli names {name!r}, which is no column of the table; use one "
            f"of {', '.join(columns)}"
        )
    return cells


def read_stimuli(protocol: Protocol, block: BlockSpec) -> list[TrialStimulus]:
    """Read a block's stimuli, repeated by their weights; a row refers to its image in the plan's files.

    Raises:
        ProtocolError: if the file is missing, is no valid table or names a missing image; the message names the row.
    """
    assert block.stimuli is not None
    stimuli: list[TrialStimulus] = []
    for row in read_table(block.stimuli, protocol.files):
        stimuli += [_build_stimulus(protocol, block, row)] * _read_count(block, row)
    if not 0 < len(stimuli) <= _MAX_ROWS:
        raise ProtocolError(f"block {block.name!r} has {len(stimuli)} stimuli; give it 1 to {_MAX_ROWS}")
    return stimuli


def _read_count(block: BlockSpec, row: TableRow) -> int:
    times = row.cells.get(COUNT, 1)
    if not isinstance(times, int) or isinstance(times, bool) or not 0 < times <= _MAX_ROWS:
        raise ProtocolError(
            f"block {block.name!r}: {row.place}: column {COUNT!r}: one of its stimuli has times = {times!r}; use a "
            "whole number of 1 or more"
        )
    return times


def _build_stimulus(protocol: Protocol, block: BlockSpec, row: TableRow) -> TrialStimulus:
    assert block.stimuli is not None
    options: Row = {}
    labels: Row = {}
    for column, cell in row.cells.items():
        if column == COUNT:
            continue
        if is_label(column, block.world, block.stimuli.labels):
            labels[column] = clean_label(cell)
        else:
            options[column] = cell
    if name := options.get(IMAGE):
        if name not in protocol.files:
            raise ProtocolError(
                f"block {block.name!r}: {row.place}: column {IMAGE!r}: it shows {name!r}, which is not in the "
                "protocol's folder; copy it there"
            )
        options[IMAGE] = refer_to_file(protocol.files[str(name)])
    return TrialStimulus(row.place, options, labels)


def list_label_columns(protocol: Protocol, block: BlockSpec) -> tuple[str, ...]:
    """Return the label columns of a block's stimulus table, in table order; empty without a table."""
    if block.stimuli is None:
        return ()
    columns = dict.fromkeys(column for row in read_table(block.stimuli, protocol.files) for column in row.cells)
    return tuple(column for column in columns if is_label(column, block.world, block.stimuli.labels))


def find_files(protocol: Protocol) -> dict[str, bytes]:
    """Return a protocol's stimulus tables and their images, by file name."""
    names = set(_find_file_names(protocol))
    return {name: protocol.files[name] for name in sorted(names)}


def _find_file_names(protocol: Protocol) -> Iterator[str]:
    for block in protocol.blocks:
        if block.stimuli is not None:
            yield from _list_file_names(block.stimuli, protocol.files)
        for group in ("", *block.group_overrides):
            images = read_timeline_images(apply_overrides(block, group), protocol.files)
            yield from (name for name, _ in images if name in protocol.files)
        for group in block.group_overrides:
            spec = apply_overrides(block, group).stimuli
            if spec is not None and (not spec.file or spec.file in protocol.files):  # plans lacked them once
                yield from _list_file_names(spec, protocol.files)


def _list_file_names(spec: StimuliSpec, files: Mapping[str, bytes]) -> Iterator[str]:
    if spec.file:
        yield spec.file
    yield from (name for name in list_images(read_table(spec, files)) if name in files)


def read_images(spec: StimuliSpec, files: Mapping[str, bytes]) -> list[tuple[str, str]]:
    """Return the images that a table names, each with the first row that names it."""
    places: dict[str, str] = {}
    for row in read_table(spec, files):
        if name := row.cells.get(IMAGE):
            places.setdefault(str(name), row.place)
    return list(places.items())


def read_timeline_images(block: BlockSpec, files: Mapping[str, bytes]) -> list[tuple[str, str]]:
    """Return the images of a block's timeline, each with the first row or stimulus that names it."""
    if block.timeline is None:
        return []
    rows = read_table(block.stimuli, files) if block.stimuli is not None else []
    places: dict[str, str] = {}
    for stimulus in block.timeline.stimuli:
        if not stimulus.image:
            continue
        if not list_columns(stimulus):
            places.setdefault(stimulus.image, f"timeline, stimulus {stimulus.name!r}")
        for row in rows:
            if name := fill_references(stimulus.image, row.cells):
                places.setdefault(str(name), f"{row.place}: stimulus {stimulus.name!r}")
    return list(places.items())
