"""The page's words about waiting: who never found every key, what that hides, and the two parts of a reward."""

from html import escape

from minihuman.report.html import interval, number, p_value, table
from minihuman.report.waits import Waits


def waiting(found: Waits) -> str:
    """Key finding compared, with those who never found them all in it, and what no goal makes of a reward."""
    never = [f"{group} {int((~one.came).sum())} of {len(one.came)}" for group, one in found.goal.items()]
    out = sum(int((~one.came).sum()) for one in found.goal.values())
    told = ""
    if out:
        told = (
            f'<p class="few">Episodes that did not reach the goal: {escape(", ".join(never))}. A mean reward mixes how '
            "often the goal was reached with in how many steps.</p>"
        )
    rows = [
        (
            f"{a} \N{MINUS SIGN} {b}", f"{one.n[0]}, {one.n[1]}", f"{one.never[0]}, {one.never[1]}", number(one.until),
            f"{number(one.means[0])}, {number(one.means[1])}",
            f"{number(one.difference, sign='+')} ({interval(one.interval, sign='+')})", p_value(one.p),
        )
        for a, b, one in found.compared
    ]  # fmt: skip
    if not rows:
        return told
    caption = (
        "Playing time until every key was found, those who never found them all watched to their last step: means "
        "restricted to the time that both groups were watched, Welch's interval over pseudo-observations, log-rank p "
        "(not corrected)."
    )
    heads = ("groups", "n", "never", "watched (s)", "restricted means (s)", "difference (95 %)", "p")
    return told + table(caption, heads, rows)
