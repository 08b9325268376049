"""How many steps an episode took beside those that a known way takes; those who never got there included."""

import math


def excess_steps(steps: int, best: int | None, *, success: bool) -> float | None:
    """Steps over the best known way, of an episode that reached its goal; None of others, or where no way is known."""
    return float(steps - best) if success and best is not None else None


def log_excess_steps(steps: int, best: int | None, limit: int, outcome: str) -> float | None:
    """The natural logarithm of one more than the excess steps; who did not get there counts as at the step limit.

    Steps are multiplied by what makes people slow, so their logarithm is what is compared; and a group that fails more
    must not look better by being left out. None for an episode that was broken off, or where no way is known.
    """
    if best is None or outcome not in ("goal", "timeout", "failure"):
        return None
    return math.log1p(max((steps if outcome == "goal" else limit) - best, 0))


def log_steps_ratio(steps: int, best: int | None, limit: int, outcome: str) -> float | None:
    """The natural logarithm of the steps over those of the best known way; who did not get there took all there were.

    Differences are ratios of steps: -0.36 is 30 % fewer. ``log_excess_steps`` weighs a step most where hardly any was
    too many, so a layout on which everybody is nearly perfect tells as much there as all others together; here a step
    counts by the length of the way. None for an episode that was broken off, or where no way is known.
    """
    if best is None or best < 1 or outcome not in ("goal", "timeout", "failure"):
        return None
    return math.log(max(steps if outcome == "goal" else limit, best) / best)


def spl(steps: int, best: int | None, outcome: str) -> float | None:
    """Success weighted by path length, in steps (Anderson et al., 2018): best / steps of who got there, 0 of others.

    None for an episode that was broken off, or where no way is known.
    """
    if best is None or outcome not in ("goal", "timeout", "failure"):
        return None
    return best / max(steps, best) if outcome == "goal" and steps else 0.0
