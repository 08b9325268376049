"""The order of a block's trials: whole tables one after another, or trials balanced by label without long runs.

Every choice is drawn from the study's seed, so that a log's plan can be redrawn and compared.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence

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
        """Draw the order of a table's rows; ``table`` is 0 for the block's first table."""
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
    """Return the length of the longest run of equal levels."""
    longest = current = 0
    for place, level in enumerate(levels):
        if place == 0 or level != levels[place - 1]:
            current = 0
        current += 1
        longest = max(longest, current)
    return longest


def _take_balanced(table: Sequence[int], levels: Sequence[Hashable], count: int) -> list[int]:
    """Return a number of a table's rows, in its order: a proportional share of each level by the largest remainder."""
    places = defaultdict[Hashable, list[int]](list)
    for place, row in enumerate(table):
        places[levels[row]].append(place)
    exact = {level: count * len(rows) / len(table) for level, rows in places.items()}
    shares = {level: math.floor(share) for level, share in exact.items()}
    by_remainder = sorted(exact, key=lambda level: shares[level] - exact[level])  # stable: first shown, first taken
    for level in by_remainder[: count - sum(shares.values())]:
        shares[level] += 1
    chosen = sorted(place for level, rows in places.items() for place in rows[: shares[level]])
    return [table[place] for place in chosen]


def _break_runs(
    order: list[int], columns: CellsByColumn, max_run: Mapping[str, int], n_rows: int, words: Iterator[int]
) -> None:
    """Swap trials within each table until no level of a column repeats more often in a row than allowed.

    A swap is kept if it leaves no more overlong runs than before, so the search can leave a plateau.

    Raises:
        ProtocolError: if no such order is found.
    """
    runs = _Runs(order, columns, max_run)
    too_long = runs.list_too_long(range(len(order)))
    for _ in range(_SWAPS_PER_TRIAL * len(order)):
        if not too_long:
            return
        first = too_long[next(words) % len(too_long)]
        begin = first - first % n_rows
        second = begin + next(words) % (min(begin + n_rows, len(order)) - begin)
        near = runs.find_near(first) | runs.find_near(second)
        n_before = len(runs.list_too_long(near))
        order[first], order[second] = order[second], order[first]
        if len(runs.list_too_long(near)) > n_before:
            order[first], order[second] = order[second], order[first]
        else:
            too_long = [place for place in too_long if place not in near] + runs.list_too_long(near)
    limits = ", ".join(f"{name} = {most}" for name, most in max_run.items())
    name = next(name for name in max_run if find_longest_run([columns[name][row] for row in order]) > max_run[name])
    level, count = Counter(columns[name][row] for row in order).most_common(1)[0]
    raise ProtocolError(
        f"stimuli.max_run asks for {limits}, but {count} of {len(order)} trials have {name} = {level!r}, and no such "
        "order was found; allow longer runs or change the table"
    )


class _Runs:
    """The runs of an order that changes, which finds the trials that make a run too long."""

    def __init__(self, order: Sequence[int], columns: CellsByColumn, max_run: Mapping[str, int]) -> None:
        self._order = order
        self._limits = [(columns[name], most) for name, most in max_run.items()]
        self._reach = max(max_run.values())

    def find_near(self, place: int) -> set[int]:
        """Return the positions whose run a trial can be part of."""
        return set(range(place, min(place + self._reach + 1, len(self._order))))

    def list_too_long(self, places: Sequence[int] | set[int]) -> list[int]:
        """Return those positions that extend a run of the longest allowed length."""
        return [place for place in sorted(places) if self._is_too_long(place)]

    def _is_too_long(self, place: int) -> bool:
        return any(
            place >= most and len({column[row] for row in self._order[place - most : place + 1]}) == 1
            for column, most in self._limits
        )
