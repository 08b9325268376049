"""Points and the bonus they earn, as numbers and as texts."""

import re
from typing import TYPE_CHECKING

from minihuman.experiment.plan.session_plan import BonusSpec
from minihuman.experiment.words import InterfaceWords

if TYPE_CHECKING:
    from minihuman.experiment.machine.activity import SessionContext

_NS_PER_MIN = 60e9
_SIGNED = re.compile(r"(?<!\w)[-+\u2212](?=\d)")


def format_total(words: InterfaceWords, points: float) -> str:
    """Return the session's total of points as a text in the language of ``words``."""
    return isolate_signs(words, words.fill("progress.points", points=format_points(points)))


def format_score(words: InterfaceWords, points: float) -> str:
    """Return the points of an episode as a text in the language of ``words``, such as "+10 points"."""
    return isolate_signs(words, words.fill("score", points=f"{'+' if points > 0 else ''}{format_points(points)}"))


def fill_score_fields(context: "SessionContext", text: str) -> str:
    """Return a text with {points}, {bonus} and {currency} replaced by the session's points, bonus and currency."""
    if not any(f"{{{field}}}" in text for field in ("points", "bonus", "currency")):
        return text
    bonus = context.plan.bonus or BonusSpec(0.0)
    return isolate_signs(
        context.words,
        text.replace("{points}", format_points(context.points))
        .replace("{bonus}", f"{compute_bonus(bonus, context.points, context.waited_ns, context.stranded):.2f}")
        .replace("{currency}", bonus.currency),
    )


def compute_bonus(bonus: BonusSpec, points: float, waited_ns: int = 0, stranded: bool = False) -> float:
    """Compute a session's bonus in the bonus's currency.

    Args:
        bonus: the protocol's bonus rules.
        points: the session's points.
        waited_ns: the time spent in lobbies in nanoseconds, which is paid in addition.
        stranded: whether other people or the study kept the session from being played, so that it earns at least the
            base pay.
    """
    earned = max(0.0, bonus.base + bonus.per_point * points)
    if bonus.most is not None:
        earned = min(earned, bonus.most)
    least = 0.0
    if stranded:
        least = bonus.base_pay or 0.0
    return max(earned, least) + (bonus.waiting_per_min or 0.0) * waited_ns / _NS_PER_MIN


def format_points(points: float) -> str:
    """Return a number of points as a text, rounded to one decimal, which is left out if it is 0."""
    rounded = round(points, 1)
    if rounded:
        return f"{rounded:.1f}".rstrip("0").rstrip(".")
    return "0"


class PointsNumber(float):
    """A number that formats without needless decimals in templates."""

    def __format__(self, spec: str) -> str:
        """Format by `format_points` unless ``spec`` is given."""
        if spec:
            return float.__format__(self, spec)
        return format_points(self)


def isolate_signs(words: InterfaceWords, text: str) -> str:
    """Mark plus and minus signs in a text of a right-to-left language, so that they are shown before their numbers.

    Without the marks, which are left-to-right marks, Unicode's rules would move the signs behind the numbers. Texts of
    other languages are returned unchanged.
    """
    if words.rtl:
        return _SIGNED.sub("\u200e\\g<0>", text)
    return text
