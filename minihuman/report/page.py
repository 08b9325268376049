"""The report as one self-contained HTML page: figures inside, nothing fetched from anywhere."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import pandas as pd

from minihuman.data.counted import Account
from minihuman.data.quality import Quality
from minihuman.report.clauses import clauses_section
from minihuman.report.html import (
    STYLE,
    figure,
    interval,
    is_long,
    long_table,
    number,
    p_value,
    records,
    spread,
    table,
)
from minihuman.report.parts import parts_section
from minihuman.report.published import SOURCE, published
from minihuman.report.recorded import answers, left_out, quality, skipped
from minihuman.report.results import MEASURES, BlockResults, Results, Role, group_rewards
from minihuman.report.sentences import alike_statement, difference_statement, power_statement
from minihuman.report.waiting import waiting
from minihuman.statistics.compare import Comparison
from minihuman.statistics.growth import LEAST_EPISODES, Growth


@dataclass(frozen=True, slots=True)
class Page:
    """What the page is made of, besides the results."""

    study: str
    sessions: int
    players: Sequence[str]
    simulated: int  # sessions that no person played
    windows: Mapping[str, int]  # what they sat at, and how many sessions there
    flow: Sequence[str]  # how many came, left, were screened out and count; empty without a register
    methods: Sequence[str]
    knew: Mapping[str, Sequence[str]]  # block: the groups who came to it with the keys of the one before
    figures: Sequence[tuple[str, Path, str]]  # its block, "" for all; a PNG and its caption
    tables: Sequence[Path]
    qualities: Sequence[Quality]
    answers: pd.DataFrame
    clauses: pd.DataFrame  # asked for and done, by block, verb and group
    teaching: Sequence[str]  # the section on agents that were taught; empty where none was
    account: Account
    papers: bool  # the study and its worlds are the published one's


def page(facts: Page, found: Results) -> str:
    """Write the page."""
    paths = [figure(path, caption) for block, path, caption in facts.figures if not block]
    parts = [
        f"<h1>{escape(facts.study)}</h1>",
        f'<p class="lead">{_counted(facts, found)}</p>',
        *_nobody(facts),
        *facts.flow,
        *(_published_beside(found.target_block) if facts.papers and found.target_block else ()),
        *(
            part
            for one in found.blocks
            for part in _block(one, facts, found.order, is_target=one.block == found.target)
        ),
        *clauses_section(facts.clauses),
        *facts.teaching,
        *answers(facts.answers),
        *(["<h2>Paths</h2>", *paths] if paths else ()),
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


def _nobody(facts: Page) -> list[str]:
    """That data are simulated is said before any of them."""
    if not facts.simulated:
        return []
    who = (
        "all sessions were"
        if facts.simulated == facts.sessions
        else f"{facts.simulated} of {facts.sessions} sessions were"
    )
    told = f"Simulated data: {who} played by {', '.join(one for one in facts.players if one != 'human')}."
    return [
        f'<p class="key">{escape(told)} They say what this analysis does with such data, and nothing about people.</p>'
    ]


def _link(path: Path) -> str:
    """A file in a folder beside the page."""
    return f'<a href="{path.parent.name}/{path.name}">{escape(path.name)}</a>'


def _counted(facts: Page, found: Results) -> str:
    people, episodes = found.kept
    at = ", ".join(f"{window} in {count} sessions" for window, count in facts.windows.items())
    return escape(
        f"{_versions(facts.account)}; {facts.sessions} sessions read, {len(facts.account.skipped)} skipped; "
        f"{people} participants and {episodes} episodes count. Played by: {', '.join(facts.players) or 'nobody'}. "
        f"At: {at or 'nothing'}."
    )


def _versions(account: Account) -> str:
    """By which versions of the protocol the sessions were played."""
    told = [f"{version} in {count} sessions" for (_, version), count in sorted(account.versions.items())]
    if len(told) == 1:
        return f"Protocol version {told[0]}"
    return f"{len(told)} versions of the protocol are pooled here ({'; '.join(told)}), --version takes one"


def _block(one: BlockResults, facts: Page, found_groups: Sequence[str], *, is_target: bool) -> list[str]:
    """A block's section."""
    compared = "; the block that all groups are compared on" if is_target and len(one.groups) > 1 else ""
    if len(one.groups) == 1 and len(found_groups) > 1:
        compared = f"; played by {escape(str(one.groups['group'].iloc[0]))} alone, so nothing is compared"
    worlds = f"{escape(', '.join(one.worlds))}: " if one.worlds else ""
    return [
        f"<h2>Block {escape(one.block)}</h2>",
        f'<p class="lead">{worlds}{one.episodes} episodes count{compared}.</p>',
        *(f'<p class="key">{escape(difference_statement(each, one.block))}</p>' for each in one.headline),
        _unnamed(one),
        f'<div class="beside">{_measures(one)}{_subjects(one)}</div>',
        _comparisons(one.comparisons, one.roles, one.block),
        _known(one, facts.knew.get(one.block, ())),
        _set_aside(one.set_aside),
        *(f'<p class="key">{escape(alike_statement(each, one.roles))}</p>' for each in one.alike),
        waiting(one.waits),
        parts_section(one.parts),
        _growth(one.growth),
        *(f"<p>{escape(power_statement(each))}</p>" for each in one.powers),
        *(figure(path, caption) for block, path, caption in facts.figures if block == one.block),
    ]


def _unnamed(one: BlockResults) -> str:
    """That nobody said beforehand what would count."""
    if not one.comparisons or "primary" in one.roles.values():
        return ""
    return (
        '<p class="few">The protocol names no primary measure of this block, so all that is compared here is '
        "exploratory, and the p above is not corrected.</p>"
    )


def _known(one: BlockResults, groups: Sequence[str]) -> str:
    """Who had no keys to find."""
    if not groups or not one.comparisons:
        return ""
    return (
        f'<p class="few">{escape(", ".join(groups))} came with the keys of the block before: their time until every '
        "key was found is the time until they first used each.</p>"
    )


def _published_beside(one: BlockResults) -> list[str]:
    """The published study's subjects beside this one's; for that study only."""
    frame = published()
    rows = [(row["group"], str(row["subject"]), f"{row['reward_mean']:.2f}") for row in records(frame)]
    means = group_rewards(frame)
    rows += [(row["group"], "all", spread(row["reward_mean"], row["reward_sd"])) for row in records(means)]
    theirs = table(f"Published: {SOURCE}.", ("group", "subject", "reward"), rows, words=2)
    rewards = [each for each in one.comparisons if each.measure == "reward_mean"]
    effect = "".join(
        f"<p>The published measure. {escape(difference_statement(e, one.block))} A mean reward mixes how often time "
        "ran out with how many steps were taken; what groups are compared on here comes with the block.</p>"
        for e in rewards
    )
    return ["<h2>Beside the published study</h2>", effect, f'<div class="beside">{_subjects(one)}{theirs}</div>']


def _subjects(one: BlockResults) -> str:
    several = one.subjects["session"].nunique() > 1

    def row(group: str, who: str, session: str, n: int, mean: float, sd: float) -> tuple[str, ...]:
        return (group, who, *((session,) if several else ()), str(n), spread(mean, sd))

    rows = [
        row(
            its["group"], its["participant"], str(its["session"]), its["episodes"], its["reward_mean"], its["reward_sd"]
        )
        for its in records(one.subjects)
    ]
    groups = [
        row(its["group"], "all", "all", its["participants"], its["reward_mean"], its["reward_sd"])
        for its in records(one.groups)
    ]
    heads = ("group", "subject", *(("session",) if several else ()), "n", "reward")
    words = len(heads) - 2
    caption = f"Reward in block {one.block}: mean (standard deviation). Rows “all” are over subjects' means."
    if is_long(rows):
        return f"<div>{table(caption, heads, groups, words=words)}{long_table('', heads, rows, words=words)}</div>"
    return table(caption, heads, [*rows, *groups], words=words)


def _comparisons(found: Sequence[Comparison], roles: Mapping[str, Role], block: str) -> str:
    if not found:
        return ""
    named = set(roles.values()) != {"exploratory"}
    pairs = {
        (one.first, one.second): f"{one.first}\N{NO-BREAK SPACE}\N{MINUS SIGN}\N{NO-BREAK SPACE}{one.second}"
        for one in found
    }
    several = len(pairs) > 1
    which = "" if several else f" ({next(iter(pairs.values()))})"
    rows = [
        (
            MEASURES[one.measure], *((roles[one.measure],) if named else ()),
            *((pairs[one.first, one.second],) if several else ()), f"{one.n[0]}, {one.n[1]}",
            *((f"{number(one.means[0])}, {number(one.means[1])}",) if several else map(number, one.means)),
            _with_interval(one.difference, one.interval),
            p_value(one.p), p_value(one.p_holm), p_value(one.smallest_p),
            _with_interval(one.g, one.g_interval, 2),
        )
        for one in found
    ]  # fmt: skip
    heads = (
        *("measure", *(("named before",) if named else ()), *(("groups",) if several else ()), "n"),
        *(("means",) if several else (f"mean, {group}" for pair in pairs for group in pair)),
        "difference",
        *("p", "p (Holm)", "smallest p", "g"),
    )
    apart = ", within the primary measure, within the secondary ones, and within the rest, which nobody named before"
    caption = (
        f"Groups compared in block {block}{which}, one value a participant, 95 % intervals in brackets. p: two-sided "
        "permutation test of Welch's t; interval of the difference: Welch's; smallest p: what groups of these sizes "
        f"can come to; g: Hedges'. p is corrected for how many there are (Holm){apart if named else ''}."
    )
    reasons = [
        f"{MEASURES[one.measure]}, {one.first} \N{MINUS SIGN} {one.second}: {one.reason}" for one in found if one.reason
    ]
    because = f'<p class="few">Not compared, or not in every way: {escape("; ".join(reasons))}.</p>' if reasons else ""
    return f'<div class="wide">{table(caption, heads, rows, words=1 + named + several)}</div>{because}'


def _set_aside(why: Mapping[str, str]) -> str:
    if not why:
        return ""
    told = "; ".join(f"{MEASURES[name]} ({reason})" for name, reason in why.items())
    return f'<p class="few">Left out, since it would make those who fail more look better: {escape(told)}.</p>'


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
