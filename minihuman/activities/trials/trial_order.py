"""The order of a block's trials: whole tables one after another, or trials balanced by label without long runs.

Every choice is drawn from the study's seed, so that a log's plan can be redrawn and compared.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from itertools import groupby

import msgspec

from minihuman.activities.trials.plan import StimuliSpec
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.random_streams import draw_permutation, draw_words

CellsByColumn = Mapping[str, Sequence[Hashable]]  # by name, a cell per row of the table
_SWAPS_PER_TRIAL = 200  # that are tried before an order counts as impossible
_WORDS_AT_ONCE = 1024


class OrderStream(msgspec.Struct, frozen=True):
    """The random stream that orders a block's trials for one participant."""

    seed: int  # the study's
    purpose: str  # block and session
    participant: int  # index of enrolment

    def permute(self, count: int, table: int) -> tuple[int, ...]:
        """Draw the order of ``count`` rows in one pass through the table; ``table`` is 0 for the block's first pass."""
        purpose = f"trials-{self.purpose}-{table}"
        return draw_permutation(count, seed=self.seed, purpose=purpose, index=self.participant)

    def words(self) -> Iterator[int]:
        """Yield an endless sequence of random 64-bit integers."""
        chunk = 0
        while True:
            purpose = f"runs-{self.purpose}-{chunk}"
            yield from draw_words(_WORDS_AT_ONCE, seed=self.seed, purpose=purpose, index=self.participant).tolist()
            chunk += 1


def draw_order(spec: StimuliSpec, columns: CellsByColumn, n_rows: int, n_trials: int, stream: OrderStream) -> list[int]:
    """Draw the table row that each trial shows.

    Args:
        spec: the protocol's settings of the order.
        columns: the cells of the columns that the settings name.
        n_rows: the number of rows of the table, after repetition by their weights.
        n_trials: the number of trials in the block.
        stream: the random stream to draw from.

    Raises:
        ProtocolError: if no order with short enough runs was found.
    """
    order: list[int] = []
    while len(order) < n_trials:
        n_missing = n_trials - len(order)
        table: Sequence[int] = range(n_rows)
        if spec.order == "shuffled":
            table = stream.permute(n_rows, len(order) // n_rows)
        if n_missing < n_rows and spec.balanced_by:
            levels = list(zip(*(columns[name] for name in spec.balanced_by), strict=True))
            table = _take_balanced(table, levels, n_missing)
        order += table[:n_missing]
    if spec.max_run:
        _break_runs(order, columns, spec.max_run, n_rows, stream.words())
    return order


def find_longest_run(levels: Sequence[Hashable]) -> int:
    """Return the length of the longest run of equal levels; 0 without levels."""
    return max((len(list(run)) for _, run in groupby(levels)), default=0)


def _take_balanced(table: Sequence[int], levels: Sequence[Hashable], count: int) -> list[int]:
    """Return ``count`` rows of a table in the table's order, in which each level keeps its share of the table.

    Shares are rounded by the largest-remainder method. ``levels`` has the level of each row.
    """
    positions = defaultdict[Hashable, list[int]](list)  # by level, in the table
    for position, row in enumerate(table):
        positions[levels[row]].append(position)
    exact_counts = {level: count * len(level_positions) / len(table) for level, level_positions in positions.items()}
    counts = {level: math.floor(exact) for level, exact in exact_counts.items()}
    by_remainder = sorted(counts, key=lambda level: counts[level] - exact_counts[level])  # ties: the first shown first
    for level in by_remainder[: count - sum(counts.values())]:
        counts[level] += 1
    chosen: list[int] = []
    for level, level_positions in positions.items():
        chosen += level_positions[: counts[level]]
    return [table[position] for position in sorted(chosen)]


def _break_runs(
    order: list[int], columns: CellsByColumn, max_run: Mapping[str, int], n_rows: int, words: Iterator[int]
) -> None:
    """Swap trials within each table, in place, until no level of a column repeats more often in a row than allowed.

    A swap is kept if it leaves no more overlong runs than before, so the search can leave a plateau.

    Args:
        order: the table row of each trial.
        columns: the cells of the columns, by row.
        max_run: for each column, how often a level may repeat in a row.
        n_rows: the number of rows of a table.
        words: random integers.

    Raises:
        ProtocolError: if no such order is found.
    """
    runs = _Runs(order, columns, max_run)
    too_long = runs.list_too_long(range(len(order)))
    for _ in range(_SWAPS_PER_TRIAL * len(order)):
        if not too_long:
            return
        first = too_long[next(words) % len(too_long)]
        table_begin = first - first % n_rows  # of the pass through the table in which the trial lies
        table_end = min(table_begin + n_rows, len(order))
        second = table_begin + next(words) % (table_end - table_begin)
        affected = runs.find_near(first) | runs.find_near(second)
        n_too_long = len(runs.list_too_long(affected))
        order[first], order[second] = order[second], order[first]
        if len(runs.list_too_long(affected)) > n_too_long:
            order[first], order[second] = order[second], order[first]
        else:
            too_long = [position for position in too_long if position not in affected] + runs.list_too_long(affected)
    limits = ", ".join(f"{name} = {longest}" for name, longest in max_run.items())
    name = next(name for name in max_run if find_longest_run([columns[name][row] for row in order]) > max_run[name])
    level, count = Counter(columns[name][row] for row in order).most_common(1)[0]
    raise ProtocolError(
        f"stimuli.max_run asks for {limits}, but {count} of {len(order)} trials have {name} = {level!r}, and no such "
        "order was found; allow longer runs or change the table"
    )


class _Runs:
    """The runs of equal levels in an order of trials that may change, with their longest allowed lengths."""

    def __init__(self, order: Sequence[int], columns: CellsByColumn, max_run: Mapping[str, int]) -> None:
        self._order = order
        self._limits = [(columns[name], longest) for name, longest in max_run.items()]
        self._reach = max(max_run.values())

    def find_near(self, position: int) -> set[int]:
        """Return the positions whose run can become too long by a change of the trial at a position."""
        return set(range(position, min(position + self._reach + 1, len(self._order))))

    def list_too_long(self, positions: Sequence[int] | set[int]) -> list[int]:
        """Return, in order, those of the positions up to which a run of equal levels is longer than allowed."""
        return [position for position in sorted(positions) if self._is_too_long(position)]

    def _is_too_long(self, position: int) -> bool:
        """Return whether the run of equal levels that reaches up to a position is too long, in any column."""
        return any(
            position >= longest and len({column[row] for row in self._order[position - longest : position + 1]}) == 1
            for column, longest in self._limits
        )
