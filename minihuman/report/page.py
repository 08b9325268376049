"""The report as one self-contained HTML page: figures inside, nothing fetched from anywhere."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import pandas as pd

from minihuman.data.counted import Account
from minihuman.data.quality import Quality
from minihuman.report.html import STYLE, figure, interval, number, p_value, records, spread, table
from minihuman.report.published import SOURCE, published
from minihuman.report.recorded import answers, left_out, quality, skipped
from minihuman.report.results import MEASURES, Alike, BlockResults, Results, Role, group_rewards
from minihuman.statistics.compare import Comparison
from minihuman.statistics.growth import LEAST_EPISODES, Growth
from minihuman.statistics.power import Power

FEW = 5  # participants a group, below which an effect size says little


@dataclass(frozen=True, slots=True)
class Page:
    """What the page is made of, besides the results."""

    study: str
    sessions: int
    players: Sequence[str]
    methods: Sequence[str]
    figures: Sequence[tuple[str, Path, str]]  # its block, "" for all; a PNG and its caption
    tables: Sequence[Path]
    qualities: Sequence[Quality]
    answers: pd.DataFrame
    account: Account
    papers: bool  # the study and its worlds are the published one's


def page(facts: Page, found: Results) -> str:
    """Write the page."""
    parts = [
        f"<h1>{escape(facts.study)}</h1>",
        f'<p class="lead">{_counted(facts, found)}</p>',
        *(_published_beside(found.target_block) if facts.papers and found.target_block else ()),
        *(part for one in found.blocks for part in _block(one, facts, is_target=one.block == found.target)),
        *answers(facts.answers),
        "<h2>Paths</h2>",
        *(figure(path, caption) for block, path, caption in facts.figures if not block),
        "<h2>Quality of the data</h2>",
        quality(facts.qualities),
        "<h2>Left out</h2>",
        left_out(found.exclusions),
        "<h2>Logs skipped</h2>",
        skipped(facts.account.skipped),
        "<h2>Methods</h2>",
        *(f"<p>{escape(one)}</p>" for one in facts.methods),
        "<h2>Tables</h2>",
        f"<p>{', '.join(map(_link, facts.tables))}</p>",
    ]
    body = "\n".join(parts)
    title = escape(f"{facts.study}: report")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def difference_statement(one: Comparison, block: str) -> str:
    """How far apart two groups' rewards in a block are, in one sentence."""
    few = " With so few participants the effect size says little." if min(one.n) < FEW else ""
    return (
        f"Reward in block {block}: {one.first} minus {one.second} is "
        f"{number(one.difference, sign='+')} (95 % interval {interval(one.interval, sign='+')}; "
        f"permutation p {p_value(one.p)}; Hedges' g {number(one.g, 2)}, "
        f"interval {interval(one.g_interval, 2)}; "
        f"{one.n[0]} and {one.n[1]} participants).{few}"
    )


def alike_statement(one: Alike, roles: Mapping[str, Role]) -> str:
    """Whether two groups are shown to be alike, in one sentence."""
    (primary,) = (name for name, role in roles.items() if role == "primary")
    shown = "are shown to be alike" if one.test.alike else "are not shown to be alike"
    return (
        f"{MEASURES[primary].capitalize()}: {one.first} and {one.second} {shown} within {one.test.bounds[1]:g}, as the "
        f"protocol says (two one-sided tests, p {p_value(one.test.p)}; 90 % interval of the difference "
        f"{interval(one.test.interval, sign='+')})."
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


def _link(path: Path) -> str:
    """A file in a folder beside the page."""
    return f'<a href="{path.parent.name}/{path.name}">{escape(path.name)}</a>'


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


def _block(one: BlockResults, facts: Page, *, is_target: bool) -> list[str]:
    """A block's section."""
    compared = "; the block that all groups are compared on" if is_target and len(one.groups) > 1 else ""
    worlds = f"{escape(', '.join(one.worlds))}: " if one.worlds else ""
    rewards = [comparison for comparison in one.comparisons if comparison.measure == "reward_mean"]
    return [
        f"<h2>Block {escape(one.block)}</h2>",
        f'<p class="lead">{worlds}{one.episodes} episodes count{compared}.</p>',
        *(f'<p class="key">{escape(difference_statement(each, one.block))}</p>' for each in rewards),
        f'<div class="beside">{_measures(one)}{_subjects(one)}</div>',
        _comparisons(one.comparisons, one.roles, one.block),
        *(f'<p class="key">{escape(alike_statement(each, one.roles))}</p>' for each in one.alike),
        _growth(one.growth),
        *(f"<p>{escape(power_statement(each))}</p>" for each in one.powers),
        *(figure(path, caption) for block, path, caption in facts.figures if block == one.block),
    ]


def _published_beside(one: BlockResults) -> list[str]:
    """The published study's subjects beside this one's; for that study only."""
    frame = published()
    rows = [(row["group"], str(row["subject"]), f"{row['reward_mean']:.2f}") for row in records(frame)]
    means = group_rewards(frame)
    rows += [(row["group"], "all", spread(row["reward_mean"], row["reward_sd"])) for row in records(means)]
    theirs = table(f"Published: {SOURCE}.", ("group", "subject", "reward"), rows, words=2)
    rewards = [each for each in one.comparisons if each.measure == "reward_mean"]
    effect = "".join(
        f'<p class="key">Transfer effect. {escape(difference_statement(e, one.block))}</p>' for e in rewards
    )
    return ["<h2>Beside the published study</h2>", effect, f'<div class="beside">{_subjects(one)}{theirs}</div>']


def _subjects(one: BlockResults) -> str:
    rows = [
        (row["group"], row["participant"], str(row["episodes"]), spread(row["reward_mean"], row["reward_sd"]))
        for row in records(one.subjects)
    ]
    rows += [
        (row["group"], "all", str(row["participants"]), spread(row["reward_mean"], row["reward_sd"]))
        for row in records(one.groups)
    ]
    caption = f"Reward in block {one.block}: mean (standard deviation). Rows “all” are over subjects' means."
    return table(caption, ("group", "subject", "n", "reward"), rows, words=2)


def _comparisons(found: Sequence[Comparison], roles: Mapping[str, Role], block: str) -> str:
    if not found:
        return ""
    named = set(roles.values()) != {"exploratory"}
    rows = [
        (
            MEASURES[one.measure], *((roles[one.measure],) if named else ()),
            f"{one.first} \N{MINUS SIGN} {one.second}",
            f"{one.n[0]}, {one.n[1]}", f"{number(one.means[0])}, {number(one.means[1])}",
            _with_interval(one.difference, one.interval),
            p_value(one.p), p_value(one.p_holm), p_value(one.smallest_p),
            _with_interval(one.g, one.g_interval, 2),
        )
        for one in found
    ]  # fmt: skip
    heads = (
        *("measure", *(("named before",) if named else ()), "groups", "n", "means", "difference"),
        *("p", "p (Holm)", "smallest p", "g"),
    )
    apart = ", within the primary measure, within the secondary ones, and within the rest, which nobody named before"
    caption = (
        f"Groups compared in block {block}, one value a participant, 95 % intervals in brackets. p: two-sided "
        "permutation test of Welch's t; interval of the difference: Welch's; smallest p: what groups of these sizes "
        f"can come to; g: Hedges'. p is corrected for how many there are (Holm){apart if named else ''}."
    )
    reasons = [
        f"{MEASURES[one.measure]}, {one.first} \N{MINUS SIGN} {one.second}: {one.reason}" for one in found if one.reason
    ]
    because = f'<p class="few">Not compared, or not in every way: {escape("; ".join(reasons))}.</p>' if reasons else ""
    return f'<div class="wide">{table(caption, heads, rows, words=3 if named else 2)}</div>{because}'


def _with_interval(value: float, bounds: tuple[float, float], digits: int = 3) -> str:
    return number(value, digits) if math.isnan(bounds[0]) else f"{number(value, digits)} ({interval(bounds, digits)})"


def _growth(found: Growth | None) -> str:
    if found is None:
        return (
            f"<p>How it changed over the episodes: needs two participants of a group with {LEAST_EPISODES} or more.</p>"
        )
    rows = [
        (term.name, str(term.people), number(term.estimate), interval(term.interval), p_value(term.p))
        for term in found.terms
    ]
    caption = (
        f"{found.measure.capitalize()} over the block's episodes: a line for each participant, then the participants' "
        f"lines compared (t, Welch's between groups). What is compared is compared with {found.reference}."
    )
    others = f" Not in it: {'; '.join(found.left_out)}." if found.left_out else ""
    return table(caption + others, ("term", "participants", "estimate", "95 % interval", "p"), rows)


def _measures(one: BlockResults) -> str:
    rows = [
        (MEASURES[row["measure"]], row["group"], str(row["n"]), spread(row["mean"], row["sd"]))
        for row in records(one.measures)
    ]
    caption = f"Measures of block {one.block}: mean (standard deviation) over participants."
    return table(caption, ("measure", "group", "n", "mean"), rows, words=2)
