"""What the statistics leave out: the reviewers' tags, episodes not played to an end, and the protocol's own rules."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from minihuman.data.columns import EPISODES, NEED_WORLD, PARTICIPANTS
from minihuman.errors import ReportError
from minihuman.recorded.episode import CUT_OFF
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Exclusion, decode

UNFINISHED_OUTCOMES = ("abandoned", CUT_OFF)
UNFINISHED = "not played to an end"
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
    exclusions = decode(protocol_toml, source).exclusions
    check_measures(exclusions, source)
    return exclusions


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules in force for one study, in the order in which they are tried."""

    protocol: tuple[Exclusion, ...] = ()
    only: frozenset[str] = frozenset()
    without: frozenset[str] = frozenset()

    @classmethod
    def of(cls, plan: SessionPlan, *, only: Iterable[str] = (), without: Iterable[str] = ()) -> "Rules":
        """The rules of a session's own protocol, and the tags asked for.

        Raises:
            ReportError: if a rule names a column that its table does not have.
            ProtocolError: if the protocol in the log cannot be understood.
        """
        exclusions = _exclusions(plan.protocol_toml, f"the protocol of {plan.study}") if plan.protocol_toml else ()
        return cls(exclusions, frozenset(only), frozenset(without))

    @property
    def need_world(self) -> bool:
        """Whether a rule asks for a measure that only the world itself can tell."""
        return any(rule.measure in NEED_WORLD for rule in self.protocol)

    def episode(self, row: Mapping[str, Any]) -> str:
        """Why an episode's row does not count; empty if it does."""
        tags = set(row["tags"].split())
        if self.only and not tags & self.only:
            return f"not tagged {' or '.join(sorted(self.only))}"
        if tags & self.without:
            return f"tagged {' '.join(sorted(tags & self.without))}"
        if row["outcome"] in UNFINISHED_OUTCOMES:
            return UNFINISHED
        return self._broken("episode", row)

    def participant(self, row: Mapping[str, Any]) -> str:
        """Why a participant's row does not count; empty if it does."""
        return "no episode counts" if not row["episodes"] else self._broken("participant", row)

    def _broken(self, level: str, row: Mapping[str, Any]) -> str:
        for rule in self.protocol:
            value = row.get(rule.measure)
            if rule.level == level and value is not None and _outside(float(value), rule):
                return rule.reason
        return ""


def _outside(value: float, rule: Exclusion) -> bool:
    return (rule.below is not None and value < rule.below) or (rule.above is not None and value > rule.above)
