"""The trials of a block: rows of its stimulus table in the participant's own order, with drawn intervals."""

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any, Literal

import msgspec

from minihuman.activities.play.plan import TrialRules
from minihuman.activities.trials.plan import IMAGE_FORMATS, StimuliSpec
from minihuman.activities.trials.schedule import fill_references, list_columns, resolve_trial
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
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol, decode_logged_protocol
from minihuman.experiment.protocol.specs import apply_overrides
from minihuman.experiment.sounds import NOISE, TONE, SoundContent, compute_digest
from minihuman.worlds.hashing import refer_to_file

TIMELINE_IMAGE_FORMATS = IMAGE_FORMATS
_MAX_ROWS = 10_000


class TrialStimulus(msgspec.Struct, frozen=True):
    """The stimulus of one trial: a row of a block's table, with images by reference."""

    place: str = ""  # where the row is, such as "words.csv:3"; "" without a table
    options: Row = {}  # cells that are options of the world
    labels: Row = {}  # cells that are not passed to the world


def plan_rules(block: BlockSpec, seed: int, purpose: str, participant: int) -> TrialRules | msgspec.UnsetType:
    """Return the rules of a block's trials, with drawn intervals; unset if all of them are the defaults.

    Args:
        block: the block.
        seed: the study's seed.
        purpose: names the random stream, together with the participant.
        participant: the participant's index.
    """
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
    """Return the stimulus of each of a block's trials, without the block's own options.

    ``purpose`` and ``participant``, the participant's index, name the random stream of the order.

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
    """Return a column's cell for each stimulus, None for a stimulus without one.

    Raises:
        ProtocolError: if no stimulus has one.
    """
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
    """Return the stimuli of a block's table, each repeated as its count says; an image refers to the plan's files.

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
    """Return how often a row of a block's table is repeated.

    Raises:
        ProtocolError: if the row's count is not a whole number from 1 on.
    """
    count = row.cells.get(COUNT, 1)
    if not isinstance(count, int) or isinstance(count, bool) or not 0 < count <= _MAX_ROWS:
        raise ProtocolError(
            f"block {block.name!r}: {row.place}: column {COUNT!r}: one of its stimuli has times = {count!r}; use a "
            "whole number of 1 or more"
        )
    return count


def _build_stimulus(protocol: Protocol, block: BlockSpec, row: TableRow) -> TrialStimulus:
    """Return the stimulus of a row, with options apart from labels, and its image referred to by content.

    Raises:
        ProtocolError: if the image is missing.
    """
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
    """Return a protocol's tables of stimuli, and the images and sounds of its stimuli and timelines, by file name."""
    names = set(_list_stimulus_files(protocol))
    return {name: protocol.files[name] for name in sorted(names)}


def _list_stimulus_files(protocol: Protocol) -> Iterator[str]:
    """Yield the names of the files that a protocol's stimuli and timelines use, in any group; names may repeat."""
    for block in protocol.blocks:
        if block.stimuli is not None:
            yield from _list_table_files(block.stimuli, protocol.files)
        for group in ("", *block.group_overrides):
            block_of_group = apply_overrides(block, group)
            timeline_files = read_timeline_images(block_of_group, protocol.files)
            timeline_files += read_timeline_sounds(block_of_group, protocol.files)
            yield from (name for name, _ in timeline_files if name in protocol.files)
        for group in block.group_overrides:
            spec = apply_overrides(block, group).stimuli
            if spec is not None and (not spec.file or spec.file in protocol.files):  # earlier plans lack these files
                yield from _list_table_files(spec, protocol.files)


def _list_table_files(spec: StimuliSpec, files: Mapping[str, bytes]) -> Iterator[str]:
    """Yield the names of the file of a table of stimuli, if it has one, and of the images in the table."""
    if spec.file:
        yield spec.file
    yield from (name for name in list_images(read_table(spec, files)) if name in files)


def read_images(spec: StimuliSpec, files: Mapping[str, bytes]) -> list[tuple[str, str]]:
    """Return the file names of the images in a table of stimuli, each with the place of the first row that has it."""
    places: dict[str, str] = {}
    for row in read_table(spec, files):
        if name := row.cells.get(IMAGE):
            places.setdefault(str(name), row.place)
    return list(places.items())


def read_timeline_images(block: BlockSpec, files: Mapping[str, bytes]) -> list[tuple[str, str]]:
    """Return the names of a timeline's image files, each with the place of the first row or stimulus that names it."""
    return list(_read_timeline_files(block, files, "image").items())


def read_timeline_sounds(block: BlockSpec, files: Mapping[str, bytes]) -> list[tuple[str, str]]:
    """Return the names of a timeline's sound files, each with the place of the first row or stimulus that names it."""
    places = _read_timeline_files(block, files, "sound")
    return [(name, place) for name, place in places.items() if name not in (TONE, NOISE)]


def _read_timeline_files(
    block: BlockSpec, files: Mapping[str, bytes], field: Literal["image", "sound"]
) -> dict[str, str]:
    """Return the names in a field of a timeline's stimuli, each with the place of the first row or stimulus with it.

    References to columns in the field are replaced by the cells of each row of the block's table.
    """
    if block.timeline is None:
        return {}
    rows = read_table(block.stimuli, files) if block.stimuli is not None else []
    places: dict[str, str] = {}
    for stimulus in block.timeline.stimuli:
        template = getattr(stimulus, field)
        if not template:
            continue
        if not list_columns(stimulus):
            places.setdefault(template, f"timeline, stimulus {stimulus.name!r}")
        for row in rows:
            if name := str(fill_references(template, row.cells)).strip():
                places.setdefault(name, f"{row.place}: stimulus {stimulus.name!r}")
    return places


def list_sounds(plan: SessionPlan) -> list[SoundContent]:
    """Return the sounds that the timelines of a session's protocol can play, in any group, each once."""
    if b"sound" not in plan.protocol_toml:
        return []
    return list_protocol_sounds(msgspec.structs.replace(decode_logged_protocol(plan.protocol_toml), files=plan.files))


def list_sound_digests(plan: SessionPlan) -> list[str]:
    """Return the digests (`compute_digest`) of the sounds that a session can play."""
    return [compute_digest(content, plan.files) for content in list_sounds(plan)]


def list_protocol_sounds(protocol: Protocol) -> list[SoundContent]:
    """Return the sounds that a protocol's timelines can play, in any group, each once."""
    contents: dict[SoundContent, None] = {}
    for block in protocol.blocks:
        for group in ("", *block.group_overrides):
            contents |= dict.fromkeys(_list_block_sounds(protocol, apply_overrides(block, group)))
    return list(contents)


def _list_block_sounds(protocol: Protocol, block: BlockSpec) -> Iterator[SoundContent]:
    """Yield the sounds of each trial that a block can have; sounds may repeat."""
    if block.timeline is None or not any(stimulus.sound for stimulus in block.timeline.stimuli):
        return
    for _, cells in list_trial_cells(protocol, block):
        # with the middle of each range from which a time is drawn
        schedule = resolve_trial(block.timeline, cells, block.response_deadline_ms, lambda place: 0.5)
        yield from schedule.sound_contents


def list_trial_cells(protocol: Protocol, block: BlockSpec) -> Iterator[tuple[str, Row]]:
    """Yield the place of the row ("every trial" without a table) and the cells of each trial that a block can have."""
    stimuli = [TrialStimulus("every trial")]
    if block.stimuli is not None:
        stimuli = list({stimulus.place: stimulus for stimulus in read_stimuli(protocol, block)}.values())
    for stimulus in stimuli:
        for design_cells in _list_design_cells(block):
            row_cells = stimulus.labels | stimulus.options
            yield stimulus.place, {"delay_ms": 0.0} | block.options | row_cells | design_cells


def _list_design_cells(block: BlockSpec) -> list[Row]:
    """Return a row for each value of the option that a block's design sets; one row with 0 if it lists no values.

    Without a design, or if it sets no option, return one empty row.
    """
    if block.design is None or "option" not in block.design.settings:
        return [{}]
    settings = block.design.settings
    option = str(settings["option"])
    return [{option: option_value} for option_value in settings.get("values") or (0.0,)]
