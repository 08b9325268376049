"""A report's page compared with what its logs say: every heading, sentence and table in order, to the last digit.

Statistics are SciPy's and statsmodels': intervals and exact p are compared as printed, permutation p within Monte Carlo
error, Holm's correction with the printed p. An element of the page that nothing here expects is wrong.
"""

import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from html.parser import HTMLParser
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy

from tests.recompute.interaction import PERMUTATIONS, Interaction, join, tabulate_cells
from tests.recompute.tables import Row, Session, Tally

MEASURES = {
    "log_excess_steps_mean": "log of the excess steps over the shortest path (without the goal: at the limit)",
    "spl_mean": "SPL: success weighted by path length",
    "success": "success (share of episodes)",
    "reward_mean": "reward",
    "steps_at_limit_mean": "steps (without the goal: at the limit)",
    "reward_first": "reward of the first episode",
    "reward_slope": "learning: change of reward from one episode to the next, over at most the first five",
    "excess_steps_mean": "excess steps over the shortest path (successes only)",
    "playing_s_mean": "playing time per episode (s)",
    "response_median_ms": "reaction time, median (ms)",
    "path_efficiency_mean": "path efficiency (straight distance over ground covered)",
    "ineffective_share": "share of ineffective steps",
    "all_keys_discovered_s": "time until all keys were discovered (s)",
    "log_steps_ratio_mean": "log of steps / shortest path (without the goal: at the limit)",
    "reaction_median_ms": "key press after the latest picture, median (ms)",
}
UNASKED = {"log_steps_ratio_mean", "reaction_median_ms"}
FACTORS = {"log_excess_steps_mean": "excess steps + 1", "log_steps_ratio_mean": "steps"}
OF_GOALS = (
    "log_excess_steps_mean", "spl_mean", "success", "steps_at_limit_mean", "excess_steps_mean", "log_steps_ratio_mean",
)  # fmt: skip
LOGS = ("playing_s_mean", "response_median_ms", "all_keys_discovered_s", "reaction_median_ms")
RESAMPLES = 9_999
NOTHING = "\N{EN DASH}"
MINUS = "\N{MINUS SIGN}"
SPACES = re.compile(r"\s+")
NUMBER = re.compile(r"[+\N{MINUS SIGN}-]?\d[\d,]*(?:\.\d+)?")
PRACTICE_ALONE = "only practice was played"


@dataclass(frozen=True)
class Near:
    """A number that is right within some error, beside what rounding took."""

    value: float
    error: float

    def holds(self, text: str) -> bool:
        if text == "n/a" or math.isnan(self.value):
            return text == "n/a" and math.isnan(self.value)
        if text.startswith("<"):
            return self.value - self.error < float(text[1:])
        try:
            found = float(text.replace(MINUS, "-"))
        except ValueError:  # another cell: it is reported as wrong
            return False
        rounding = 0.5 * 10.0 ** -len(text.partition(".")[2])
        return abs(found - self.value) <= self.error + rounding * (1 + 1e-9)


Expected = str | tuple[str | Near, ...]  # a text; or one with numbers in it that are right within some error
Item = tuple[str, str, list[list[str]]]  # tag, text, and of a table its rows, the heads first


class PageReader(HTMLParser):
    """The elements of a page in order."""

    def __init__(self) -> None:
        super().__init__()
        self.items: list[Item] = []
        self._text: list[str] | None = None
        self._rows: list[list[str]] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self._rows = []
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("h1", "h2", "h3", "p", "td", "th", "figcaption", "summary"):
            self._text = []

    def handle_data(self, data: str) -> None:
        if self._text is not None:
            self._text.append(data)

    def handle_endtag(self, tag: str) -> None:
        text = SPACES.sub(" ", "".join(self._text or ())).strip()
        if tag == "table":
            self.items.append(("table", "", self._rows))
        elif tag in ("td", "th"):
            self._rows[-1].append(text)
        elif tag in ("h1", "h2", "h3", "p", "figcaption", "summary"):
            self.items.append((tag, text, []))
        else:
            return
        self._text = None


def read_page(path: Path) -> list[Item]:
    reader = PageReader()
    reader.feed(path.read_text(encoding="utf-8"))
    return reader.items


def number(value: float | None, digits: int = 3, *, sign: str = "-") -> str:
    """Three significant decimals, one fewer for each digit before the point.

    Where the last bit of a double decides the last digit, both: "{0.862|0.863}".
    """
    if value is None or math.isnan(value):
        return "n/a"
    slack = 1e-11 * max(abs(value), 1.0)
    found = {}
    for one in (value, value - slack, value + slack):
        before = len(f"{int(abs(one))}") if abs(one) >= 1 else 0
        found[f"{one:{sign}.{max(digits - before, 0)}f}".replace("-", MINUS)] = None
    return next(iter(found)) if len(found) == 1 else "{" + "|".join(found) + "}"


def mean_sd(values: Sequence[float]) -> str:
    if not len(values):
        return "n/a"
    mean = float(np.mean(values))
    return number(mean) if len(values) < 2 else f"{number(mean)} ({number(float(np.std(values, ddof=1)))})"


def interval(bounds: Sequence[float], digits: int = 3, *, sign: str = "-") -> str:
    return "n/a" if math.isnan(bounds[0]) else " to ".join(number(float(one), digits, sign=sign) for one in bounds)


def with_interval(value: float, bounds: Sequence[float], digits: int = 3, *, sign: str = "-") -> str:
    inside = "" if math.isnan(bounds[0]) else f" ({interval(bounds, digits, sign=sign)})"
    return number(value, digits, sign=sign) + inside


def p_value(value: float) -> str:
    if not math.isnan(value) and f"{value - 1e-9:.3f}" != f"{value + 1e-9:.3f}":
        return "{" + f"{value - 1e-9:.3f}|{value + 1e-9:.3f}" + "}"
    return "n/a" if math.isnan(value) else "< 0.001" if value < 0.001 else f"{value:.3f}"


def capital(text: str) -> str:
    return text[0].upper() + text[1:]


NONE = (math.nan, math.nan)


@dataclass(frozen=True)
class Compared:
    """Two groups on a measure, by SciPy."""

    measure: str
    groups: tuple[str, str]
    n: tuple[int, int]
    means: tuple[float, float]
    interval: tuple[Near, Near] | None
    p: Near
    smallest_p: float
    g: float
    g_interval: tuple[Near, Near] | None
    reason: str
    is_log: bool = False
    caution: str = ""

    @property
    def difference(self) -> float:
        return self.means[0] - self.means[1]


def near_interval(value: float, bounds: tuple[Near, Near] | None, *, sign: str = "-", is_log: bool = False) -> Expected:
    """A number and its interval in brackets; of logarithms the ratio."""
    if is_log:
        value = math.exp(value)
        bounds = bounds and (exponential(bounds[0]), exponential(bounds[1]))
    first = ("\N{MULTIPLICATION SIGN}" if is_log else "") + number(value, sign="-" if is_log else sign)
    return (first,) if bounds is None else (f"{first} (", bounds[0], " to ", bounds[1], ")")


def exponential(near: Near) -> Near:
    return Near(math.exp(near.value), math.exp(near.value) * near.error * 1.01)


def welch(a: Any, b: Any, axis: int = -1) -> Any:
    apart = np.abs(a.mean(axis=axis) - b.mean(axis=axis))
    error = np.sqrt(a.var(axis=axis, ddof=1) / a.shape[axis] + b.var(axis=axis, ddof=1) / b.shape[axis])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(apart < 1e-12, 0.0, np.minimum(apart / error, 1e9))


class Regrouped:
    """The permutation test of two groups for any shift, every regrouping written out."""

    def __init__(self, a: Any, b: Any) -> None:
        self.a, self.b = a, b
        n, total = len(a), len(a) + len(b)
        self.exact = scipy.special.comb(total, n, exact=True) <= RESAMPLES
        if self.exact:
            chosen = [[*one, *(at for at in range(total) if at not in one)] for one in combinations(range(total), n)]
            self.orders = np.array(chosen)
        else:
            self.orders = np.random.default_rng(1).random((RESAMPLES, total)).argsort(axis=1)

    def p(self, shift: float = 0.0) -> float:
        a, n, m = self.a - shift, len(self.a), len(self.b)
        values = np.concatenate([a, self.b])[self.orders]
        observed = float(welch(a, self.b))
        as_far = int((welch(values[:, :n], values[:, n:]) >= observed * (1 - 1e-9)).sum())
        p = (as_far + (not self.exact)) / (len(self.orders) + (not self.exact))
        if (
            max(np.ptp(a), np.ptp(self.b))
            and smallest_p(n, m) < 0.05
            and (min(n, m) < 4 or (n != m and min(n, m) < 10))
        ):
            by_t = scipy.stats.ttest_ind(a, self.b, equal_var=False)
            freedom = by_t.df if min(n, m) > 3 else min(n, m) - 1
            p = max(p, float(2 * scipy.stats.t.sf(abs(by_t.statistic), freedom)))
        return p

    def interval(self, level: float = 0.05) -> tuple[Near, Near] | None:
        if not max(np.ptp(self.a), np.ptp(self.b)) or smallest_p(len(self.a), len(self.b)) >= 0.05:
            return None
        if min(len(self.a), len(self.b)) < 4:
            return None
        error = math.sqrt(np.var(self.a, ddof=1) / len(self.a) + np.var(self.b, ddof=1) / len(self.b))
        return invert(self.p, float(np.mean(self.a) - np.mean(self.b)), error, exact=self.exact, level=level)


def invert(p: Any, estimate: float, error: float, *, exact: bool, level: float = 0.05) -> tuple[Near, Near]:
    """The interval that a test does not reject; drawn resamples leave p uncertain by five standard errors."""
    bounds = []
    for side in (-1, 1):
        near, middle, far = (search(p, estimate, side * error, alpha) for alpha in slack_around(level, exact=exact))
        bounds.append(Near(middle, max(abs(middle - near), abs(far - middle)) + 2e-5 * error))
    return bounds[0], bounds[1]


def search(p: Any, inside: float, step: float, alpha: float) -> float:
    outside = inside + step
    while p(outside) >= alpha:
        inside, step = outside, 2 * step
        outside = inside + step
    while abs(outside - inside) > 1e-6 * abs(step):
        middle = (inside + outside) / 2
        inside, outside = (inside, middle) if p(middle) < alpha else (middle, outside)
    return inside


class Flipped:
    """The paired permutation test for any shift, every flip of signs written out."""

    def __init__(self, values: Any) -> None:
        self.values, n = values, len(values)
        self.exact = n <= 13
        self.signs = np.random.default_rng(1).choice([1.0, -1.0], (RESAMPLES, n))
        if self.exact:
            self.signs = np.array(list(product((1.0, -1.0), repeat=n)))

    def p(self, shift: float = 0.0) -> float:
        moved = self.values - shift
        least = abs(moved.sum()) - 1e-9 * np.abs(moved).sum()
        as_far = int((np.abs(self.signs @ moved) >= least).sum())
        return float(as_far + (not self.exact)) / (len(self.signs) + (not self.exact))

    def interval(self) -> tuple[Near, Near] | None:
        n = len(self.values)
        if not np.ptp(self.values) or 2.0 ** (1 - n) >= 0.05:
            return None
        error = float(np.std(self.values, ddof=1)) / math.sqrt(n)
        return invert(self.p, float(np.mean(self.values)), error, exact=self.exact)


def permutation_p(a: Any, b: Any) -> Near:
    test = Regrouped(a, b)
    return near_p(test.p(), exact=test.exact)


def standardised(a: Any, b: Any, bounds: tuple[Near, Near]) -> tuple[float, tuple[Near, Near]]:
    """The difference over the average SD, and its interval at both ends of what the difference's may be."""

    def ends(low: float, high: float) -> tuple[float, float]:
        if apart < 0:
            low, high = ends_of(-high, -low)
            return -high, -low
        return ends_of(low, high)

    def ends_of(low: float, high: float) -> tuple[float, float]:
        size = abs(apart)
        below = low * scale
        if low > 0:
            below = size * scale - math.sqrt((size * scale) ** 2 - low * (2 * size - low) * least * (2 * scale - least))
        return below, size * scale + math.hypot((high - size) * scale, size * (most - scale))

    apart = float(np.mean(a) - np.mean(b))
    first, second = float(np.var(a, ddof=1)), float(np.var(b, ddof=1))
    freedom = (first + second) ** 2 / (first**2 / (len(a) - 1) + second**2 / (len(b) - 1))
    root = math.sqrt((first + second) / 2)
    scale = (1 - 3 / (4 * freedom - 1)) / root
    least, most = (scale * math.sqrt(float(scipy.stats.chi2.ppf(at, freedom)) / freedom) for at in (0.025, 0.975))
    middle = ends(bounds[0].value, bounds[1].value)
    wide = ends(bounds[0].value - bounds[0].error, bounds[1].value + bounds[1].error)
    return apart * scale, (
        Near(middle[0], abs(wide[0] - middle[0]) * 1.5 + 1e-9), Near(middle[1], abs(wide[1] - middle[1]) * 1.5 + 1e-9)
    )  # fmt: skip


def near_p(p: float, *, exact: bool = False) -> Near:
    """Two estimates from 9,999 resamples differ by less than five standard errors."""
    return Near(p, 1e-9 if exact else 5 * math.sqrt(2 * max(p * (1 - p), 1e-4) / (RESAMPLES + 1)))


def smallest_p(n: int, m: int) -> float:
    ways = scipy.special.comb(n + m, n, exact=True)
    return 1 / (RESAMPLES + 1) if ways > RESAMPLES else (2 if n == m else 1) / ways


def caution(groups: tuple[str, str], a: Any, b: Any) -> str:
    """What is said of groups that are skewed unequally, by SciPy's bias-corrected skewness."""
    if min(len(a), len(b)) < 4 or not max(np.ptp(a), np.ptp(b)):
        return ""
    cubes = [
        float(scipy.stats.skew(one, bias=False)) * np.std(one, ddof=1) ** 3 / len(one) ** 2 if np.ptp(one) else 0.0
        for one in (a, b)
    ]
    error = math.sqrt(np.var(a, ddof=1) / len(a) + np.var(b, ddof=1) / len(b))
    if abs(cubes[0] - cubes[1]) / error**3 <= 0.3:
        return ""
    name = groups[0] if abs(cubes[0]) >= abs(cubes[1]) else groups[1]
    return f"values of {name} are skewed, so that p and interval of a difference of means may be wrong"


def compare(measure: str, groups: tuple[str, str], a: Any, b: Any, *, is_log: bool = False) -> Compared:
    found = compare_plainly(measure, groups, a, b, is_log=is_log)
    return replace(found, caution=caution(groups, a, b))


def compare_plainly(measure: str, groups: tuple[str, str], a: Any, b: Any, *, is_log: bool) -> Compared:
    n = len(a), len(b)
    means = tuple(float(np.mean(one)) if len(one) else math.nan for one in (a, b))
    plain = (measure, groups, n, means)
    if min(n) < 2:
        few = groups[0] if n[0] <= n[1] else groups[1]
        reason = f"{min(n)} in {few}: two a group are the least"
        return Compared(*plain, None, Near(math.nan, 0), math.nan, math.nan, None, reason, is_log)
    test = Regrouped(a, b)
    p, least = near_p(test.p(), exact=test.exact), smallest_p(*n)
    spreads = (float(np.std(a, ddof=1)), float(np.std(b, ddof=1)))
    if max(spreads) == 0:
        reason = "nobody in either group differs from the others"
        return Compared(*plain, None, p, least, math.nan, None, reason, is_log)
    bounds = test.interval()
    if min(spreads) == 0:
        at = 0 if spreads[0] == 0 else 1
        value = math.exp(means[at]) if is_log else means[at]
        reason = f"everybody in {groups[at]} is at {value:g}: no standardised difference"
        return Compared(*plain, bounds, p, least, math.nan, None, reason, is_log)
    if min(n) < 4:
        few = groups[0] if n[0] <= n[1] else groups[1]
        return Compared(
            *plain, bounds, p, least, math.nan, None, f"{min(n)} in {few}: an interval needs 4 per group", is_log
        )
    if min(n) < 5:
        return Compared(*plain, bounds, p, least, math.nan, None, "", is_log)
    assert bounds is not None
    g, g_bounds = standardised(a, b, bounds)
    if abs(g) > 10:
        reason = "spreads are next to nothing: no standardised difference"
        return Compared(*plain, bounds, p, least, math.nan, None, reason, is_log)
    return Compared(*plain, bounds, p, least, g, g_bounds, "", is_log)


class Study:
    """What the logs, the enrolment log and the annotations of a study say, as a report shows it."""

    def __init__(self, folder: Path, sessions: Sequence[Session], tables: Mapping[str, list[Row]]) -> None:
        self.folder, self.sessions, self.tables = folder, sessions, tables
        self.protocol = sessions[0].protocol
        self.practice = {(session.who["group"], block) for session in sessions for block in session.practice()}
        self.participants = exclude_practice_alone(tables["participants"])
        self.all_blocks = [row for row in tables["blocks"] if (row["group"], row["block"]) not in self.practice]
        self.episodes = [row for row in tables["episodes"] if (row["group"], row["block"]) not in self.practice]
        without = blocks_without_discovery(sessions)
        nothing = {"keys_total": 0, "all_keys_discovered_s": None}
        self.all_blocks = [row | (nothing if row["block"] in without else {}) for row in self.all_blocks]
        groups: dict[str, set[str]] = defaultdict(set)
        for row in self.all_blocks:
            groups[row["group"]].add(row["block"])
        self.order = sorted(groups, key=lambda group: (-len(groups[group]), group))
        self.blocks = [row for row in self.all_blocks if row["exclusion_reason"] is None]
        self.known = known_keys(sessions)

    @property
    def analysis(self) -> Row:
        return dict(self.protocol.get("analysis", {}))

    def target(self) -> str:
        if self.analysis.get("block"):
            return str(self.analysis["block"])
        played: dict[str, dict[str, None]] = defaultdict(dict)
        for row in self.blocks:
            played[row["group"]][row["block"]] = None
        if not played:
            return ""
        common = [block for block in played[min(played)] if all(block in theirs for theirs in played.values())]
        return common[-1] if common else ""

    @cache  # noqa: B019  # a study lives as long as the comparison
    def interaction(self) -> Interaction | None:
        """The interaction of the primary measure, where the protocol crosses groups with conditions."""
        conditions = list(self.analysis.get("conditions", []))
        if len(self.order) < 2 or not conditions:
            return None
        primary = self.analysis["primary_measure"]
        return Interaction(tabulate_cells(self.blocks, primary, conditions), self.order, conditions, primary)

    def in_order_of_play(self) -> list[str]:
        places: dict[str, list[int]] = defaultdict(list)
        counts: Counter[tuple[str, int]] = Counter()
        for row in self.blocks:
            session = row["participant"], row["session"]
            places[row["block"]].append(counts[session])
            counts[session] += 1
        named = list(self.analysis.get("conditions", ()))
        orders: dict[tuple[str, int], list[str]] = defaultdict(list)
        for row in self.blocks:
            if row["block"] in named:
                orders[row["participant"], row["session"]].append(row["block"])
        means = {block: float(np.mean(these)) for block, these in places.items()}
        if len({tuple(order) for order in orders.values()}) > 1:  # conditions that some played in another order
            both = float(np.mean([place for block in named for place in places.get(block, ())]))
            means |= {block: both for block in named if block in places}
        places_named = {block: named.index(block) if block in named else len(named) for block in places}
        return sorted(places, key=lambda block: (round(means[block], 9), places_named[block]))


def exclude_practice_alone(rows: Sequence[Row]) -> list[Row]:
    """The participants' rows; who played nothing but practice, of all that counts, is excluded for that."""
    played: Counter[str] = Counter()
    for row in rows:
        if row["exclusion_reason"] is None:
            played[row["participant"]] += row["episodes"] or row["completed_share"] is None
    return [
        row | {"exclusion_reason": PRACTICE_ALONE}
        if row["exclusion_reason"] is None and not played[row["participant"]]
        else row
        for row in rows
    ]


def known_keys(sessions: Sequence[Session]) -> dict[str, list[str]]:
    """By block, the groups all of whom came to it, the first time, with keys of an earlier block."""
    first: dict[tuple[str, str], int] = {}
    found: dict[tuple[str, str], bool] = {}
    for session, block, known, _ in plays_of_keys(sessions):
        place = session.plan.participant.group, block
        if first.setdefault(place, session.plan.session) == session.plan.session:
            found[place] = found.get(place, True) and known
    by_block: dict[str, list[str]] = defaultdict(list)
    for (group, block), known in sorted(found.items()):
        if known:
            by_block[block].append(group)
    return by_block


def blocks_without_discovery(sessions: Sequence[Session]) -> set[str]:
    """The blocks whose keys were shown to all, or known to everybody or to a part of a group."""
    shown: dict[str, bool] = {}
    parts: dict[tuple[str, str, int, str], bool] = {}  # by block, group, session and the block before
    last: dict[str, str] = {}
    for session, block, was_known, was_shown in plays_of_keys(sessions):
        shown[block] = shown.get(block, True) and was_shown
        person = session.plan.participant
        part = block, person.group, session.plan.session, last.get(person.id, "")
        parts[part] = parts.get(part, True) and was_known
        last[person.id] = block
    groups: dict[str, dict[str, set[bool]]] = defaultdict(lambda: defaultdict(set))
    for (block, group, _, _), was_known in parts.items():
        groups[block][group].add(was_known)
    mixed = {block for block, knew in groups.items() if any(len(known) == 2 for known in knew.values())}
    kept = {block for block, knew in groups.items() if all(known == {True} for known in knew.values())}
    return {block for block in shown if shown[block]} | mixed | kept


def plays_of_keys(sessions: Sequence[Session]) -> Iterator[tuple[Session, str, bool, bool]]:
    """Of each session's blocks: whether its keys were those of an earlier block, and whether they were shown."""
    history: dict[str, list[dict[str, int]]] = defaultdict(list)
    for session in sorted(sessions, key=lambda one: one.plan.session):
        person = session.plan.participant
        begun: dict[str, Any] = {}
        for episode in session.plan.episodes:
            begun.setdefault(episode.block_name, episode)
        for block, episode in begun.items():
            actions = list(episode.actions)
            keys = {one.key: actions.index(one.action) for one in episode.key_map.keys if one.action in actions}
            policy = session.block(block).get("key_map", "new")
            known = policy not in ("new", "shown") and keys in history[person.id]
            history[person.id].append(keys)
            yield session, block, known, episode.show_keys


def expected_page(study: Study) -> Iterator[tuple[str, Any]]:
    """Every element of the page but captions and methods: tag and text, of a table its rows with their heads."""
    sessions, people = study.sessions, study.participants
    included = {row["participant"] for row in people if row["exclusion_reason"] is None}
    count = sum(row["exclusion_reason"] is None for row in study.episodes)
    players = sorted({row["player"] for row in people})
    asked = list(people)
    versions = Counter(row["version"] for row in asked)
    version = f"Protocol version {next(iter(versions))} in {len(asked)} sessions"
    windows = Counter(row["window"] for row in people)
    yield "h1", sessions[0].plan.study
    at = ", ".join(f"{window} in {many} sessions" for window, many in windows.most_common())
    yield (
        "p",
        (
            f"{version}; {len(sessions)} sessions read, 0 skipped; {len(included)} participants and {count} episodes "
            f"are included. Played by: {', '.join(players)}. Window: {at}."
        ),
    )
    practised = Counter(
        row["block"] for row in study.tables["episodes"]
        if (row["group"], row["block"]) in study.practice and row["exclusion_reason"] is None
    )  # fmt: skip
    if practised:
        told = ", ".join(f"block {block} ({many} episodes)" for block, many in practised.items())
        yield "p", f"Practice, excluded from everything below but the drawn paths and the quality of the data: {told}."
    others = [player for player in players if player != "human"]
    yield (
        "p",
        (
            f"Simulated data: all sessions were played by {', '.join(others)}. They show how the analysis behaves, and "
            "say nothing about people."
        ),
    )
    yield from expected_answer(study)
    yield from expected_flow(study)
    yield from expected_interaction(study)
    for block in study.in_order_of_play():
        yield from expected_block(study, block)
    yield from expected_answers(study)
    yield "h2", "Paths"
    several = len({session.who["group"] for session in sessions}) > 1
    yield "summary", "A participant of each group" if several else "A participant"
    yield from expected_quality(study)
    yield from expected_exclusions(study)
    yield "h2", "Methods"


FINAL = ("complete", "screened_out", "declined")


def expected_answer(study: Study) -> Iterator[tuple[str, Any]]:
    """What was asked, the answer, and who is excluded."""
    target = study.target()
    rows = [row for row in study.blocks if row["block"] == target]
    order = [group for group in study.order if any(row["group"] == group for row in rows)]
    interaction = study.interaction()
    if interaction is not None:
        yield from expected_interaction_answer(study, interaction)
    elif len(order) > 1:
        primary = study.analysis.get("primary_measure", "")
        names = f"{', '.join(order[:-1])} and {order[-1]}"
        measure = in_a_sentence(primary) if primary else "every measure"
        compared = Block(study, target)
        over_sessions = "Mean over the sessions. " if compared.rows["session"].nunique() > 1 else ""
        changes = ", over the sessions and in the change between them" if over_sessions else ""
        yield "p", f"Asked: differences in {measure} between groups {names} in block {target}{changes}."
        if over_sessions:
            yield from changes_between_sessions(compared, target)
        for one in compared.headline:
            said = difference(one, target)
            yield "p", (over_sessions, *([said] if isinstance(said, str) else said))
        if "equivalence_margin" in study.analysis:
            yield from equivalences(compared.people, order, primary, float(study.analysis["equivalence_margin"]))
        yield from at_limit(study, [one.measure for one in compared.headline[:1]], [target])
    else:
        yield "p", "One group: nothing is compared between groups."
    included = {row["participant"] for row in study.participants if row["exclusion_reason"] is None}
    reasons: dict[str, set[str]] = defaultdict(set)
    for row in study.participants:
        if row["exclusion_reason"] is not None and row["participant"] not in included:
            reasons[row["exclusion_reason"]].add(row["participant"])
    excluded = ", ".join(f"{len(codes)} ({reason})" for reason, codes in reasons.items()) or "none"
    calling = "tables for measures that they call"
    if interaction:
        calling = "the table of the interaction for measures that it calls"
    yield (
        "p",
        (
            f"Participants excluded: {excluded}. The p values of these sentences are not corrected for multiple "
            f"comparisons{', unless they say so' if interaction else ''}, and intervals (95 %) never are. In the "
            "tables, p (Holm) is corrected over the comparisons that the caption names. Every p value that no sentence "
            f"here states is exploratory, but those of {calling} primary or secondary, and comparisons of groups are "
            "not corrected across blocks. Methods define the measures."
        ),
    )
    if study.blocks:
        yield "p", "Every participant in every measure, to filter and sort."


def expected_interaction_answer(study: Study, found: Interaction) -> Iterator[tuple[str, Any]]:
    """The question in the protocol's words, and the answer for all of the interaction."""
    label = in_a_sentence(found.label)
    question = study.protocol.get("design", {}).get("question", "")
    yield (
        "p",
        (
            f"{question} Asked: whether differences in {label} between conditions {join(found.conditions)} depend on "
            f"the group ({join(found.order)})."
        ),
    )
    opening = f"{capital(label)}, interaction of group and condition: "
    if found.reason:
        yield "p", f"{opening}not tested ({found.reason})."
    else:
        sizes = ", ".join(f"{n} in {group}" for n, group in zip(found.n, found.order, strict=True))
        near = near_few(found.p)
        share, low, high = (Near(*estimate) for estimate in found.explained)
        verdict = "depend" if found.p < 0.05 else "are not shown to depend"
        if abs(near.value - 0.05) <= near.error:
            verdict = "{depend|are not shown to depend}"
        yield (
            "p",
            (
                f"{opening}differences between conditions {verdict} on the group (permutation p ",
                near,
                "; the group explains an estimated ",
                share,
                " of their variance, 90 % interval ",
                low,
                " to ",
                high,
                f"; {sizes}).",
            ),
        )
    missing = len(found.cells) - len(found.whole)
    if missing:
        yield "p", f"{missing} participants without a value in every condition are not in the interaction."
    yield from at_limit(study, [found.label], found.conditions)


def in_a_sentence(measure: str) -> str:
    """What sentences call a measure."""
    names = {
        "log_excess_steps_mean": "excess steps over the shortest path (log scale)",
        "log_steps_ratio_mean": "steps relative to the shortest path (log scale)",
        "spl_mean": "SPL (success weighted by path length)",
        "success": "success rate",
        "steps_at_limit_mean": "steps to the goal",
        "reward_slope": "change of reward over at most the first five episodes",
        "excess_steps_mean": "excess steps of successful episodes",
        "response_median_ms": "median reaction time (ms)",
    }
    return names.get(measure) or MEASURES[measure]


def near_few(p: float) -> Near:
    """Within five standard errors of a p from fewer permutations."""
    return Near(p, 5 * math.sqrt(1.2 * max(p * (1 - p), 1e-4) / PERMUTATIONS))


def expected_interaction(study: Study) -> Iterator[tuple[str, Any]]:
    """The sections on groups and conditions, and on conditions within participants in one order for all."""
    found = study.interaction()
    if found is None:
        return
    label = MEASURES[found.label]
    cells: list[list[Any]] = [["group", *found.conditions]]
    for group in found.order:
        rows = found.cells[found.cells["group"] == group]
        values = [rows[name].dropna().to_numpy(float) for name in found.conditions]
        cells.append(
            [group, *(f"{number(one.mean())} ({number(float(np.std(one, ddof=1)))}), n {len(one)}" for one in values)]
        )
    yield "h2", "Groups and conditions"
    yield "table", cells
    p: Any = "n/a" if found.reason else (near_few(found.p),)
    size: Expected = "n/a"
    if not found.reason:
        share, low, high = (Near(*estimate) for estimate in found.explained)
        size = (share, " (", low, " to ", high, ")")
    start = [label, "primary"]
    sizes = ", ".join(map(str, found.n))
    table: list[list[Any]] = [
        [
            "measure",
            "named before",
            "contrast",
            "groups",
            "n",
            "difference",
            "p",
            "p (Holm)",
            "g; W: \N{GREEK SMALL LETTER OMEGA}\N{SUPERSCRIPT TWO}",
        ],
        [*start, "all", "all", sizes, f"W({found.freedom}) = {number(found.statistic)}", p, Holm("W"), size],
    ]
    for name, one in found.contrasts(compare):
        g: Expected = number(one.g, 2)
        if one.g_interval is not None:
            g = (f"{number(one.g, 2)} (", one.g_interval[0], " to ", one.g_interval[1], ")")
        apart = near_interval(one.difference, one.interval)
        table.append([*start, name, pair(one.groups), sizes, apart, one.p, Holm("contrasts"), g])
    yield "summary", "Interaction of group and condition"
    yield "table", table
    heads = ["measure", "named before", "conditions", "n", "means", "difference", "p", "p (Holm)", "smallest p"]
    within: list[list[Any]] = [heads]
    for name, both in found.pairs():
        test = Flipped(both[:, 0] - both[:, 1])
        means = ", ".join(number(mean) for mean in both.mean(axis=0))
        apart = near_interval(float((both[:, 0] - both[:, 1]).mean()), test.interval())
        least = p_value(2.0 ** (1 - len(both)) if test.exact else 1 / (RESAMPLES + 1))
        p = (near_p(test.p(), exact=test.exact),)
        within.append([*start, name, str(len(both)), means, apart, p, Holm("within"), least])
    yield "h2", "Within participants"
    yield (
        "p",
        (
            f"Blocks {join(found.conditions)}. Each comparison is over the participants with a value in all conditions "
            "that it compares."
        ),
    )
    yield "table", within


def expected_flow(study: Study) -> Iterator[tuple[str, Any]]:
    lines = [json.loads(line) for line in (study.folder / "register.jsonl").read_text().splitlines()]
    lines = [line for line in lines if "format" not in line]
    taken: dict[str, str] = {}
    replaced: dict[str, None] = {}
    for line in lines:
        if "participant" in line:
            taken[line["participant"]] = line["group"]
        elif "drawn" in line:
            taken[line["drawn"]] = line["group"]
        elif "freed" in line:
            taken.pop(line["freed"], None)
        elif "replaced" in line:
            replaced[line["replaced"]] = None
    gone = {line["withdrawn"] for line in lines if "withdrawn" in line}
    left = Counter(
        {"declined": "did not agree", "screened_out": "screened out before a group was drawn"}.get(
            line.get("why", ""), "left before anything was recorded"
        )
        for line in lines
        if "freed" in line
    )
    counting = {row["participant"]: row["group"] for row in study.participants if row["exclusion_reason"] is None}
    groups = sorted({*filter(None, taken.values())})

    def row(what: str, codes: Any) -> list[str]:
        counts = Counter(taken[code] for code in codes)
        return [what, str(sum(counts.values())), *(str(counts[group]) for group in groups)]

    begun = begun_sessions(study, lines)
    table = [["participants", "all", *groups]]
    table.append(["came", str(sum("participant" in line for line in lines)), *(NOTHING for _ in groups)])
    for what in ("did not agree", "screened out before a group was drawn", "left before anything was recorded"):
        if left[what]:
            table.append([what, str(left[what]), *(NOTHING for _ in groups)])
    table.append(row("allocated to a group", taken))
    absent = [code for code in taken if not begun.get(code)]
    losses = [
        ("withdrew, no session on record", [code for code in absent if code in gone]),
        ("nothing recorded, slot reallocated", [code for code in absent if code in replaced.keys() - gone]),
        ("no data recorded so far", [code for code in absent if code not in {*gone, *replaced}]),
    ]
    finished: list[str] = []
    started = [code for code in taken if begun.get(code)]
    last = max(max(numbers) for numbers in begun.values())
    for session in range(1, last + 1):
        label = f"session {session}: " if last > 1 else ""
        came = [code for code in taken if session in begun.get(code, ())]
        if session > 1:
            away = [code for code in finished if code not in came]
            losses = [
                (f"{label}did not return, slot reallocated", [code for code in away if code in replaced]),
                (f"{label}not begun so far", [code for code in away if code not in replaced]),
            ]
        table += [row(what, codes) for what, codes in losses if codes]
        table.append(row(f"{label}began", came))
        ends = {one.who["participant"]: one for one in study.sessions if one.plan.session == session}
        out = [code for code, one in ends.items() if one.end_reason == "screened_out"]
        stopped = [code for code, one in ends.items() if not is_finished(one) and code not in out]
        withdrew = [code for code in came if code in gone and max(begun[code]) == session]
        missing = [code for code in came if code not in ends and code not in gone]
        for what, codes in (
            ("screened out", out),
            ("not finished, slot reallocated", [code for code in stopped if code in replaced]),
            ("not finished", [code for code in stopped if code not in replaced]),
            ("log missing or unreadable", missing),
            ("withdrew during or after it", withdrew),
        ):
            if codes:
                table.append(row(f"{label}{what}", codes))
        finished = [code for code in came if code not in {*out, *stopped, *withdrew, *missing}]
        table.append(row(f"{label}finished{' and did not withdraw' if withdrew else ''}", finished))
    if row("", finished) != row("", started):
        table.append(row("for the analysis: began a session", started))
    against: dict[str, str] = {}
    for one in study.participants:
        if one["participant"] not in counting:
            against.setdefault(one["participant"], one["exclusion_reason"])
    erased = [code for code in started if code in gone]
    if erased:
        table.append(row("withdrew, data erased or sealed", erased))
    for reason in sorted(set(against.values())):
        table.append(row(f"excluded: {reason}", [code for code, why in against.items() if why == reason]))
    table.append(row("included in this report", counting))
    yield "h2", "Participant flow"
    again = (
        " A participant who left before anything was recorded and came again is counted each time, since nothing "
        "recorded could identify them."
    )
    yield "p", f"Numbers of participants, from the enrolment log and the sessions.{again if left else ''}"
    yield "summary", "Flow by group"
    yield "table", table
    notes = [json.loads(line) for path in study.folder.rglob("*.marks.jsonl") for line in path.read_text().splitlines()]
    by_hand = [line for line in lines if line.keys() & {"withdrawn", "replaced", "recovered", "any_day"}]
    by_hand += [line for line in lines if line.get("overridden")]
    without = sum(not line.get("reason") for line in by_hand) + sum(not note.get("note") for note in notes)
    kinds = (("withdrawn", "withdrawn"), ("replaced", "replaced"), ("recovered", "logs recovered"))
    kinds += (("any_day", "run on another day"), ("overridden", "chosen by hand"))
    counts = [(sum(bool(line.get(kind)) for line in by_hand), what) for kind, what in kinds]
    counts += [(len(notes), "annotations"), (without, "without a reason")]
    told = ", ".join(f"{many} {what}" for many, what in counts if many)
    if told:
        yield "p", f"Audit trail: {told}."


def begun_sessions(study: Study, lines: Sequence[dict[str, Any]]) -> dict[str, set[int]]:
    """The sessions that each participant began: by their logs, and by the heads of logs that are gone."""
    begun: dict[str, set[int]] = defaultdict(set)
    for session in study.sessions:
        begun[session.who["participant"]].add(session.plan.session)
    for line in lines:
        if "sealed" in line:
            code, _, rest = line["sealed"].partition("_ses-")
            begun[code].add(int(rest[:2]))
    return begun


def is_finished(session: Session) -> bool:
    return session.end_reason in ("complete", "declined")


class Block:
    """A block's rows, and its groups compared."""

    def __init__(self, study: Study, block: str) -> None:
        self.rows = rows = pd.DataFrame([row for row in study.blocks if row["block"] == block])
        self.begun = [row for row in study.episodes if row["block"] == block]
        self.episodes = [row for row in self.begun if row["exclusion_reason"] is None]
        self.order = [group for group in study.order if (rows["group"] == group).any()]
        self.analysis = analysis = study.analysis if block == study.target() else {}
        self.primary, secondary = analysis.get("primary_measure", ""), list(analysis.get("secondary_measures", []))
        named = [self.primary, *secondary]
        whole = study.analysis
        of_study = [
            whole.get("primary_measure", ""),
            *whole.get("secondary_measures", []),
            *whole.get("covariates", []),
        ]
        if not any(row["success"] for row in self.episodes) and any(row["reward"] > 0 for row in self.episodes):
            self.rows = rows = rows.assign(**{name: np.nan for name in OF_GOALS if name not in of_study})
        late = sum(not row["success"] for row in self.episodes)
        never = int((rows["all_keys_discovered_s"].isna() & (rows["keys_total"] > 0)).sum())
        aside = {}
        if late and rows["excess_steps_mean"].notna().any():
            aside["excess_steps_mean"] = f"omits {late} episodes without success"
        if never and rows["all_keys_discovered_s"].notna().any():
            why = f"omits {never} who never discovered them all; compared below with these censored"
            aside["all_keys_discovered_s"] = why
        self.aside = {name: why for name, why in aside.items() if name not in named}
        self.measures = [
            name
            for name in MEASURES
            if rows[name].notna().any() and name not in self.aside and (name not in UNASKED or name in named)
        ]
        self.columns = rows[["group", "participant", "session", *MEASURES]].astype(dict.fromkeys(MEASURES, float))
        self.people = means_of(self.columns)
        self.logs = {name for name in LOGS if name in self.measures and not (rows[name].astype(float) <= 0).any()}
        self.scaled = self.columns.assign(**{name: np.log(self.columns[name]) for name in self.logs})
        self.roles = dict.fromkeys(self.measures, "exploratory")
        self.roles |= {name: "secondary" for name in secondary if name in self.roles}
        self.roles |= {self.primary: "primary"} if self.primary in self.roles else {}
        self.comparisons = compare_all(means_of(self.scaled), self.roles, self.order, self.logs)

    @property
    def headline(self) -> list[Compared]:
        first = next(iter(sorted(self.roles, key=list(MEASURES).index)), "")
        chosen = self.primary if self.primary in self.roles else first
        return [one for one in self.comparisons if one.measure == chosen]


def means_of(columns: pd.DataFrame) -> pd.DataFrame:
    return columns.drop(columns="session").groupby(["group", "participant"]).mean().reset_index()


def names_of_worlds(sessions: Sequence[Session], block: str) -> Iterator[str]:
    """The worlds of a block with their options, as each session's first episode had them."""
    for session in sessions:
        plan = next((episode for episode in session.plan.episodes if episode.block_name == block), None)
        if plan is not None:
            options = sorted(json.loads(plan.options_json or "{}").items())
            yield ", ".join([plan.world, *(f"{name} = {value!r}" for name, value in options)])


def expected_block(study: Study, block: str) -> Iterator[tuple[str, Any]]:
    found = Block(study, block)
    rows, begun, episodes, order = found.rows, found.begun, found.episodes, found.order
    primary, aside, measures, people = found.primary, found.aside, found.measures, found.people
    roles, comparisons, headline = found.roles, found.comparisons, found.headline
    alone = len(order) == 1 and len(study.order) > 1
    worlds = "; ".join(dict.fromkeys(name for name in names_of_worlds(study.sessions, block) if episodes))
    end = f"; played by {order[0]} alone, so nothing is compared" if alone else ""
    end = end or (
        "; the block that all groups are compared on"
        if block == study.target() and len(order) > 1 and study.interaction() is None
        else ""
    )
    yield "h2", f"Block {block}"
    yield "p", f"{worlds}{': ' if worlds else ''}{len(episodes)} episodes included{end}."
    uncorrected = ""
    if block != study.target() or len(order) < 2 or study.interaction() is not None:
        uncorrected = ", and the p above is not corrected" if headline else ""
        if len(headline) > 2 and len(study.in_order_of_play()) > 1:
            uncorrected = ", and the p in the sentences on its differences is not corrected"
            yield "summary", "Differences between groups"
        for one in headline:
            yield "p", difference(one, block)
    if comparisons and study.interaction() is not None:
        yield (
            "p",
            (
                "The interaction answers the study's question, and comparisons of groups in this block do not"
                f"{uncorrected.replace(', and', ';', 1)}."
            ),
        )
    elif comparisons and primary not in roles:
        yield (
            "p",
            (
                "The protocol names no primary measure for this block: all its comparisons are exploratory"
                f"{uncorrected}."
            ),
        )
    table = [["measure", "group", "n", "mean"]]
    for name in measures:
        for group in order:
            values = people.loc[people["group"] == group, name].dropna()
            table.append([MEASURES[name], group, str(len(values)), mean_sd(values)])
    yield "summary", "Measures and subjects"
    yield "table", table
    yield from expected_subjects(rows, people, order)
    if comparisons:
        yield "summary", "All comparisons of groups"
        yield "table", comparison_table(comparisons, roles)
    missing = [one for one in comparisons if one.reason]
    for why in sorted({f"{pair(one.groups)} ({one.reason})" for one in missing}):
        told = "; ".join(MEASURES[one.measure] for one in missing if f"{pair(one.groups)} ({one.reason})" == why)
        yield "p", f"Not compared, or only in part: {why} in {told}."
    doubtful = [one for one in comparisons if one.caution]
    for why in sorted({f"{pair(one.groups)} ({one.caution})" for one in doubtful}):
        told = "; ".join(MEASURES[one.measure] for one in doubtful if f"{pair(one.groups)} ({one.caution})" == why)
        yield "p", f"To be read with care: {why} in {told}."
    if comparisons and study.known.get(block) and rows["all_keys_discovered_s"].notna().any():
        yield (
            "p",
            (
                f"{', '.join(study.known[block])} kept the keys of an earlier block: their time until all keys were "
                "discovered is the time until they had used each."
            ),
        )
    if aside and comparisons:
        told = "; ".join(f"{MEASURES[name]} ({why})" for name, why in aside.items())
        yield "p", f"Not compared, because a group that fails more would look better: {told}."
    if rows["session"].nunique() > 1:
        yield from expected_sessions(found)
    missed = Counter(row["group"] for row in episodes if row["steps"] and not row["success"])
    played = Counter(row["group"] for row in episodes if row["steps"])
    if missed:
        several = sum(played[group] > 0 for group in order) > 1
        told = ", ".join(
            f"{f'{group} ' if several else ''}{missed[group]} of {played[group]}" for group in order if played[group]
        )
        yield (
            "p",
            (
                f"Episodes that did not reach the goal: {told}. A mean reward mixes how often the goal was reached "
                "with in how many steps."
            ),
        )
    yield from expected_survival(rows, begun, order)
    yield from expected_parts(episodes, order)
    yield from expected_growth(episodes, order)
    yield from expected_reliability(found)
    if headline:
        yield "summary", "Power of these sizes"
    for one in headline:
        yield "p", power(one.n)


def pair(groups: tuple[str, str], sign: str = MINUS) -> str:
    return f"{groups[0]} {sign} {groups[1]}"


def compare_all(
    people: pd.DataFrame, roles: Mapping[str, str], order: Sequence[str], logs: Collection[str]
) -> list[Compared]:
    found = []
    for role in ("primary", "secondary", "exploratory"):
        for name in (name for name in roles if roles[name] == role):
            values = {group: people.loc[people["group"] == group, name].dropna().to_numpy(float) for group in order}
            found += [
                compare(name, (a, b), values[a], values[b], is_log=name in logs) for a, b in combinations(order, 2)
            ]
    return found


def difference(one: Compared, block: str) -> Expected:
    per = "over" if one.is_log else "minus"
    said = f"{capital(in_a_sentence(one.measure))}, block {block}: {one.groups[0]} {per} {one.groups[1]} "
    if one.reason and math.isnan(one.p.value):
        return f"{said}was not compared ({one.reason})."
    if one.reason == "nobody in either group differs from the others" and one.difference == 0:
        return f"{said}is 0, and was not tested ({one.reason})."
    never = " Groups of these sizes cannot reach p < 0.05, whatever the difference." if one.smallest_p >= 0.05 else ""
    never += f" With care: {one.caution}." if one.caution else ""
    bounds: tuple[str | Near, ...] = ("too few for a 95 % interval",)
    factor: tuple[str | Near, ...] = ()
    value = number(math.exp(one.difference)) if one.is_log else number(one.difference, sign="+")
    if one.interval is not None:
        low, high = map(exponential, one.interval) if one.is_log else one.interval
        bounds = ("95 % interval ", low, " to ", high)
        if one.measure in FACTORS:
            low, high = map(exponential, one.interval)
            ratio = number(math.exp(one.difference))
            factor = (f"; as a ratio of {FACTORS[one.measure]}: {ratio}, ", low, " to ", high)
    g: tuple[str | Near, ...] = ()
    if one.g_interval is not None:
        g = (f"; standardised difference g {number(one.g, 2)}, interval ", one.g_interval[0], " to ", one.g_interval[1])
    of = "ratio of geometric means; " if one.is_log else ""
    return (
        f"{said}is {value} ({of}", *bounds, *factor, "; permutation p ", one.p, smallest(one), *g,
        f"; {one.n[0]} and {one.n[1]} participants).{never}{verdict(one)}",
    )  # fmt: skip


def smallest(one: Compared) -> str:
    """What is said of a p that no grouping of so few could make smaller."""
    is_smallest = one.smallest_p >= 0.001 and math.isclose(one.p.value, one.smallest_p)
    return ", the smallest possible with so few" if is_smallest else ""


def verdict(one: Compared, *, is_corrected: bool = True) -> str:
    """Which group is larger, or that none is shown to be; Holm's p is told from the tables alone."""
    if math.isnan(one.p.value):
        return ""
    nothing = " No difference is shown."
    larger, smaller = one.groups if one.difference > 0 else one.groups[::-1]
    shown = f" The value is larger in {larger} than in {smaller}"
    either = f"{shown}.|{shown}, but not after Holm's correction (as in the tables)." if is_corrected else f"{shown}."
    if abs(one.p.value - 0.05) <= one.p.error:
        return "{" + f"{nothing}|{either}" + "}"
    if one.p.value >= 0.05:
        return nothing
    return "{" + either + "}" if is_corrected else either


LIMITED = ("log_excess_steps_mean", "log_steps_ratio_mean", "steps_at_limit_mean", "spl_mean", "reward_mean")


def at_limit(study: Study, measures: Collection[str], blocks: Collection[str]) -> Iterator[tuple[str, Any]]:
    """What is said of cells of which some, or more than a third, of the episodes did not reach the goal."""
    cells, many = [], []
    for block in study.in_order_of_play():
        episodes = [row for row in Block(study, block).episodes if row["steps"]]
        if block not in blocks or not any(row["success"] for row in episodes):
            continue
        for group in study.order:
            missed = [not row["success"] for row in episodes if row["group"] == group]
            if any(missed):
                cells.append(f"{block}{f' of {group}' if len(study.order) > 1 else ''} {sum(missed)} of {len(missed)}")
            if sum(missed) > len(missed) / 3:
                many.append(cells[-1])
    if {*measures}.isdisjoint(LIMITED):
        return
    if cells and not many:
        yield (
            "p",
            (
                f"The measure counts an episode that did not reach the goal with its worst value ({', '.join(cells)}): "
                "differences between cells include these failures."
            ),
        )
    if many:
        yield (
            "p",
            (
                "Many values are at the limit: of the episodes of a cell, more than a third did not reach the goal "
                f"({', '.join(many)}). There the measure cannot tell how far from the goal they were, and differences "
                "from other cells may be larger than shown."
            ),
        )


def changes_between_sessions(found: Block, block: str) -> Iterator[tuple[str, Any]]:
    """How the groups' changes on the main measure from its first session differ, and how each group changed."""
    name = found.headline[0].measure
    of = {int(s): rows.set_index(["group", "participant"])[[name]] for s, rows in found.scaled.groupby("session")}
    first, *later = sorted(of)
    is_log = name in found.logs
    comparisons = []
    changes: list[tuple[str, str, Any]] = []
    for session in later:
        change = (of[session] - of[first]).reset_index()
        opening = f"{capital(in_a_sentence(name))}, block {block}, from session {first} to {session}"
        for group in found.order:
            values = change.loc[change["group"] == group, name].dropna().to_numpy(float)
            if len(values):
                changes.append((opening, group, values))
        for one in compare_all(change, {name: found.roles[name]}, found.order, found.logs):
            comparisons.append((opening, one))
    for opening, one in comparisons:
        sign = "/" if is_log else MINUS
        opening += f", difference of the changes, {one.groups[0]} {sign} {one.groups[1]}"
        if math.isnan(one.p.value):
            yield "p", f"{opening}: not compared ({one.reason})."
            continue
        yield (
            "p",
            (
                f"{opening}: ", *sized(one.difference, one.interval, is_log=is_log), "; permutation p ", one.p,
                f"; n {one.n[0]} and {one.n[1]}).{verdict(one, is_corrected=False)}",
            ),
        )  # fmt: skip
    for opening, group, values in changes:
        yield "p", (f"{opening}: {group} changes by ", *changed(values, is_log=is_log, is_alone=not comparisons))


def sized(value: float, bounds: tuple[Near, Near] | None, *, is_log: bool) -> tuple[str | Near, ...]:
    """A difference or a ratio, with the opening bracket and its interval."""
    size = f"\N{MULTIPLICATION SIGN}{number(math.exp(value))}" if is_log else number(value, sign="+")
    if bounds is None:
        return (f"{size} (too few for a 95 % interval",)
    low, high = map(exponential, bounds) if is_log else bounds
    return (f"{size} (95 % interval ", low, " to ", high)


def changed(values: Any, *, is_log: bool, is_alone: bool) -> Iterator[str | Near]:
    """A group's change, its interval, p and what is shown."""
    mean = float(np.mean(values))
    test = Flipped(values)
    yield from sized(mean, test.interval() if len(values) > 1 else None, is_log=is_log)
    if len(values) < 2 or not np.ptp(values):
        yield f"; paired permutation p n/a; n {len(values)})."
        return
    near = near_p(test.p(), exact=test.exact)
    shown = f" The value {'rises' if mean > 0 else 'falls'}."
    if abs(near.value - 0.05) <= near.error:
        shown = "{" + f"{shown}| No change is shown." + "}"
    elif near.value >= 0.05:
        shown = " No change is shown."
    yield "; paired permutation p "
    yield near
    yield f"; n {len(values)}).{shown if is_alone else ''}"


class Holm:
    """Stands for the corrected p of a row: it is told from the printed p of its family."""

    def __init__(self, family: str) -> None:
        self.family = family


def comparison_table(comparisons: Sequence[Compared], roles: Mapping[str, str]) -> list[list[Any]]:
    pairs = list(dict.fromkeys(one.groups for one in comparisons))
    several, named = len(pairs) > 1, set(roles.values()) != {"exploratory"}
    heads = ["measure", *(["named before"] if named else []), *(["groups"] if several else []), "n"]
    heads += ["means"] if several else [f"mean, {group}" for group in pairs[0]]
    table: list[list[Any]] = [[*heads, "difference", "p", "p (Holm)", "smallest p", "g"]]
    for one in comparisons:
        means = [number(math.exp(mean) if one.is_log else mean) for mean in one.means]
        g: Expected = number(one.g, 2) if one.g_interval is None else (
            f"{number(one.g, 2)} (", one.g_interval[0], " to ", one.g_interval[1], ")",
        )  # fmt: skip
        table.append(
            [
                MEASURES[one.measure], *([roles[one.measure]] if named else []),
                *([pair(one.groups, "/" if one.is_log else MINUS)] if several else []), f"{one.n[0]}, {one.n[1]}",
                *([", ".join(means)] if several else means),
                near_interval(one.difference, one.interval, is_log=one.is_log), one.p,
                Holm(roles[one.measure]), p_value(one.smallest_p), g,
            ]
        )  # fmt: skip
    return table


def expected_subjects(rows: pd.DataFrame, people: pd.DataFrame, order: Sequence[str]) -> Iterator[tuple[str, Any]]:
    several = rows["session"].nunique() > 1
    heads = ["group", "subject", *(["session"] if several else []), "n", "reward"]
    table, means = [], []
    for group in order:
        its = rows[rows["group"] == group].sort_values(["participant", "session"])
        for row in its.to_dict("records"):
            sd = row["reward_sd"]
            told = number(row["reward_mean"]) + ("" if sd is None or math.isnan(sd) else f" ({number(sd)})")
            session = [str(row["session"])] if several else []
            table.append([group, row["participant"], *session, str(row["episodes"]), told])
        values = people.loc[people["group"] == group, "reward_mean"].dropna()
        means.append([group, "all", *(["all"] if several else []), str(len(values)), mean_sd(values)])
    if len(table) > 60:
        yield "table", [heads, *means]
        yield "summary", f"{len(table)} rows: {', '.join(heads)}"
        yield "table", [heads, *table]
    else:
        yield "table", [heads, *table, *means]


def equivalences(people: pd.DataFrame, order: Sequence[str], primary: str, margin: float) -> Iterator[tuple[str, Any]]:
    for a, b in combinations(order, 2):
        first, second = (people.loc[people["group"] == group, primary].dropna().to_numpy(float) for group in (a, b))
        opening = f"{capital(in_a_sentence(primary))}: "
        test = Regrouped(first, second) if min(len(first), len(second)) > 1 else None
        bounds = test.interval(0.1) if test else None
        if test is None or bounds is None:
            why = "it needs 4 participants in each group and values that differ"
            yield "p", f"{opening}equivalence of {a} and {b} was not tested ({why})."
            continue
        apart = float(np.mean(first) - np.mean(second))
        halves = test.p(-margin) / 2, test.p(margin) / 2
        p = max(halves[0] if apart > -margin else 1 - halves[0], halves[1] if apart < margin else 1 - halves[1])
        alike = "are equivalent" if p < 0.05 else "are not shown to be equivalent"
        yield (
            "p",
            (
                (
                    f"{opening}{a} and {b} {alike} within {margin:g}, the protocol's margin (two one-sided permutation "
                    "tests, p "
                ),
                near_p(p, exact=test.exact), "; 90 % interval of the difference ", bounds[0], " to ", bounds[1], ").",
            ),
        )  # fmt: skip


def expected_sessions(found: Block) -> Iterator[tuple[str, Any]]:
    columns, measures, roles, order = found.columns, found.measures, found.roles, found.order
    sessions = sorted(columns["session"].unique())
    of = {session: columns[columns["session"] == session].set_index(["group", "participant"]) for session in sessions}
    scaled = {
        session: found.scaled[found.scaled["session"] == session].set_index(["group", "participant"])
        for session in sessions
    }
    later = sessions[1:]
    changes = {session: (scaled[session][measures] - scaled[sessions[0]][measures]).reset_index() for session in later}
    several = len(later) > 1
    heads = ["measure", "group", *(f"session {session}" for session in sessions)]
    for session in later:
        heads += [f"{head}, {sessions[0]} to {session}" if several else head for head in ("n", "change", "p")]
    table: list[list[Any]] = [heads]
    for name in measures:
        for group in order:
            cells = []
            for session in sessions:
                its = of[session].reset_index()
                values = its.loc[its["group"] == group, name].dropna()
                cells.append(mean_sd(values) if len(values) else NOTHING)
            for session in later:
                values = changes[session].loc[changes[session]["group"] == group, name].dropna().to_numpy(float)
                if not len(values):
                    cells += ["0", NOTHING, NOTHING]
                    continue
                test = Flipped(values)
                bounds = test.interval() if len(values) > 1 else None
                p: Any = near_p(test.p(), exact=test.exact) if len(values) > 1 and np.ptp(values) else "n/a"
                change = near_interval(float(np.mean(values)), bounds, sign="+", is_log=name in found.logs)
                cells += [str(len(values)), change, p]
            table.append([MEASURES[name], group, *cells])
    yield "summary", "Sessions"
    yield "table", table
    told = {session: change for session, change in changes.items() if change[measures].notna().any(axis=None)}
    rows: list[list[Any]] = []
    for session, change in told.items():
        for one in compare_all(change, roles, order, found.logs):
            label = MEASURES[one.measure] + (f", session {sessions[0]} to {session}" if len(told) > 1 else "")
            groups = pair(one.groups, "/" if one.is_log else MINUS)
            rows.append(
                [
                    label, groups, f"{one.n[0]}, {one.n[1]}",
                    near_interval(one.difference, one.interval, sign="+", is_log=one.is_log), one.p,
                    Holm(f"{session} {roles[one.measure]}"),
                ]
            )  # fmt: skip
    if rows:
        yield "table", [["measure", "groups", "n", "difference of changes", "p", "p (Holm)"], *rows]


def restricted_mean(times: Any, observed: Any, until: float) -> float:
    curve = scipy.stats.ecdf(scipy.stats.CensoredData.right_censored(times, ~observed)).sf
    inside = curve.quantiles < until
    edges = np.concatenate([[0.0], curve.quantiles[inside], [until]])
    heights = np.concatenate([[1.0], curve.probabilities[inside]])
    return float(np.sum(np.diff(edges) * heights))


def curve_error(times: Any, seen: Any, until: float) -> tuple[float, float]:
    """A restricted mean and its squared error: Greenwood's, by n / (n - 1)."""
    events = np.unique(times[seen & (times <= until)])
    came = np.array([(seen & (times == event)).sum() for event in events], float)
    watched = np.array([(times >= event).sum() for event in events], float)
    heights = np.concatenate([[1.0], np.cumprod(1 - came / watched)])
    pieces = np.diff(np.concatenate([[0.0], events, [until]])) * heights
    left = pieces[::-1].cumsum()[::-1][1:]  # the area behind each event
    lost = np.where(watched > came, came / (watched * np.maximum(watched - came, 1)), 0.0)
    return float(pieces.sum()), float((left**2 * lost).sum()) * len(times) / (len(times) - 1)


def known_until(groups: Sequence[tuple[Any, Any]]) -> float:
    """Up to where both curves are known: to the last time of all where a curve came to 0."""
    lasts = [float(times.max()) for times, _ in groups]
    known = [math.inf if seen[times == last].all() else last for (times, seen), last in zip(groups, lasts, strict=True)]
    return min(*known, max(lasts))


def studentised(groups: Sequence[tuple[Any, Any]]) -> tuple[float, float, tuple[float, float]] | None:
    """How far apart two restricted means are, in standard errors; None below five events in a group."""
    until = known_until(groups)
    if min(int((seen & (times <= until)).sum()) for times, seen in groups) < 5:
        return None
    (first, one), (second, other) = (curve_error(*group, until) for group in groups)
    apart = 0.0 if abs(first - second) <= 1e-9 * until else abs(first - second)
    error = math.sqrt(one + other)
    return (apart / error if error else math.inf if apart else 0.0), error, (one, other)


def regrouped_curves(groups: Sequence[tuple[Any, Any]], apart: float, until: float) -> tuple[Any, Any]:
    """The interval of the difference and its p: curves, horizon and errors of every regrouping, written out."""
    n, m = (len(times) for times, _ in groups)
    found = studentised(groups)
    if found is None or not found[1] > 0:
        return None, "n/a"
    observed, error, parts = found
    times, seen = (np.concatenate(part) for part in zip(*groups, strict=True))
    orders = Regrouped(times[:n], times[n:])
    told = [studentised([(times[o[:n]], seen[o[:n]]), (times[o[n:]], seen[o[n:]])]) for o in orders.orders]
    others = np.array(sorted((one[0] for one in told if one is not None), reverse=True))
    extra = int(not orders.exact)
    ranks = [math.ceil(alpha * (len(others) + extra)) - extra for alpha in slack_around(0.05, exact=orders.exact)]
    if ranks[1] < 1 or not math.isfinite(others[ranks[1] - 1]):
        return None, "n/a"
    p = (int((others >= observed * (1 - 1e-9)).sum()) + extra) / (len(others) + extra)
    most = [others[max(rank, 1) - 1] for rank in ranks]
    if min(n, m) < 4 or (n != m and min(n, m) < 10):
        freedom = sum(parts) ** 2 / (parts[0] ** 2 / (n - 1) + parts[1] ** 2 / (m - 1))
        freedom = freedom if min(n, m) > 3 else min(n, m) - 1
        p = max(p, float(2 * scipy.stats.t.sf(observed, freedom)))
        most = [max(one, float(scipy.stats.t.isf(0.025, freedom))) for one in most]
    wide, middle, narrow = (one * error for one in sorted(most, reverse=True))
    spread = max(wide - middle, middle - narrow) + 1e-6 * error
    return (Near(apart - middle, spread), Near(apart + middle, spread)), near_p(p, exact=orders.exact)


def whole_curves_p(groups: Sequence[tuple[Any, Any]]) -> Expected:
    """The log-rank test of every regrouping, event time by event time."""
    n, m = (len(times) for times, _ in groups)
    times, seen = (np.concatenate(part) for part in zip(*groups, strict=True))
    if (1 + (n == m)) / scipy.special.comb(n + m, n) >= 0.05:
        return "n/a"
    orders = Regrouped(times[:n], times[n:])
    members = np.zeros((len(orders.orders) + 1, n + m))
    for row, order in zip(members, [range(n + m), *orders.orders], strict=True):
        row[list(order[:n])] = 1
    excess = np.zeros(len(members))
    variance = np.zeros(len(members))
    for time in np.unique(times[seen]):
        waiting, came = times >= time, (times == time) & seen
        every, events = waiting.sum(), came.sum()
        share = members @ waiting / every
        excess += members @ came - events * share
        if every > 1:
            variance += events * share * (1 - share) * (every - events) / (every - 1)
    if not variance[0] > 1e-9:
        return "n/a"
    apart = np.abs(excess) / np.sqrt(np.where(variance > 1e-9, variance, math.inf))
    extra = int(not orders.exact)
    as_far = int((apart[1:] >= apart[0] * (1 - 1e-9)).sum())
    return near_p((as_far + extra) / (len(apart) - 1 + extra), exact=orders.exact)


def slack_around(alpha: float, *, exact: bool) -> tuple[float, float, float]:
    """A level, and five standard errors of what drawn resamples make of it to both sides."""
    slack = 0.0 if exact else 5 * math.sqrt(2 * alpha * (1 - alpha) / RESAMPLES)
    return alpha + slack, alpha, alpha - slack


def expected_survival(rows: pd.DataFrame, begun: Sequence[Row], order: Sequence[str]) -> Iterator[tuple[str, Any]]:
    watched: Counter[tuple[str, int]] = Counter()
    for row in begun:
        watched[row["participant"], row["session"]] += row["playing_s"]
    waited = {}
    for group in order:
        its = rows[(rows["group"] == group) & (rows["keys_total"] > 0)].sort_values("session")
        its = its.drop_duplicates("participant")
        if len(its):
            found = its["all_keys_discovered_s"].to_numpy(float)
            whole = np.array([watched[row["participant"], row["session"]] for row in its.to_dict("records")], float)
            waited[group] = np.where(np.isnan(found), whole, found), ~np.isnan(found)
    if not any(events.any() for _, events in waited.values()):
        waited = {}
    table = [["groups", "n", "never", "observed (s)", "restricted means (s)", "difference (95 %)", "p", "curves: p"]]
    for a, b in combinations(waited, 2):
        groups = waited[a], waited[b]
        n = [len(times) for times, _ in groups]
        if min(n) < 2:
            continue
        until = known_until(groups)
        means = [restricted_mean(*one, until) for one in groups]
        bounds, of_means = regrouped_curves(groups, means[0] - means[1], until)
        never = [int((~seen).sum()) for _, seen in groups]
        table.append(
            [
                pair((a, b)), f"{n[0]}, {n[1]}", f"{never[0]}, {never[1]}", number(until),
                f"{number(means[0])}, {number(means[1])}", near_interval(means[0] - means[1], bounds, sign="+"),
                of_means, whole_curves_p(groups),
            ]
        )  # fmt: skip
    if len(table) > 1:
        yield "summary", "Time until all keys were discovered"
        yield "table", table


def gee(people: Sequence[Any], *, odds: bool) -> tuple[float, float]:
    """A group's marginal mean, or its log odds, and its bias-reduced error, by statsmodels.

    A correlation below what so many episodes can have is held at the least that ours may come to.
    """
    values = np.concatenate(people)
    if not np.ptp(values):  # statsmodels has no answer
        return float(values[0]), 0.0
    least = -0.9 / max(map(len, people))
    found, structure = fit_gee(people, odds=odds)
    if not least <= structure.dep_params <= 0.99:
        found, _ = fit_gee(people, odds=odds, held=min(max(float(structure.dep_params), least), 0.99))
    return float(found.params[0]), float(found.bse[0])


def fit_gee(people: Sequence[Any], *, odds: bool, held: float | None = None) -> tuple[Any, Any]:
    import statsmodels.api as sm

    who = np.repeat(np.arange(len(people)), [len(one) for one in people])
    values, structure = np.concatenate(people), sm.cov_struct.Exchangeable()
    if held is not None:
        structure.dep_params = held
    family = sm.families.Binomial() if odds else sm.families.Gaussian()
    model = sm.GEE(
        values, np.ones((len(values), 1)), who, family=family, cov_struct=structure, update_dep=held is None
    )  # fmt: skip
    return model.fit(cov_type="bias_reduced", maxiter=300), structure


def compare_marginals(a: Sequence[Any], b: Sequence[Any], *, odds: bool) -> tuple[Expected, Expected, str]:
    (first, error_a), (second, error_b) = gee(a, odds=odds), gee(b, odds=odds)
    parts = error_a**2, error_b**2
    if not sum(parts) > 1e-20:
        return "n/a", "n/a", "nobody differs from the others of the group"
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (len(a) - 1) + parts[1] ** 2 / (len(b) - 1))
    half = scipy.stats.t.ppf(0.975, freedom) * math.sqrt(sum(parts))
    ends = (first - second, first - second - half, first - second + half)
    told = [math.exp(min(end, 700.0)) for end in ends] if odds else list(ends)
    cells = [Near(value, 1e-4 + 5e-3 * abs(value)) for value in told]
    p = float(2 * scipy.stats.t.sf(abs(first - second) / math.sqrt(sum(parts)), freedom))
    return (cells[0], " (", cells[1], " to ", cells[2], ")"), (Near(p, 3e-3),), ""


def expected_parts(episodes: Sequence[Row], order: Sequence[str]) -> Iterator[tuple[str, Any]]:
    rewards = [row["reward"] for row in episodes]
    if not (any(reward == 0 for reward in rewards) and any(reward > 0 for reward in rewards) and min(rewards) >= 0):
        return
    told: dict[str, list[Any]] = {}
    for group in order:
        theirs: dict[str, list[float]] = defaultdict(list)
        for row in episodes:
            if row["group"] == group:
                theirs[row["participant"]].append(row["reward"])
        told[group] = [np.array(theirs[code]) for code in sorted(theirs)]
    table: list[list[Any]] = [["groups", "n", "earned", "odds ratio", "p", "difference where earned", "p", "p of both"]]
    missing = []
    for a, b in combinations(order, 2):
        n = len(told[a]), len(told[b])
        above = {group: [one[one > 0] for one in told[group] if (one > 0).any()] for group in (a, b)}
        shares = {
            group: float((np.concatenate(told[group]) > 0).mean()) if told[group] else math.nan for group in (a, b)
        }
        few = next((f"fewer than 4 participants in {group}" for group in (a, b) if len(told[group]) < 4), "")
        stuck = next((f"no episode of {group} is at 0" for group in (a, b) if shares[group] == 1), "")
        stuck = stuck or next((f"every episode of {group} is at 0" for group in (a, b) if shares[group] == 0), "")
        thin = next(
            (
                f"fewer than 4 participants of {group} have an episode above 0"
                for group in (a, b)
                if len(above[group]) < 4
            ),
            "",
        )
        cells: list[Any] = []
        for what, why, people, odds in (
            ("odds", few or stuck, {g: [(one > 0).astype(float) for one in told[g]] for g in (a, b)}, True),
            ("difference", few or thin, above, False),
        ):
            found: tuple[Any, Any, str] = ("n/a", "n/a", why)
            if not why:
                found = compare_marginals(people[a], people[b], odds=odds)
            if found[2]:
                missing.append(f"{what}, {pair((a, b))}: {found[2]}")
            cells += found[:2]
        both: Any = "n/a" if few else two_parts_p(told[a], told[b])
        earned = f"{shares[a]:.1%}, {shares[b]:.1%}"
        table.append([pair((a, b)), f"{n[0]}, {n[1]}", earned, *cells, both])
    if len(table) == 1:
        return
    yield "summary", "Reward in two parts"
    yield "table", table
    if missing:
        yield "p", f"Not estimated: {'; '.join(missing)}."


def two_parts_p(a: Sequence[Any], b: Sequence[Any]) -> Near:
    summary = [
        np.array([((one > 0).mean(), one[one > 0].mean() if (one > 0).any() else math.nan) for one in group])
        for group in (a, b)
    ]

    def squared(first: Any, second: Any) -> Any:
        """Welch's t squared of both parts, added up; over the axis of people."""
        total = 0.0
        for part in (0, 1):
            moments = []
            for values in (first[..., part], second[..., part]):
                n = (~np.isnan(values)).sum(axis=-1)
                with np.errstate(all="ignore"):
                    mean = np.nansum(values, axis=-1) / n
                    error = np.nansum((values - mean[..., None]) ** 2, axis=-1) / (n - 1) / n
                moments.append((np.where(n > 1, mean, np.nan), np.where(n > 1, error, np.nan)))
            apart, error = moments[0][0] - moments[1][0], moments[0][1] + moments[1][1]
            found = np.where(np.abs(apart) < 1e-12, 0.0, apart**2 / np.maximum(error, 1e-12))
            total = total + np.where(np.isnan(found), 0.0, found)
        return total

    whole, n = np.concatenate(summary), len(a)
    ways = scipy.special.comb(len(whole), n, exact=True)
    observed = squared(summary[0][None], summary[1][None])[0]
    if ways <= RESAMPLES:
        chosen = [[*one, *sorted({*range(len(whole))} - {*one})] for one in combinations(range(len(whole)), n)]
        places = whole[np.array(chosen)]
        p = float((squared(places[:, :n], places[:, n:]) >= observed - 1e-9).mean())
        limit = two_t_p(summary, float(observed))
        return near_p(p, exact=True) if p >= limit else near_p(limit)
    rng = np.random.default_rng(3)
    places = whole[rng.permuted(np.tile(np.arange(len(whole)), (RESAMPLES, 1)), axis=1)]
    p = (1 + int((squared(places[:, :n], places[:, n:]) >= observed - 1e-9).sum())) / (RESAMPLES + 1)
    return near_p(max(p, two_t_p(summary, float(observed))))


def two_t_p(summary: Sequence[Any], observed: float) -> float:
    """How often two independent squared t add up to so much: by integration; 0 of groups that have no lower limit."""
    n, m = map(len, summary)
    if not (min(n, m) < 4 or (n != m and min(n, m) < 10)):
        return 0.0
    tails = []
    for part in (0, 1):
        groups = [values[~np.isnan(values[:, part]), part] for values in summary]
        errors = [values.var(ddof=1) / len(values) if len(values) > 1 else math.nan for values in groups]
        if not sum(errors) > 0:
            continue
        freedom = sum(errors) ** 2 / sum(e**2 / (len(v) - 1) for e, v in zip(errors, groups, strict=True))
        tails.append(scipy.stats.f(1, freedom))
    if len(tails) < 2:
        return float(tails[0].sf(observed)) if tails else 1.0
    inner, _ = scipy.integrate.quad(
        lambda z: tails[0].sf(observed - z * z) * tails[1].pdf(z * z) * 2 * z, 0, math.sqrt(observed), limit=200
    )
    return float(inner + tails[1].sf(observed))


def expected_growth(episodes: Sequence[Row], order: Sequence[str]) -> Iterator[tuple[str, Any]]:
    excess = any(row["log_excess_steps"] is not None for row in episodes)
    column, measure = (
        ("log_excess_steps", "log of the excess steps over the shortest path") if excess else ("reward",) * 2
    )
    told = [row for row in episodes if row[column] is not None]
    middle = float(np.mean([row["episode_in_block"] for row in told])) if told else math.nan
    points: dict[str, dict[str, list[tuple[float, float]]]] = defaultdict(lambda: defaultdict(list))
    for row in told:
        points[row["group"]][row["participant"]].append((row["episode_in_block"] - middle, row[column]))
    lines: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for group, people in points.items():
        for code in sorted(people):
            x, y = zip(*people[code], strict=True)
            if len(set(x)) >= 3:
                found = scipy.stats.linregress(x, y)
                lines[group].append((float(found.intercept), float(found.slope)))
    groups = [group for group in order if len(lines[group]) >= 2]
    if not groups:
        yield (
            "p",
            "Change over the episodes: not estimated; it needs two participants of a group with 3 or more.",
        )
        return
    *others, reference = groups
    table: list[list[Any]] = [["term", "participants", "estimate", "95 % interval", "p"]]
    for at, name in enumerate((f"{measure} in the middle of the block", "change an episode")):
        base = np.array(lines[reference])[:, at]
        cells = tested_cells(float(base.mean()), Flipped(base) if np.ptp(base) else None)
        if not at:
            cells[-1] = "n/a"
        table.append([f"{reference}: {name}", str(len(base)), *cells])
        for group in others:
            values = np.array(lines[group])[:, at]
            test = Regrouped(values, base) if max(np.ptp(values), np.ptp(base)) else None
            cells = tested_cells(float(values.mean() - base.mean()), test)
            table.append([f"{group} minus {reference}: {name}", str(len(values) + len(base)), *cells])
    yield "summary", "Change over the episodes"
    yield "table", table
    rows = pd.DataFrame([row for row in told if row["group"] in groups])
    if rows["participant"].nunique() - len(groups) >= 2:
        terms = [line[0] for line in table[1:]]
        kind, mixed = mixed_model(rows.astype({column: float}).rename(columns={column: "value"}), terms, groups)
        is_table = kind == "table"  # the page has its estimates alone
        yield kind, [["term", "estimate"], *([line[0], line[2]] for line in mixed[1:])] if is_table else mixed


def mixed_model(rows: pd.DataFrame, terms: Sequence[str], groups: Sequence[str]) -> tuple[str, Any]:
    """The table of a linear mixed model by REML, or the line that there is none.

    From whole covariance matrices of people's episodes, a level and a change for each group, and a simplex search.
    """
    codes = sorted(rows["participant"].unique(), reverse=True)
    longest = int(rows.groupby("participant").size().max())
    at = rows["episode_in_block"].to_numpy(float) - rows["episode_in_block"].mean()
    unit = float(np.sqrt(np.mean(at**2)))
    fixed, random, value = (np.zeros((len(codes), longest, width)) for width in (2 * len(groups), 2, 1))
    for number, code in enumerate(codes):  # what is missing of a person stays 0, and counts for nothing
        its = (rows["participant"] == code).to_numpy()
        many, group = int(its.sum()), groups.index(str(rows["group"][its].iloc[0]))
        fixed[number, :many, [group, len(groups) + group]] = np.array([np.ones(many), at[its]])
        random[number, :many] = np.column_stack([np.ones(many), at[its] / unit])
        value[number, :many, 0] = rows["value"][its]
    why = "its likelihood has no maximum with variance both between and within participants"
    none = "p", f"A linear mixed model of the same is not reported: {why}."
    flat = np.hstack([fixed.reshape(-1, 2 * len(groups)), value.reshape(-1, 1)])
    if np.linalg.matrix_rank(flat) < flat.shape[1]:
        return none
    freedom = len(rows) - 2 * len(groups)

    def restricted(covariance: Any) -> tuple[float, Any, Any]:
        whole = np.eye(longest) + random @ covariance @ random.transpose(0, 2, 1)
        weighted = np.linalg.solve(whole, np.concatenate([fixed, value], axis=2))
        information = np.einsum("pei,pej->ij", fixed, weighted[:, :, :-1])
        levels = np.linalg.solve(information, np.einsum("pei,pe->i", fixed, weighted[:, :, -1]))
        left = value[:, :, 0] - fixed @ levels
        variance = float(np.einsum("pe,pe->", left, np.linalg.solve(whole, left[:, :, None])[:, :, 0])) / freedom
        logs = np.linalg.slogdet(whole)[1].sum() + np.linalg.slogdet(information)[1]
        likelihood = -(freedom * math.log(max(variance, 1e-300)) + logs) / 2
        return float(likelihood), levels, variance * np.linalg.inv(information)

    def best(form: Callable[[Any], Any], *starts: Sequence[float]) -> tuple[float, Any, Any, float]:
        options = {"xatol": 1e-7, "fatol": 1e-11, "maxfev": 4000}
        found = [
            scipy.optimize.minimize(lambda x: -restricted(form(x))[0], start, method="Nelder-Mead", options=options)
            for start in starts
        ]
        covariance = form(min(found, key=lambda one: one.fun).x)
        return *restricted(covariance), math.sqrt(float(np.linalg.eigvalsh(covariance).max()))

    def outer(x: Any) -> Any:
        return np.outer(x, x)

    nothing = restricted(np.zeros((2, 2)))[0]
    level = best(lambda x: np.diag([x[0] ** 2, 0.0]), (0.4,), (2.0,))
    singular = best(outer, (0.7, 0.3), (0.7, -0.3))
    full = best(lambda x: outer([x[0], x[1]]) + outer([0.0, x[2]]), (0.7, 0.3, 0.4), (0.7, -0.3, 0.4), (0.2, 0.0, 1.0))
    for (likelihood, estimates, spread, ratio), less in ((full, singular[0]), (level, nothing)):
        if likelihood <= less + 1e-3 or ratio > 500:
            continue
        *others, last = range(len(groups))
        people = len(codes)
        table: list[list[Any]] = [["term", "participants", "estimate", "95 % interval", "p"]]
        contrasts = []
        for part in (0, len(groups)):
            base = np.eye(2 * len(groups))[part + last]
            contrasts += [base, *(np.eye(2 * len(groups))[part + group] - base for group in others)]
        for number, (term, contrast) in enumerate(zip(terms, contrasts, strict=True)):
            estimate, error = float(contrast @ estimates), math.sqrt(float(contrast @ spread @ contrast))
            half = float(scipy.stats.t.ppf(0.975, people - len(groups))) * error
            p = float(2 * scipy.stats.t.sf(abs(estimate / error), people - len(groups)))
            low, high, same = estimate - half, estimate + half, 1e-3 * error  # searches stop a little apart
            bounds = (Near(low, same), " to ", Near(high, same))
            table.append(
                [term, str(people), (Near(estimate, same),), bounds, (Near(p, 1e-3),) if number else p_value(math.nan)]
            )
        return "table", table
    return none


def tested_cells(value: float, test: Regrouped | Flipped | None) -> list[Any]:
    """An estimate of lines, its interval and p: two solvers agree to the printed digit but where it turns on a bit."""
    estimate = (Near(value, 1e-9 * max(1.0, abs(value))),)
    if test is None:
        return [estimate, "n/a", "n/a"]
    bounds = test.interval()
    interval: Expected = "n/a" if bounds is None else (bounds[0], " to ", bounds[1])
    return [estimate, interval, (near_p(test.p(), exact=test.exact),)]


def expected_reliability(found: Block) -> Iterator[tuple[str, Any]]:
    table = [["measure", "participants", "episodes", "one episode: ICC", "all: split-half"]]
    notes: dict[str, list[str]] = {}
    for name in found.measures:
        column = name.removesuffix("_mean")
        if not found.episodes or column not in found.episodes[0]:
            continue
        people: dict[tuple[str, str], list[float]] = {}
        for row in sorted(found.episodes, key=lambda row: (row["session"], row["episode"], row["attempt"])):
            value = row[column]
            if value is not None and not math.isnan(value) and (name not in LOGS or value > 0):
                people.setdefault((row["group"], row["participant"]), []).append(
                    math.log(value) if name in LOGS else float(value)
                )
        cells, note = reliability({who: np.array(values) for who, values in people.items() if len(values) > 1})
        if cells:
            table.append([MEASURES[name], *cells])
        if note:
            notes.setdefault(note, []).append(MEASURES[name])
    if len(table) > 1:
        yield "summary", "Reliability"
        yield "table", table
    if notes:
        told = [f"{', '.join(names)}: {note}" for note, names in notes.items()]
        yield "p", f"With care: {'; '.join(told)}."


def mean_squares(people: Mapping[tuple[str, str], Any]) -> tuple[float, float, float, dict[str, float]]:
    """Between and within participants who are nested in groups; episodes of each; sums of squares by group."""
    groups = sorted({group for group, _ in people})
    every = np.concatenate(list(people.values()))
    by_group = {group: np.concatenate([v for who, v in people.items() if who[0] == group]) for group in groups}
    freedom = len(people) - len(groups)
    error = sum(((values - values.mean()) ** 2).sum() for values in people.values()) / (len(every) - len(people))
    squares = {
        one: sum(len(v) * (v.mean() - by_group[one].mean()) ** 2 for (group, _), v in people.items() if group == one)
        for one in groups
    }
    typical = (
        len(every)
        - sum(sum(len(v) ** 2 for who, v in people.items() if who[0] == g) / len(by_group[g]) for g in groups)
    ) / freedom
    return sum(squares.values()) / freedom, float(error), typical, squares


def half_products(people: Mapping[tuple[str, str], Any]) -> Any:
    """Sums of products of odd and even episodes' means, given the group."""
    groups = sorted({group for group, _ in people})
    halves = np.array([[values[::2].mean(), values[1::2].mean()] for values in people.values()])
    dummies = np.array([[float(group == who) for group in groups] for who, _ in people])
    left = halves - dummies @ np.linalg.lstsq(dummies, halves, rcond=None)[0]
    return left.T @ left


def fishers_z(products: Any) -> float:
    spread = math.sqrt(products[0, 0] * products[1, 1])
    return float(np.arctanh(min(max(float(products[0, 1]) / spread, -1 + 1e-12), 1 - 1e-12))) if spread else 0.0


def skewed(people: Mapping[tuple[str, str], Any], sizes: Mapping[str, int]) -> bool:
    for group, n in sizes.items():
        means = np.array([values.mean() for who, values in people.items() if who[0] == group])
        error = math.sqrt(6 * n * (n - 1) / ((n - 2) * (n + 1) * (n + 3))) if n > 2 else math.inf
        if n > 3 and np.ptp(means) and abs(pd.Series(means).skew()) > 2.58 * error:
            return True
    return False


def reliability(people: Mapping[tuple[str, str], Any]) -> tuple[list[Any], str]:
    """The cells and the note: every participant is left out in turn, and all is computed anew of the others."""
    sizes = Counter(group for group, _ in people)
    count, freedom = len(people), len(people) - len(sizes)
    if freedom < 3:
        return [], ""
    every = np.concatenate(list(people.values()))
    model, error, typical, squares = mean_squares(people)
    products = half_products(people)
    if min(error, math.sqrt(products[0, 0] * products[1, 1])) <= 1e-12 * float((every**2).mean()):
        return [], ""
    ratio, z = model / error, fishers_z(products)
    estimates = [(ratio - 1) / (ratio - 1 + typical), max(0.0, 2 * math.tanh(z) / (1 + math.tanh(z)))]
    cells = [str(count), str(len(every))]
    if min(sizes.values()) < 4:
        note = f"{min(sizes.values())} in the smallest group: intervals need 4 participants per group"
        return [*cells, *map(number, estimates)], note
    logs, zs = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for who in people:
        others = {other: values for other, values in people.items() if other != who}
        rest_model, rest_error, rest_typical, _ = mean_squares(others)
        rest = 1 + (rest_model / max(rest_error, 1e-12 * error) - 1) * typical / rest_typical
        logs[who], zs[who] = math.log(max(rest, 1e-12)), fishers_z(half_products(others))

    def variance(estimates: Mapping[tuple[str, str], float]) -> float:
        of_groups = {group: [estimates[who] for who in people if who[0] == group] for group in sizes}
        return sum((len(v) - 1) * float(np.var(v)) for v in of_groups.values())

    within = len(every) - count
    pooled = sum(squares.values()) ** 2 / sum(square**2 / (sizes[g] - 1) for g, square in squares.items())
    spread = variance(logs) - 2 / within
    between = max(1.0, min(pooled, 2 / spread if spread > 0 else math.inf))
    shares = [ratio / scipy.stats.f(between, within).ppf(q) for q in (0.975, 0.025)]
    reach = scipy.stats.t.ppf(0.975, max(pooled, 1.0)) * math.sqrt(variance(zs))
    whole = [math.tanh(z - reach), math.tanh(z + reach)]
    bounds = [
        [(share - 1) / (share - 1 + typical) for share in shares],
        [max(0.0, 2 * one / (1 + max(one, -1 + 1e-12))) for one in whole],
    ]
    note = "values of participants are skewed, so that both intervals may be too narrow"
    told = [with_interval(estimate, bound) for estimate, bound in zip(estimates, bounds, strict=True)]
    return [*cells, *told], note if skewed(people, sizes) else ""


def power(n: tuple[int, int]) -> str:
    from statsmodels.stats.power import TTestIndPower

    solver = TTestIndPower()
    if min(n) < 2:
        return f"Power: with {n[0]} and {n[1]} participants no difference between groups can be tested."
    large = solver.power(0.8, nobs1=n[0], ratio=n[1] / n[0], alpha=0.05)
    detectable = solver.solve_power(None, nobs1=n[0], ratio=n[1] / n[0], alpha=0.05, power=0.8)
    needed = math.ceil(solver.solve_power(0.8, alpha=0.05, power=0.8))
    return (
        f"Power: with {n[0]} and {n[1]} participants a two-sided t test at 5 %, before any correction, detects a "
        f"difference of 0.8 standard deviations with a power of {100 * large:.0f} %; a power of 80 % needs one of "
        f"{float(np.squeeze(detectable)):.2f} standard deviations, or {needed} participants per group for one of 0.8."
    )


def expected_answers(study: Study) -> Iterator[tuple[str, Any]]:
    last: dict[tuple[Any, ...], Row] = {}
    for row in study.tables["answers"]:
        key = tuple(row[name] for name in ("participant", "session", "part", "questions", "item", "attempt"))
        last.pop(key, None)
        last[key] = row
    rows = list(last.values())
    if not rows:
        return
    parts: dict[tuple[Any, ...], set[int]] = defaultdict(set)
    for row in rows:
        parts[row["participant"], row["session"], row["questions"]].add(row["part"])
    given: dict[tuple[str, str], dict[tuple[Any, ...], list[Row]]] = defaultdict(lambda: defaultdict(list))
    groups = list(study.order) if len(study.order) > 1 else [""]
    for row in rows:
        time = sorted(parts[row["participant"], row["session"], row["questions"]]).index(row["part"]) + 1
        place = groups.index(row["group"]) if len(groups) > 1 else 0
        given[row["questions"], row["item"]][row["session"], time, place].append(row)
    several = [any(len({key[at] for key in asked}) > 1 for asked in given.values()) for at in (0, 1)]
    several.append(len(groups) > 1)
    whens = [name for name, its in zip(("session", "time", "group"), several, strict=True) if its]
    table = [["questions", "question", *whens, "answers", "n", "right", "median time (s)"]]
    for (part, item), asked in given.items():
        for key in sorted(asked):
            its = asked[key]
            numbers = [row["number"] for row in its if row["number"] is not None]
            if numbers and {row["kind"] for row in its} <= {"likert", "slider", "number"}:
                none = len(its) - len(numbers)
                said = f"mean {number(float(np.mean(numbers)))}, {number(min(numbers))} to {number(max(numbers))}"
                said += f"; none ({none})" if none else ""
            else:
                counts = Counter(row["said"] or row["answer"] or "nothing" for row in its)
                most = counts.most_common()
                said = ", ".join(f"{answer} ({many})" for answer, many in most[:8])
                said += f" and {len(most) - 8} others" if len(most) > 8 else ""
            right = [row["right"] for row in its if row["right"] is not None]
            share = f"{100 * float(np.mean(right)):.0f} %" if right else NOTHING
            took = number(float(np.median([row["answer_ms"] for row in its])) / 1000)
            when = [str(one) for one, is_shown in zip((*key[:2], groups[key[2]]), several, strict=True) if is_shown]
            table.append([part, item, *when, said, str(len(its)), share, took])
    yield "h2", "Answers"
    yield "table", table


def expected_quality(study: Study) -> Iterator[tuple[str, Any]]:
    yield "h2", "Quality of the data"
    yield (
        "p",
        (
            f"{len(study.sessions)} sessions were simulated: reaction and playing times are the simulated player's, "
            "and neither a keyboard nor a display was measured."
        ),
    )
    yield "p", "Display: window simulated."
    table = [["participant", "session", "presses", "focus lost", "pauses", "segments"]]
    for session in study.sessions:
        presses = sum(key.down for _, key in session.keys)
        lost = sum((note.kind, note.text) == ("focus", "lost") for note in session.notes)
        paused_s = sum(end - begin for begin, end in session.pauses) / 1e9
        ends = session.facts("end")
        clean = len(ends) == session.segments and all(end["clean"] == "true" for end in ends)
        segments = f"{session.segments}{'' if clean else ', cut off'}"
        who = session.who
        pauses = f"{len(session.pauses)}, {paused_s:.0f} s"
        table.append([who["participant"], str(who["session"]), str(presses), str(lost), pauses, segments])
    yield "summary", "By session"
    yield from long_table(table)


def long_table(table: list[list[Any]]) -> Iterator[tuple[str, Any]]:
    if len(table) > 61:
        yield "summary", f"{len(table) - 1} rows: {', '.join(table[0])}"
    yield "table", table


def expected_exclusions(study: Study) -> Iterator[tuple[str, Any]]:
    yield "h2", "Exclusions"
    included = {row["participant"] for row in study.participants if row["exclusion_reason"] is None}
    people = [row for row in study.participants if row["exclusion_reason"] is not None]
    whole = {(row["exclusion_reason"], row["participant"], row["session"]) for row in people}
    single = [
        row
        for row in study.tables["episodes"]
        if row["exclusion_reason"] is not None
        and (row["exclusion_reason"], row["participant"], row["session"]) not in whole
    ]
    if not people and not single:
        yield "p", "None."
        return
    removed: Counter[tuple[str, str]] = Counter()
    counted = set()
    for row in people:
        reason, code = row["exclusion_reason"], row["participant"]
        level = "session" if code in included else "participant"
        if level == "session" or (reason, code) not in counted:
            removed[reason, level] += 1
        counted.add((reason, code))
    removed.update((row["exclusion_reason"], "episode") for row in single)
    totals = [[reason, level, str(many)] for (reason, level), many in sorted(removed.items())]
    yield "table", [["reason", "level", "removed"], *totals]
    each = [[row["exclusion_reason"], row["participant"], str(row["session"]), "all"] for row in people]
    each += [[row["exclusion_reason"], row["participant"], str(row["session"]), str(row["episode"])] for row in single]
    yield "summary", "Each exclusion"
    yield "table", [["reason", "participant", "session", "episode"], *each]


def compare_page(study: Study, page: Path, tally: Tally) -> list[str]:
    """Compare a page element by element; return its methods paragraphs, which are checked by themselves."""
    figures = ("Figures", "More figures")
    items = [item for item in read_page(page) if item[0] != "figcaption" and item[1] not in figures]
    at = next(place for place, item in enumerate(items) if item[:2] == ("h2", "Methods"))
    end = next(place for place, item in enumerate(items) if item[:2] == ("h2", "Tables"))
    found = items[: at + 1]
    expected = list(expected_page(study))
    place = 0
    heading = ""
    for tag, its in expected:
        while place < len(found) and found[place][0] != tag:
            tally.wrong.append(f"{heading}: nothing expects {found[place][:2]}")
            place += 1
        if place == len(found):
            tally.wrong.append(f"the page lacks {tag} {str(its)[:200]}")
            break
        _, text, rows = found[place]
        place += 1
        heading = text if tag in ("h1", "h2", "h3") else heading
        if tag == "table":
            compare_table(heading, rows, its, tally)
        else:
            compare_text(heading, text, its, tally)
    tally.wrong += [f"nothing expects {item[:2]}" for item in found[place:]]
    return [text for tag, text, _ in items[at + 1 : end] if tag == "p"]


def literal(text: str) -> str:
    """A pattern for a text, with either of the numbers where it gives two."""
    parts = re.split(r"\{([^{}]*\|[^{}]*)\}", SPACES.sub(" ", text))
    either = ("(?:" + "|".join(map(re.escape, part.split("|"))) + ")" for part in parts[1::2])
    return "".join(re.escape(part) + next(either, "") for part in parts[::2])


def compare_text(where: str, text: str, expected: Expected, tally: Tally) -> None:
    tally.compared += max(len(NUMBER.findall(text)), 1)
    if isinstance(expected, Near):
        expected = (expected,)
    if isinstance(expected, str):
        expected = (expected.strip(),)
    pattern = "".join("(.+?)" if isinstance(part, Near) else literal(part) for part in expected)
    match = re.fullmatch(pattern, text)
    nears = [part for part in expected if isinstance(part, Near)]
    if match is None or not all(near.holds(one) for near, one in zip(nears, match.groups(), strict=True)):
        tally.wrong.append(f"{where}: {text!r}; by the logs {expected!r}")


def compare_table(where: str, rows: list[list[str]], expected: list[list[Any]], tally: Tally) -> None:
    where = f"{where}, table of {expected[0][0]}"
    tally.same(f"{where}, rows", len(rows), len(expected))
    families: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for number_, (found, row) in enumerate(zip(rows, expected, strict=False)):
        if len(found) != len(row):
            tally.wrong.append(f"{where} row {number_}: {found}; by the logs {row}")
            continue
        for place, (cell, value) in enumerate(zip(found, row, strict=True)):
            if isinstance(value, Holm):
                families[value.family].append((found[place - 1], cell))
            else:
                compare_text(f"{where} row {number_} {rows[0][place]} ({found[0]})", cell, value, tally)
    for family, cells in families.items():
        compare_holm(f"{where}, {family}", cells, tally)


def compare_holm(where: str, cells: Sequence[tuple[str, str]], tally: Tally) -> None:
    """The corrected p lie between those of the least and of the greatest p that print so."""
    from statsmodels.stats.multitest import multipletests

    told = [(p, holm) for p, holm in cells if p != "n/a"]
    tally.compared += len(cells)
    tally.wrong += [f"{where}: {holm} of no p" for p, holm in cells if p == "n/a" and holm != "n/a"]
    if not told:
        return
    low = [0.0 if p.startswith("<") else max(float(p) - 0.0005, 0.0) for p, _ in told]
    high = [0.001 if p.startswith("<") else min(float(p) + 0.0005, 1.0) for p, _ in told]
    bounds = [multipletests(ps, method="holm")[1] for ps in (low, high)]
    for (p, holm), least, most in zip(told, *bounds, strict=True):
        value = 0.0005 if holm.startswith("<") else float(holm)
        if not least - 0.0006 <= value <= most + 0.0006:
            tally.wrong.append(f"{where}: p {p} is {holm} by Holm; statsmodels {least:.4f} to {most:.4f}")
