"""A reward that is 0 where time ran out, compared in its two parts, in words and numbers."""

from collections.abc import Sequence
from html import escape
from itertools import combinations

import numpy as np
import pandas as pd

from minihuman.report.html import interval, number, p_value, table
from minihuman.statistics.two_parts import Part, TwoParts, has_mass_at_zero, two_parts


def reward_parts(episodes: pd.DataFrame, order: Sequence[str]) -> tuple[TwoParts, ...]:
    """Every two groups compared in both parts of the reward; none where it has no mass at 0."""
    if not has_mass_at_zero(episodes["reward"].to_numpy(np.float64)):
        return ()
    return tuple(two_parts(episodes, "reward", pair) for pair in combinations(order, 2))


def parts_section(found: Sequence[TwoParts]) -> str:
    """The table, with a reason for each part that is not told."""
    if not found:
        return ""
    rows = [
        (
            f"{one.first} \N{MINUS SIGN} {one.second}",
            f"{one.n[0]}, {one.n[1]}",
            f"{one.shares[0]:.1%}, {one.shares[1]:.1%}",
            _told(one.any),
            p_value(one.any.p),
            _told(one.amount),
            p_value(one.amount.p),
            p_value(one.p),
        )
        for one in found
    ]
    caption = (
        "Reward in two parts: whether an episode earned anything, and how much where it did. Odds ratio and difference "
        "with 95 % intervals: generalised estimating equations, episodes of one participant exchangeable, Mancl and "
        "DeRouen's covariance, Welch's t. p of both: permutation of participants over the sum of both squared Welch's "
        "t (not corrected)."
    )
    heads = ("groups", "n", "earned", "odds ratio", "p", "difference where earned", "p", "p of both")
    reasons = [
        f"{what}, {one.first} \N{MINUS SIGN} {one.second}: {part.reason}"
        for one in found
        for what, part in (("odds", one.any), ("difference", one.amount))
        if part.reason
    ]
    because = f'<p class="few">Not told: {escape("; ".join(reasons))}.</p>' if reasons else ""
    return f'<div class="wide">{table(caption, heads, rows)}</div>{because}'


def _told(part: Part) -> str:
    return number(part.estimate) if part.reason else f"{number(part.estimate)} ({interval(part.interval)})"
