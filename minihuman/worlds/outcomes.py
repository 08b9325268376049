"""Outcome rules: what the end of an episode means. This is the one place that says so.

A rule is a text of conditions, all of which success needs: ``info:is_success``, ``return >= 195``, ``reward > 0``,
``terminated``, joined by "and"; or one word, ``world`` (what the world says) or ``none`` (unknown). It is read at
the last step, or at every step where it ends in "at any step". What a rule cannot tell is unknown, never guessed.
"""

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal, Protocol

from minihuman.errors import ProtocolError

EpisodeOutcome = Literal["goal", "timeout", "failure", "ended"]

OUTCOME_RULES = 1  # of a session's plan: an end means what a rule says; 0: every world's, what its last reward says

LAST_REWARD = ""  # the rule of our own worlds, and of every world in plans from before there were others
WORLD_RULE = "world"
NO_RULE = "none"
INFO_PREFIX = "info:"
WORLD_KEYS = ("is_success", "success")  # of a world's ``info``, in this order
_LAST_REWARD_TEXT = "terminated and reward > 0"
_AT_ANY_STEP = " at any step"
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
    """What a rule may look at of a step."""

    @property
    def reward(self) -> float:
        """Return the step's reward."""

    @property
    def return_(self) -> float:
        """Return the sum of rewards so far."""

    @property
    def terminated(self) -> bool:
        """Return whether the world ended the episode."""

    @property
    def truncated(self) -> bool:
        """Return whether a limit ended the episode."""

    @property
    def success(self) -> bool | None:
        """Return what the world says of success; None where it says nothing, or was not asked."""


@dataclass(frozen=True, slots=True)
class StepFacts:
    """What a rule looks at, where a step is made without a session."""

    reward: float
    return_: float
    terminated: bool
    truncated: bool
    success: bool | None


Condition = Callable[[JudgedStep], bool | None]


@dataclass(frozen=True, slots=True)
class OutcomeRule:
    """A rule, parsed.

    Args:
        conditions: whose conjunction is success; none where success is never known.
        info_key: the key of ``info`` that it asks for, with dots where dictionaries are nested; "" for none.
        asks_world: whether it asks for what the world says, by that key or by those that are usual.
        at_any_step: whether one step is enough.
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
        """Return whether a step is success; None if that is not known. A condition that fails settles it."""
        if not self.conditions:
            return None
        answers = [condition(step) for condition in self.conditions]
        if False in answers:
            return False
        return None if None in answers else True


class OutcomeJudge:
    """Judges an episode's steps as they come.

    Args:
        rule: as `parse_outcome_rule` takes it.
    """

    def __init__(self, rule: str) -> None:
        self.rule = parse_outcome_rule(rule)
        self._was_reached = False
        self._success: bool | None = None if self.rule.may_be_unknown else False  # before any step

    def judge_step(self, step: JudgedStep) -> EpisodeOutcome | None:
        """Return the outcome if the step ended the episode, else None."""
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
        if self._was_reached or self._success:
            return "goal"
        if self._success is None:
            return "ended"
        return otherwise


@cache
def parse_outcome_rule(text: str) -> OutcomeRule:
    """Parse a rule as a plan has it.

    Raises:
        ProtocolError: if it is none.
    """
    at_any_step = text.endswith(_AT_ANY_STEP)
    words = text.removesuffix(_AT_ANY_STEP) or _LAST_REWARD_TEXT
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
    """Return a protocol's rule as plans have it: one text for one meaning.

    Raises:
        ProtocolError: if it is no rule.
    """
    words = " ".join(success.split())
    parts = [_normalize_condition(part.strip()) for part in words.split(" and ")]
    text = " and ".join(dict.fromkeys(parts))
    if text == WORLD_RULE or not text:
        raise ProtocolError(f"is {success!r}; use {_EXAMPLES}, or leave it out")
    parse_outcome_rule(text)
    if {*parts} == {*_LAST_REWARD_TEXT.split(" and ")}:
        text = LAST_REWARD
    else:
        text = text
    if at_any_step:
        return add_any_step(text)
    return text


def add_any_step(rule: str) -> str:
    """Return a rule that is read at every step."""
    return (rule or _LAST_REWARD_TEXT) + _AT_ANY_STEP


def _normalize_condition(text: str) -> str:
    match = _COMPARISON.fullmatch(text)
    if match is None:
        return text
    return f"{match[1]} {match[2]} {float(match[3]):g}"


def _parse_condition(text: str) -> Condition:
    if text == "terminated":
        return _is_terminated
    if text == WORLD_RULE or (text.startswith(INFO_PREFIX) and re.fullmatch(r"[^\s.]+(\.[^\s.]+)*", text[5:])):
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
