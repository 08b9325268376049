"""Adaptive designs of a study: minimisation, Thompson sampling and group-sequential stopping.

Each design condenses the participants into sufficient statistics, which are logged, and decides from these alone.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import msgspec
import numpy as np

from minihuman.experiment.plan.designs import (
    Draw,
    EnrolledParticipant,
    EnrolmentDecision,
    EnrolmentDesign,
    read_design_settings,
    require_setting,
    round_estimate,
)

_COMPARED_DIGITS = 9  # decimals of the numbers that a decision compares, so that all processors decide alike
_MIN_PARTICIPANTS_AT_LOOK = 4  # of a group-sequential study: two in each of its two groups, for a variance


class MinimisationSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of minimisation."""

    probability: float = 0.8  # of choosing a group that leaves the least imbalance
    stratum_weight: float = 2.0  # of the imbalance within the participant's stratum, beside that of the whole study


class Minimisation(EnrolmentDesign):
    """Minimisation with a biased coin (Pocock & Simon, 1975, Biometrics 31) over the stratum and the whole study."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = read_design_settings(settings, MinimisationSettings)
        probability = self.settings.probability
        weight = self.settings.stratum_weight
        require_setting(0.5 < probability <= 1, f"probability is {probability:g}; use more than 0.5, 1 at most")
        require_setting(weight >= 0, f"stratum_weight is {weight:g}; use 0 or more")

    def compute_statistics(self, enrolled: Sequence[EnrolledParticipant], groups: Mapping[str, int]) -> dict[str, Any]:
        """Return the allocation ratios, and the counts of participants by group in the whole study and each stratum."""
        participants_by_stratum: dict[str, list[EnrolledParticipant]] = {}
        for participant in enrolled:
            if participant.stratum:
                participants_by_stratum.setdefault(participant.stratum, []).append(participant)
        return {
            "ratios": dict(groups),
            "all": _count_by_group(enrolled, groups),
            "strata": {
                stratum: _count_by_group(participants, groups)
                for stratum, participants in sorted(participants_by_stratum.items())
            },
        }

    def decide(self, statistics: Mapping[str, Any], stratum: str, draw: Draw) -> EnrolmentDecision:
        """Choose a group that leaves the least imbalance with the set ``probability``, and otherwise another group."""
        ratios: dict[str, int] = statistics["ratios"]
        weighted_counts: list[tuple[float, Mapping[str, int]]] = [(1.0, statistics["all"])]
        if stratum:
            weighted_counts.append((self.settings.stratum_weight, statistics["strata"].get(stratum, {})))
        imbalances = {}
        for group in ratios:
            imbalance = 0.0
            for weight, counts in weighted_counts:
                imbalance += weight * _compute_imbalance(counts, ratios, group)
            imbalances[group] = round(imbalance, _COMPARED_DIGITS)
        least = min(imbalances.values())
        best_groups = [group for group in ratios if imbalances[group] == least]
        other_groups = [group for group in ratios if group not in best_groups]
        coin, choice_share = draw(2)
        if other_groups and coin >= self.settings.probability:
            candidates = other_groups
        else:
            candidates = best_groups
        group = candidates[int(choice_share * len(candidates))]
        return EnrolmentDecision(group, estimates={"imbalance": least})


def _count_by_group(participants: Sequence[EnrolledParticipant], groups: Mapping[str, int]) -> dict[str, int]:
    """Return the number of participants in each of the groups."""
    names = [participant.group for participant in participants]
    return {group: names.count(group) for group in groups}


def _compute_imbalance(counts: Mapping[str, int], ratios: Mapping[str, int], new_group: str) -> float:
    """Compute the imbalance of the groups after a participant has joined ``new_group``.

    It is the range of the groups' counts, each divided by the group's allocation ratio.
    """
    filled_shares = []
    for group, ratio in ratios.items():
        count = counts.get(group, 0)
        if group == new_group:
            count += 1
        filled_shares.append(count / ratio)
    return max(filled_shares) - min(filled_shares)


class ThompsonSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of Thompson sampling."""

    block: str = ""  # the block whose share of successful episodes is the reward; "" for all blocks
    prior: tuple[float, float] = (1.0, 1.0)  # each group's successes and failures before the first participant


class Thompson(EnrolmentDesign):
    """Thompson sampling (Thompson, 1933, Biometrika 25): groups with more success get more participants.

    Each group's probability of success has a beta distribution. A participant's proportion of successes counts as that
    fraction of a success.
    """

    outcome = "success"

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = read_design_settings(settings, ThompsonSettings)
        self.block = self.settings.block
        require_setting(min(self.settings.prior) > 0, f"prior is {list(self.settings.prior)}; use two above 0")

    def compute_statistics(self, enrolled: Sequence[EnrolledParticipant], groups: Mapping[str, int]) -> dict[str, Any]:
        """Return, by group, the sums of its participants' proportions of successes and of failures."""
        sums = {}
        for group in groups:
            successes: float = 0
            failures: float = 0
            for participant in enrolled:
                if participant.group == group and participant.value is not None:
                    successes += participant.value
                    failures += 1 - participant.value
            sums[group] = [round_estimate(successes), round_estimate(failures)]
        return sums

    def decide(self, statistics: Mapping[str, Any], stratum: str, draw: Draw) -> EnrolmentDecision:
        """Draw a probability of success from each group's beta distribution, and choose the group with the highest."""
        from scipy.special import betaincinv  # imported here, since only an enrolment needs SciPy

        prior = self.settings.prior
        chances = dict[str, float]()
        draws = dict[str, float]()
        for (group, (successes, failures)), share in zip(statistics.items(), draw(len(statistics)), strict=True):
            alpha = prior[0] + successes
            beta = prior[1] + failures
            chances[group] = round_estimate(alpha / (alpha + beta))
            draws[group] = round(float(betaincinv(alpha, beta, share)), _COMPARED_DIGITS)
        return EnrolmentDecision(max(draws, key=lambda group: draws[group]), estimates=chances)


class GroupSequentialSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of a group-sequential study."""

    looks: tuple[int, ...]  # the number of complete participants at each look; the last look ends the study
    outcome: Literal["success", "reward", "steps", "log_steps"] = "success"
    block: str = ""  # the block whose episodes count; "" for all blocks
    alpha: float = 0.05  # two-sided, of the whole study


class GroupSequential(EnrolmentDesign):
    """Group-sequential stopping for a difference between two groups at planned looks.

    Alpha is spent by an O'Brien-Fleming-type function (Lan & DeMets, 1983). A look compares the first complete
    participants, as many as planned for it, by Welch's test.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = read_design_settings(settings, GroupSequentialSettings)
        self.block = self.settings.block
        self.outcome = self.settings.outcome
        looks = list(self.settings.looks)
        alpha = self.settings.alpha
        is_rising = looks == sorted(set(looks))
        is_large_enough = len(looks) > 0 and looks[0] >= _MIN_PARTICIPANTS_AT_LOOK
        require_setting(
            is_rising and is_large_enough, f"looks is {looks}; use rising numbers of participants from 4 on"
        )
        require_setting(0 < alpha < 0.5, f"alpha is {alpha:g}; use 0.05")

    def compute_statistics(self, enrolled: Sequence[EnrolledParticipant], groups: Mapping[str, int]) -> dict[str, Any]:
        """Return the number of the latest look, and the n, mean and variance of both groups' outcomes up to it."""
        complete = [participant for participant in enrolled if participant.value is not None]
        reached = [look for look in self.settings.looks if look <= len(complete)]
        participants_at_look = complete[: reached[-1]] if reached else []
        return {"look": len(reached)} | {
            group: _summarize_group(participants_at_look, group) for group in list(groups)[:2]
        }

    def decide(self, statistics: Mapping[str, Any], stratum: str, draw: Draw) -> EnrolmentDecision:
        """Stop if the difference exceeds the look's boundary or the last look has been taken."""
        from minihuman.experiment.plan.group_sequential import compute_adjusted_p, compute_welch_z, find_boundaries

        looks = self.settings.looks
        look = int(statistics["look"])
        if not look:
            return EnrolmentDecision()
        fractions = [n_participants / looks[-1] for n_participants in looks]
        boundaries = find_boundaries(fractions, self.settings.alpha)
        boundary = boundaries[look - 1]
        first, second = (statistic for name, statistic in statistics.items() if name != "look")
        z = round_estimate(compute_welch_z(first, second))
        is_crossed = abs(z) >= boundary
        estimates = {
            "look": look,
            "z": z,
            "boundary": round_estimate(boundary),
            "p": round_estimate(compute_adjusted_p(z, fractions[:look], boundaries)),
            "crossed": float(is_crossed),
        }
        is_last_look = look == len(looks)
        return EnrolmentDecision("", is_crossed or is_last_look, estimates)


def _summarize_group(enrolled: Sequence[EnrolledParticipant], group: str) -> list[float]:
    """Return the number, mean and variance (0 for fewer than two) of the outcomes of a group's participants."""
    group_outcomes = [participant.value for participant in enrolled if participant.group == group]
    outcomes = [outcome for outcome in group_outcomes if outcome is not None]
    mean = np.mean(outcomes or [0.0])
    variance = np.var(outcomes, ddof=1) if len(outcomes) > 1 else 0.0
    return [len(outcomes), round_estimate(float(mean)), round_estimate(float(variance))]
