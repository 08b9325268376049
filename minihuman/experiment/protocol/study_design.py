"""The design of a study as one value: factors between and within participants, primary effect and contrasts.

It is derived from the protocol alone. The report, its figures and scripts, power and preregistration are functions of
it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import Literal

from minihuman.experiment.protocol.design_spec import PrimaryEffect, name_conditions
from minihuman.experiment.protocol.model import Protocol
from minihuman.experiment.protocol.strata import build_strata

FactorName = Literal["group", "stratum", "condition", "session", "order"]


@dataclass(frozen=True, slots=True)
class Factor:
    """A factor and its levels, in the order in which they are compared."""

    name: FactorName
    levels: tuple[str, ...]
    is_within: bool  # whether each participant has several of its levels


@dataclass(frozen=True, slots=True)
class Contrast:
    """A weighted sum of conditions with weights that sum to 0."""

    name: str
    weights: tuple[tuple[str, float], ...]  # conditions and their weights


@dataclass(frozen=True, slots=True)
class ExperimentDesign:
    """The factors that a study varies, and the question that it asks."""

    factors: tuple[Factor, ...] = ()
    question: str = ""  # as the protocol states it; "" if it does not
    primary_effect: PrimaryEffect = ""  # "" if nothing is compared
    condition_of_block: tuple[tuple[str, str], ...] = ()  # names of blocks and their conditions
    contrasts: tuple[Contrast, ...] = ()  # those that the protocol states
    condition_label: str = ""  # the label of trials whose levels, which are in the data, are the conditions

    def levels(self, name: FactorName) -> tuple[str, ...]:
        """Return the levels of a factor; empty if the design does not have the factor."""
        return next((factor.levels for factor in self.factors if factor.name == name), ())

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the levels of the factor "condition", which is compared within participants."""
        return self.levels("condition")

    def add_levels(self, levels: Sequence[str]) -> "ExperimentDesign":
        """Return the design with levels of its label of trials as conditions; unchanged if there are fewer than two."""
        if len(levels) < 2:
            return self
        return replace(
            self,
            factors=(*self.factors, Factor("condition", tuple(levels), is_within=True)),
            condition_of_block=tuple((level, level) for level in levels),
        )

    @property
    def is_mixed(self) -> bool:
        """Return whether the design compares both groups and conditions."""
        return bool(self.levels("group") and self.conditions)

    @property
    def tested_contrasts(self) -> tuple[Contrast, ...]:
        """Return the protocol's contrasts; if it has none, each pair of conditions, the first minus the second."""
        if self.contrasts:
            return self.contrasts
        return tuple(
            Contrast(f"{first} \N{MINUS SIGN} {second}", ((first, 1.0), (second, -1.0)))
            for first, second in combinations(self.conditions, 2)
        )


def derive_design(protocol: Protocol) -> ExperimentDesign:
    """Return a study's factors, primary effect and contrasts, as they follow from its protocol."""
    conditions = protocol.analysis.conditions
    if protocol.analysis.condition_label:  # its levels are in trials, not in blocks
        conditions = ()
    options_of_block = {block.name: block.options for block in protocol.blocks}
    condition_of_block = name_conditions(protocol.design.condition, conditions, options_of_block)
    candidates = (
        _find_groups(protocol),
        _find_strata(protocol),
        _find_conditions(condition_of_block),
        _find_sessions(protocol),
        _find_orders(protocol, condition_of_block),
    )
    factors = tuple(factor for factor in candidates if factor is not None)
    names = {factor.name for factor in factors}
    if protocol.analysis.condition_label:
        names.add("condition")
    primary_effect = protocol.design.primary_effect or _choose_effect(names)
    contrasts = [Contrast(contrast.name, tuple(contrast.weights.items())) for contrast in protocol.design.contrasts]
    return ExperimentDesign(
        factors=factors,
        question=protocol.design.question.strip(),
        primary_effect=primary_effect,
        condition_of_block=tuple(condition_of_block.items()),
        contrasts=tuple(contrasts),
        condition_label=protocol.analysis.condition_label,
    )


def _choose_effect(names: set[FactorName]) -> PrimaryEffect:
    """Return the primary effect of a design with the given factors; "" if it has neither groups nor conditions."""
    if {"group", "condition"} <= names:
        return "interaction"
    if "condition" in names:
        return "conditions"
    if "group" in names:
        return "groups"
    return ""


def _find_groups(protocol: Protocol) -> Factor | None:
    names = tuple(group.name for group in protocol.groups)
    if len(names) > 1:
        return Factor("group", names, is_within=False)
    return None


def _find_strata(protocol: Protocol) -> Factor | None:
    strata = build_strata(protocol)
    if strata is not None:
        return Factor("stratum", strata.names, is_within=False)
    return None


def _find_conditions(condition_of_block: Mapping[str, str]) -> Factor | None:
    levels = tuple(dict.fromkeys(condition_of_block.values()))
    if len(levels) > 1:
        return Factor("condition", levels, is_within=True)
    return None


def _find_sessions(protocol: Protocol) -> Factor | None:
    names = tuple(session.name for session in protocol.sessions)
    if len(names) > 1:
        return Factor("session", names, is_within=True)
    return None


def _find_orders(protocol: Protocol, condition_of_block: Mapping[str, str]) -> Factor | None:
    """Return the factor of the orders in which conditions are played; None if all participants have the same order."""
    names = []
    for order in protocol.orders:
        parts = chain.from_iterable(order.units)
        if order.order != "fixed" and any(part in condition_of_block for part in parts):
            names.append(order.name)
    if names:
        return Factor("order", tuple(names), is_within=False)
    return None
