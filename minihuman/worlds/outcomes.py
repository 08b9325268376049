"""Outcome rules: the meaning of an episode's end. No other module defines it.

A rule is a text of conditions that are all necessary for success: ``info:is_success``, ``return >= 195``,
``reward > 0``, ``terminated``, joined by "and"; or a single word, ``world`` (the world decides) or ``none`` (unknown).
A rule applies to the last step, or to every step if it ends in "at any step". An outcome that the rule cannot determine
is unknown, never guessed.
"""

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal, Protocol

from minihuman.errors import ProtocolError

EpisodeOutcome = Literal["goal", "timeout", "failure", "ended"]

OUTCOME_RULES = 1  # the version in a session's plan: 1 if a rule decides, 0 if the last reward decides in every world

LAST_REWARD = ""  # the rule of our own worlds, and of every world in plans that are older than the other rules
WORLD_RULE = "world"
NO_RULE = "none"
INFO_PREFIX = "info:"
WORLD_KEYS = ("is_success", "success")  # the usual keys of a world's ``info``, the first of which counts
_LAST_REWARD_TEXT = "terminated and reward > 0"
AT_ANY_STEP = " at any step"
_COMPARISON = re.compile(r"(return|reward) *(>=|<=|>|<|==) *(-?\d+(?:\.\d+)?(?:e-?\d+)?)")
_OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}
_EXAMPLES = '"info:is_success", "return >= 195", "terminated and reward > 0", "terminated" or "none"'


class JudgedStep(Protocol):
    """The properties of a step that an outcome rule may read."""

    @property
    def reward(self) -> float:
        """Return the step's reward."""

    @property
    def return_(self) -> float:
        """Return the sum of the episode's rewards so far."""

    @property
    def terminated(self) -> bool:
        """Return whether the world ended the episode."""

    @property
    def truncated(self) -> bool:
        """Return whether a limit ended the episode."""

    @property
    def success(self) -> bool | None:
        """Return whether the world reports success; None if it reports nothing, or was not asked."""


@dataclass(frozen=True, slots=True)
class StepFacts:
    """The properties of a step that an outcome rule reads, for steps outside a session."""

    reward: float
    return_: float
    terminated: bool
    truncated: bool
    success: bool | None


Condition = Callable[[JudgedStep], bool | None]


@dataclass(frozen=True, slots=True)
class OutcomeRule:
    """A parsed outcome rule.

    Args:
        conditions: the conditions that must all hold for success; empty if success is never known.
        info_key: the key of ``info`` that the rule reads, with dots between nested keys; "" for none.
        asks_world: whether the rule reads what the world reports, under ``info_key`` or one of the usual keys.
        at_any_step: whether success at one step is enough.
    """

    conditions: tuple[Condition, ...]
    info_key: str = ""
    asks_world: bool = False
    at_any_step: bool = False

    @property
    def may_be_unknown(self) -> bool:
        """Return whether an episode can end without a known outcome."""
        return self.asks_world or not self.conditions

    def find_success(self, step: JudgedStep) -> bool | None:
        """Return whether a step is a success, or None if that is unknown.

        One condition that fails makes the answer False, even if another is unknown.
        """
        if not self.conditions:
            return None
        answers = [condition(step) for condition in self.conditions]
        if False in answers:
            return False
        return None if None in answers else True


class OutcomeJudge:
    """A judge that applies an outcome rule to the steps of an episode, one after another.

    Args:
        rule: the rule's text, as `parse_outcome_rule` takes it.
    """

    def __init__(self, rule: str) -> None:
        self.rule = parse_outcome_rule(rule)
        self._was_reached = False
        self._success: bool | None = None if self.rule.may_be_unknown else False  # before any step

    def judge_step(self, step: JudgedStep) -> EpisodeOutcome | None:
        """Judge the next step; return the episode's outcome if the step ended it, else None."""
        self._success = self.rule.find_success(step)
        if self.rule.at_any_step:
            self._was_reached |= self._success is True
        if not step.terminated and not step.truncated:
            return None
        return self._name_outcome(otherwise="failure" if step.terminated else "timeout")

    def judge_time_limit(self) -> EpisodeOutcome:
        """Return the outcome of an episode that a time limit ends after the steps so far."""
        return self._name_outcome(otherwise="timeout")

    def _name_outcome(self, otherwise: EpisodeOutcome) -> EpisodeOutcome:
        """Return "goal" after success, "ended" if success is unknown, and ``otherwise`` without success."""
        if self._was_reached or self._success:
            return "goal"
        if self._success is None:
            return "ended"
        return otherwise


@cache
def parse_outcome_rule(text: str) -> OutcomeRule:
    """Parse the text of a rule in the form in which plans store it.

    Raises:
        ProtocolError: if the text is not a rule.
    """
    at_any_step = text.endswith(AT_ANY_STEP)
    words = text.removesuffix(AT_ANY_STEP) or _LAST_REWARD_TEXT
    if words == NO_RULE:
        return OutcomeRule((), at_any_step=at_any_step)
    parts = [part.strip() for part in words.split(" and ")]
    if WORLD_RULE in parts and len(parts) > 1:
        raise ProtocolError(f"is {text!r}; {WORLD_RULE!r} stands alone")
    keys = [part.removeprefix(INFO_PREFIX) for part in parts if part.startswith(INFO_PREFIX)]
    if len(keys) > 1:
        raise ProtocolError(f"is {text!r}; name one key of info")
    return OutcomeRule(
        tuple(_parse_condition(part) for part in parts),
        info_key=keys[0] if keys else "",
        asks_world=bool(keys) or WORLD_RULE in parts,
        at_any_step=at_any_step,
    )


def normalize_outcome_rule(success: str, *, at_any_step: bool) -> str:
    """Return a protocol's rule in the form in which plans store it, in which rules of equal meaning have equal texts.

    Raises:
        ProtocolError: if the text is not a rule.
    """
    words = " ".join(success.split())
    parts = [_normalize_condition(part.strip()) for part in words.split(" and ")]
    text = " and ".join(dict.fromkeys(parts))
    if text == WORLD_RULE or not text:
        raise ProtocolError(f"is {success!r}; use {_EXAMPLES}, or leave it out")
    parse_outcome_rule(text)
    if {*parts} == {*_LAST_REWARD_TEXT.split(" and ")}:
        text = LAST_REWARD
    if at_any_step:
        return add_any_step(text)
    return text


def add_any_step(rule: str) -> str:
    """Return the text of a rule extended so that it applies to every step."""
    return (rule or _LAST_REWARD_TEXT) + AT_ANY_STEP


def _normalize_condition(text: str) -> str:
    """Return a comparison with single spaces and a plain number; any other condition unchanged."""
    match = _COMPARISON.fullmatch(text)
    if match is None:
        return text
    return f"{match[1]} {match[2]} {float(match[3]):g}"


def _parse_condition(text: str) -> Condition:
    """Return a condition as a function of a step; raise a ProtocolError for an unknown one."""
    if text == "terminated":
        return _is_terminated
    key = text.removeprefix(INFO_PREFIX)
    if text == WORLD_RULE or (text.startswith(INFO_PREFIX) and re.fullmatch(r"[^\s.]+(\.[^\s.]+)*", key)):
        return _is_success
    match = _COMPARISON.fullmatch(text)
    if match is None:
        raise ProtocolError(f"has {text!r}, which is no condition; use {_EXAMPLES}")
    quantity = match[1]
    compare = _OPERATORS[match[2]]
    bound = float(match[3])
    if quantity == "return":
        return lambda step: compare(step.return_, bound)
    return lambda step: compare(step.reward, bound)


def _is_terminated(step: JudgedStep) -> bool:
    return step.terminated


def _is_success(step: JudgedStep) -> bool | None:
    return step.success
