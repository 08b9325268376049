"""The trials of a block: rows of its table of stimuli in an order of the participant's own, and drawn intervals."""

import csv
import io
import math
from collections.abc import Mapping
from typing import Any

import msgspec

from minihuman.activities.play.plan import TrialRules
from minihuman.activities.trials.plan import StimuliSpec
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.random_streams import draw_permutation, draw_words
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.worlds.hashing import refer_to_file

IMAGE, COUNT = "image", "times"  # columns with a meaning of their own: a PNG beside the protocol, how often a row comes
_MAX_ROWS = 10_000

Row = dict[str, Any]


def plan_rules(block: BlockSpec, seed: int, purpose: str, participant: int) -> TrialRules | msgspec.UnsetType:
    """What makes a block's episodes into trials, its intervals drawn; unset where nothing does."""
    interval = block.inter_trial_interval_ms
    drawn: tuple[float, ...] = ()
    if isinstance(interval, tuple):
        shares = draw_words(block.episodes, seed=seed, purpose=f"intervals-{purpose}", index=participant) / 2.0**64
        drawn = tuple(float(round(interval[0] + share * (interval[1] - interval[0]))) for share in shares.tolist())
    rules = TrialRules(block.ready, block.feedback_ms, drawn)
    return msgspec.UNSET if rules == TrialRules() else rules


def plan_options(protocol: Protocol, block: BlockSpec, purpose: str, participant: int) -> list[Row]:
    """The options of each of a block's worlds: the block's own, and those of the trial's row.

    Raises:
        ProtocolError: if the table cannot be read.
    """
    if block.stimuli is None:
        return [dict(block.options)] * block.episodes
    rows = read_stimuli(protocol, block)
    order: list[int] = []
    while len(order) < block.episodes:
        drawn = f"trials-{purpose}-{len(order) // len(rows)}"
        once = range(len(rows))
        shuffled = block.stimuli.order == "shuffled"
        order += (
            draw_permutation(len(rows), seed=protocol.study.seed, purpose=drawn, index=participant)
            if shuffled
            else once
        )
    return [{**block.options, **rows[place]} for place in order[: block.episodes]]


def read_stimuli(protocol: Protocol, block: BlockSpec) -> list[Row]:
    """A block's stimuli, each as often as it says it comes; a row refers to its image in the plan's files.

    Raises:
        ProtocolError: if the file is missing, is no table, or names an image that is not there.
    """
    assert block.stimuli is not None
    rows: list[Row] = []
    for row in read_table(block.stimuli, protocol.files):
        times = row.pop(COUNT, 1)
        if not isinstance(times, int) or not 0 < times <= _MAX_ROWS:
            raise ProtocolError(
                f"block {block.name!r}: one of its stimuli has times = {times!r}; use a whole number of 1 or more"
            )
        if name := row.get(IMAGE):
            if name not in protocol.files:
                raise ProtocolError(
                    f"block {block.name!r} shows {name!r}, which is not in the protocol's folder; copy it there"
                )
            row[IMAGE] = refer_to_file(protocol.files[name])
        rows += [row] * times
    if not 0 < len(rows) <= _MAX_ROWS:
        raise ProtocolError(f"block {block.name!r} has {len(rows)} stimuli; give it 1 to {_MAX_ROWS}")
    return rows


def read_table(spec: StimuliSpec, files: Mapping[str, bytes]) -> list[Row]:
    """A table's rows as they are written.

    Raises:
        ProtocolError: if the file is missing or is no table.
    """
    if not spec.file:
        return [dict(row) for row in spec.rows]
    if spec.file not in files:
        raise ProtocolError(f"the stimulus file {spec.file!r} is not in the protocol's folder; copy it there")
    return _read_csv(files[spec.file], spec.file)


def find_files(protocol: Protocol) -> dict[str, bytes]:
    """The tables of stimuli of a protocol and their images."""
    tables = [block.stimuli for block in protocol.blocks if block.stimuli is not None]
    names = {table.file for table in tables if table.file}
    names.update(*(list_images(read_table(table, protocol.files)) for table in tables))
    return {name: protocol.files[name] for name in sorted(names)}


def list_images(rows: list[Row]) -> list[str]:
    """The files that a table's rows name."""
    return list(dict.fromkeys(str(row[IMAGE]) for row in rows if row.get(IMAGE)))


def _read_csv(content: bytes, name: str) -> list[Row]:
    try:
        lines = list(csv.DictReader(io.StringIO(content.decode("utf-8-sig")), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ProtocolError(
            f"{name} is not a CSV file in UTF-8 ({error}); save it as one, with commas between cells"
        ) from error
    wrong = next((number for number, line in enumerate(lines, 2) if None in line or None in line.values()), None)
    if wrong is not None:
        raise ProtocolError(
            f"{name}:{wrong}: this row has more or fewer cells than the header; give it one cell per column"
        )
    return [{column: _value(cell) for column, cell in line.items() if cell != ""} for line in lines]


def _value(cell: str) -> str | int | float:
    """A cell as a number where it is written as one and no other way: "007", "1_0" and "nan" are texts."""
    for kind in (int, float):
        try:
            value = kind(cell)
        except ValueError:
            continue
        if str(value) == cell and math.isfinite(value):
            return value
    return cell
