"""The reliability of a measure: how well it distinguishes participants, by intraclass correlation and split halves."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy

_MOST = 1 - 1e-12  # a correlation, of which Fisher's z is taken


@dataclass(frozen=True, slots=True)
class Reliability:
    """A measure's reliability over the participants with two or more episodes, with 95 % intervals."""

    measure: str
    participants: int
    episodes: int
    icc: float  # of one episode: the share of the variance, within groups, that lies between participants
    icc_interval: tuple[float, float]
    halves: float  # of all episodes together: odd against even ones, corrected to the whole length
    halves_interval: tuple[float, float]


def estimate_reliability(measure: str, rows: pd.DataFrame) -> Reliability | None:
    """Estimate a measure's reliability within groups; return None if too few participants are left or nothing varies.

    ``rows`` has ``group``, ``participant`` and ``value`` in the order of play. Participants must outnumber groups by
    three. The intraclass correlation is ICC(1), one-way random effects, with an interval from F (Shrout and Fleiss,
    1979), for unequal means of groups and numbers of episodes. The split-half reliability is Spearman and Brown's
    correction of the correlation of two means per participant, at least 0, with an interval from Fisher's z.
    """
    keys = ["group", "participant"]
    rows = rows.dropna()
    rows = rows[rows.groupby(keys)["value"].transform("size") > 1]
    people = rows.groupby(keys)["value"].agg(["size", "mean"])
    spare = len(people) - rows["group"].nunique()
    if spare < 3:
        return None
    within = rows["value"] - rows.groupby(keys)["value"].transform("mean")
    between = rows.groupby(keys)["value"].transform("mean") - rows.groupby("group")["value"].transform("mean")
    freedom = len(rows) - len(people)
    inside = float((within**2).sum()) / freedom
    across = float((between**2).sum()) / spare
    sizes = (
        people["size"]
        .groupby("group")
        .agg(lambda group_sizes: group_sizes.sum() - (group_sizes**2).sum() / group_sizes.sum())
    )
    length = float(sizes.sum()) / spare  # episodes of a participant, as unequal numbers count
    odd = rows.groupby(keys).cumcount() % 2
    halves = rows.groupby([*keys, odd])["value"].mean().unstack()
    halves -= halves.groupby("group").transform("mean")
    spread = float(np.sqrt((halves[0] ** 2).sum() * (halves[1] ** 2).sum()))
    if min(inside, spread) <= 1e-12 * float((rows["value"] ** 2).mean()):
        return None
    f = across / inside
    ends = (f / scipy.stats.f.ppf(0.975, spare, freedom), f * scipy.stats.f.ppf(0.975, freedom, spare))
    r = min(max(float((halves[0] * halves[1]).sum()) / spread, -_MOST), _MOST)
    reach = float(scipy.stats.norm.ppf(0.975)) / math.sqrt(spare - 2)
    icc, low, high = ((ratio - 1) / (ratio + length - 1) for ratio in (f, *ends))
    correlations = (math.tanh(math.atanh(r) + z) for z in (0.0, -reach, reach))
    whole_length, least, most = (max(0.0, 2 * correlation / (1 + correlation)) for correlation in correlations)
    return Reliability(measure, len(people), len(rows), icc, (low, high), whole_length, (least, most))
