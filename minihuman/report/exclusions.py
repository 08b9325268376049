"""What the statistics leave out: the reviewers' tags, episodes not played to an end, and the protocol's own rules."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from minihuman.errors import ReportError
from minihuman.report.columns import EPISODES, PARTICIPANTS
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Exclusion, decode

UNFINISHED_OUTCOMES = ("abandoned", "cut off")
UNFINISHED = "not played to an end"
_COLUMNS = {"episode": EPISODES, "participant": PARTICIPANTS}


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
        exclusions = (
            decode(plan.protocol_toml, f"the protocol of {plan.study}").exclusions if plan.protocol_toml else ()
        )
        for rule in exclusions:
            known = [column.name for column in _COLUMNS[rule.level] if column.kind in ("whole", "number", "yes_no")]
            if rule.measure not in known:
                raise ReportError(
                    f"the exclusion {rule.reason!r} asks for {rule.level} measure {rule.measure!r}; "
                    f"there are {', '.join(known)}"
                )
        return cls(exclusions, frozenset(only), frozenset(without))

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
