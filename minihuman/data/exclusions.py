"""The protocol's own rules: which episodes, and which participants, its statistics are to leave out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from minihuman.data.columns import EPISODES, NEED_WORLD, PARTICIPANTS
from minihuman.errors import ReportError
from minihuman.recorded.episode import CUT_OFF
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Exclusion, decode_logged

UNFINISHED_OUTCOMES = ("abandoned", CUT_OFF)
_COLUMNS = {"episode": EPISODES, "participant": PARTICIPANTS}


def check_measures(exclusions: Sequence[Exclusion], source: str) -> None:
    """Check that every rule asks for a measure there is; ``source`` names the protocol in the error.

    Raises:
        ReportError: one line with source, path and the measures there are.
    """
    for number, rule in enumerate(exclusions):
        known = [column.name for column in _COLUMNS[rule.level] if column.kind in ("whole", "number", "yes_no")]
        if rule.measure not in known:
            raise ReportError(
                f"{source}: $.exclusions[{number}].measure is {rule.measure!r}, no measure of "
                f"{'an episode' if rule.level == 'episode' else 'a participant'}; there are {', '.join(known)}"
            )


@lru_cache(maxsize=16)
def _exclusions(protocol_toml: bytes, source: str) -> tuple[Exclusion, ...]:
    exclusions = decode_logged(protocol_toml, source).exclusions
    check_measures(exclusions, source)
    return exclusions


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule of a protocol's own."""

    exclusion: Exclusion

    @property
    def needs_world(self) -> bool:
        """Whether it asks for a measure that only the world itself can tell."""
        return self.exclusion.measure in NEED_WORLD

    def broken_by(self, row: Mapping[str, Any]) -> bool:
        """Whether a row's measure lies outside what the rule allows; a measure that nothing tells does not."""
        value, rule = row.get(self.exclusion.measure), self.exclusion
        if value is None:
            return False
        return (rule.below is not None and value < rule.below) or (rule.above is not None and value > rule.above)


def rules_of(plan: SessionPlan) -> tuple[Rule, ...]:
    """The rules of a session's own protocol, in the order in which they are tried.

    Raises:
        ReportError: if a rule names a column that its table does not have.
        ProtocolError: if the protocol in the log cannot be understood.
    """
    if not plan.protocol_toml:
        return ()
    return tuple(Rule(one) for one in _exclusions(plan.protocol_toml, f"the protocol of {plan.study}"))


def broken_rule(rules: Sequence[Rule], level: str, row: Mapping[str, Any]) -> str:
    """The reason of the first rule that an episode's or a participant's row breaks; "" if it breaks none."""
    return next((rule.exclusion.reason for rule in rules if rule.exclusion.level == level and rule.broken_by(row)), "")
