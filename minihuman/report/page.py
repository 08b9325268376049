"""The report as one self-contained HTML page: figures inside, nothing fetched from anywhere."""

import base64
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

from minihuman.data.counted import Account
from minihuman.data.opened import Skipped
from minihuman.report.published import SOURCE, published
from minihuman.report.results import MEASURES, Results, group_rewards
from minihuman.statistics.compare import Comparison
from minihuman.statistics.growth import LEAST_EPISODES, Growth
from minihuman.statistics.power import Power

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1c1c1c; max-width: 60rem;
  margin: 2.5rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.7rem; margin-bottom: 0; } h2 { font-size: 1.2rem; margin-top: 2.4rem; border-bottom: 1px solid #ddd; }
p.lead { color: #555; margin-top: .3rem; }
table { border-collapse: collapse; margin: .8rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .22rem .8rem; text-align: right; border-bottom: 1px solid #eee; vertical-align: top; }
th { border-bottom: 1px solid #999; font-weight: 600; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
td:not(.word) { white-space: nowrap; } td, th { padding-right: .5rem; }
td.word, th.word { text-align: left; }
caption { text-align: left; color: #555; padding-bottom: .3rem; }
.beside { display: flex; flex-wrap: wrap; gap: 3rem; align-items: flex-start; }
figure { margin: 1rem 0; display: inline-block; vertical-align: top; } figure img { width: 24rem; max-width: 100%; }
figcaption { color: #555; max-width: 24rem; }
.key { background: #f3f7fa; border-left: 4px solid #0072b2; padding: .7rem 1rem; }
"""


@dataclass(frozen=True, slots=True)
class Page:
    """What the page is made of, besides the results."""

    study: str
    sessions: int
    players: Sequence[str]
    figures: Sequence[tuple[Path, str]]  # a PNG and its caption
    tables: Sequence[Path]
    account: Account


def page(facts: Page, found: Results) -> str:
    """Write the page."""
    parts = [
        f"<h1>{escape(facts.study)}</h1>",
        f'<p class="lead">{_counted(facts, found)}</p>',
        "<h2>Reward</h2>",
        _transfer(found),
        f'<div class="beside">{_subjects(found)}{_published()}</div>',
        "<h2>Groups compared</h2>",
        _comparisons(found.comparisons, found.block),
        _growth(found.growth),
        *(f"<p>{escape(power_statement(one))}</p>" for one in found.powers),
        "<h2>Measures by group</h2>",
        _measures(found),
        "<h2>Figures</h2>",
        *(_figure(path, caption) for path, caption in facts.figures),
        "<h2>Left out</h2>",
        _left_out(found.exclusions),
        "<h2>Logs skipped</h2>",
        _skipped(facts.account.skipped),
        "<h2>Tables</h2>",
        f"<p>{', '.join(escape(path.name) for path in facts.tables)}</p>",
    ]
    body = "\n".join(parts)
    title = escape(f"{facts.study}: report")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def transfer_statement(one: Comparison, block: str) -> str:
    """The effect of what came before a block on the reward in it, in one sentence."""
    return (
        f"Transfer effect: in block {block}, {one.first} minus {one.second} is "
        f"{_number(one.difference, sign='+')} reward (95 % interval {_range(one.interval, sign='+')}; "
        f"permutation p {_p(one.p)}; Hedges' g {_number(one.g, 2)}, "
        f"interval {_range(one.g_interval, 2)}; "
        f"{one.n[0]} and {one.n[1]} participants)."
    )


def power_statement(one: Power) -> str:
    """What the sample could show, in one sentence."""
    a, b = one.n
    if math.isnan(one.power_for_large):
        return f"Power: with {a} and {b} participants no difference between groups can be tested."
    return (
        f"Power: with {a} and {b} participants a two-sided t test at 5 % finds a difference of 0.8 standard deviations "
        f"with a chance of {100 * one.power_for_large:.0f} %; a chance of 80 % needs a difference of "
        f"{one.detectable_g:.2f} standard deviations, or {one.needed_for_large} participants a group for one of 0.8."
    )


def _counted(facts: Page, found: Results) -> str:
    people, episodes = found.kept
    return escape(
        f"{_versions(facts.account)}; {facts.sessions} sessions read, {len(facts.account.skipped)} skipped; "
        f"{people} participants and {episodes} episodes count. Played by: {', '.join(facts.players) or 'nobody'}."
    )


def _versions(account: Account) -> str:
    """By which versions of the protocol the sessions were played."""
    told = [f"{version} in {count} sessions" for (_, version), count in sorted(account.versions.items())]
    if len(told) == 1:
        return f"Protocol version {told[0]}"
    return f"{len(told)} versions of the protocol are pooled here ({'; '.join(told)}), --version takes one"


def _transfer(found: Results) -> str:
    rewards = [one for one in found.comparisons if one.measure == "reward_mean"]
    if not rewards:
        return "<p>There are no two groups of two participants or more to compare.</p>"
    return "".join(f'<p class="key">{escape(transfer_statement(one, found.block))}</p>' for one in rewards)


def _subjects(found: Results) -> str:
    rows = [
        (row["group"], row["participant"], str(row["episodes"]), _spread(row["reward_mean"], row["reward_sd"]))
        for row in _records(found.subjects)
    ]
    rows += [
        (row["group"], "all", str(row["participants"]), _spread(row["reward_mean"], row["reward_sd"]))
        for row in _records(found.groups)
    ]
    caption = f"This study, block {found.block}: mean (standard deviation). Rows “all” are over subjects' means."
    return _table(caption, ("group", "subject", "n", "reward"), rows, words=2)


def _published() -> str:
    frame = published()
    rows = [(row["group"], str(row["subject"]), f"{row['reward_mean']:.2f}") for row in _records(frame)]
    means = group_rewards(frame)
    rows += [(row["group"], "all", _spread(row["reward_mean"], row["reward_sd"])) for row in _records(means)]
    return _table(f"Published: {SOURCE}.", ("group", "subject", "reward"), rows, words=2)


def _comparisons(found: Sequence[Comparison], block: str) -> str:
    rows = [
        (
            MEASURES[one.measure], f"{one.first} \N{MINUS SIGN} {one.second}",
            _number(one.means[0]), _number(one.means[1]),
            _number(one.difference), _range(one.interval),
            f"{one.n[0]}, {one.n[1]}", _p(one.p), _p(one.p_holm), _p(one.smallest_p), _number(one.g, 2), one.reason,
        )
        for one in found
    ]  # fmt: skip
    heads = (
        *("measure", "groups", "first", "second", "difference", "95 % interval"),
        *("n", "p", "p (Holm)", "smallest p", "g", "not compared because"),
    )
    caption = (
        f"Block {block}, one value a participant. p: two-sided permutation test of Welch's t; interval: Welch's t; "
        "smallest p: what groups of these sizes can come to; g: Hedges'."
    )
    return _table(caption, heads, rows, words=2) if rows else "<p>Nothing to compare.</p>"


def _growth(found: Growth | None) -> str:
    if found is None:
        return f"<p>Needs two participants of a group with {LEAST_EPISODES} episodes or more.</p>"
    rows = [
        (term.name, str(term.people), _number(term.estimate), _range(term.interval), _p(term.p)) for term in found.terms
    ]
    caption = (
        f"{found.measure.capitalize()} over the block's episodes: a line for each participant, then the participants' "
        f"lines compared (t, Welch's between groups). What is compared is compared with {found.reference}."
    )
    left_out = f" Not in it: {'; '.join(found.left_out)}." if found.left_out else ""
    return _table(caption + left_out, ("term", "participants", "estimate", "95 % interval", "p"), rows)


def _measures(found: Results) -> str:
    rows = [
        (MEASURES[row["measure"]], row["group"], str(row["n"]), _spread(row["mean"], row["sd"]))
        for row in _records(found.measures)
    ]
    caption = f"Block {found.block}: mean (standard deviation) over participants."
    return _table(caption, ("measure", "group", "n", "mean"), rows, words=2)


def _left_out(rows: pd.DataFrame) -> str:
    if rows.empty:
        return "<p>Nothing.</p>"
    counts = rows.groupby(["left_out", "level"]).size().reset_index(name="count")
    totals = [(row["left_out"], row["level"], str(row["count"])) for row in _records(counts)]
    each = [
        (row["left_out"], row["participant"], str(row["session"]), _which(row["episode"])) for row in _records(rows)
    ]
    return _table("Rules and what they removed.", ("reason", "level", "removed"), totals, words=2) + _table(
        "", ("reason", "participant", "session", "episode"), each, words=2
    )


def _which(episode: Any) -> str:
    return "all" if pd.isna(episode) else str(episode)


def _skipped(skipped: Sequence[Skipped]) -> str:
    if not skipped:
        return "<p>None.</p>"
    return _table("", ("log", "reason"), [(str(one.path), one.reason) for one in skipped], words=2)


def _figure(path: Path, caption: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    alt = escape(caption, quote=True)
    return f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"><figcaption>{alt}</figcaption></figure>'


def _table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]], *, words: int = 1) -> str:
    """A table whose first ``words`` columns hold words."""

    def line(cells: Sequence[str], tag: str) -> str:
        kinds = [' class="word"' if place < words else "" for place in range(len(cells))]
        return "<tr>" + "".join(f"<{tag}{k}>{escape(c)}</{tag}>" for k, c in zip(kinds, cells, strict=True)) + "</tr>"

    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}{line(heads, 'th')}{''.join(line(row, 'td') for row in rows)}</table>"


def _records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def _spread(mean: float, sd: float) -> str:
    return f"{_number(mean)} ({_number(sd)})"


def _number(value: float, digits: int = 3, *, sign: str = "-") -> str:
    """Three decimals, fewer for a number with digits before the point; ``sign`` "+" shows that of a gain too."""
    if math.isnan(value):
        return "n/a"
    before = len(f"{abs(value):.0f}") if abs(value) >= 1 else 0
    return f"{value:{sign}.{max(digits - before, 0)}f}".replace("-", "\N{MINUS SIGN}")


def _range(bounds: tuple[float, float], digits: int = 3, *, sign: str = "-") -> str:
    low, high = (_number(bound, digits, sign=sign) for bound in bounds)
    return "n/a" if math.isnan(bounds[0]) else f"{low} to {high}"


def _p(value: float) -> str:
    if math.isnan(value):
        return "n/a"
    return "< 0.001" if value < 0.001 else f"{value:.3f}"
