"""The sentences of the methods section on who took part and who was lost, from the participant flow."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from minihuman.admin.enrolment_flow import GroupCounts, ParticipantFlow
from minihuman.dataset.recording_quality import PlanOutline


@dataclass(frozen=True, slots=True)
class Attrition:
    """Counts of the participants who took part, including those whose data were erased, and of the losses."""

    groups: GroupCounts  # who took part
    sessions: Mapping[int, int]  # how many took part in each session
    withdrew: GroupCounts  # of those who took part
    lost: GroupCounts  # of those who took part: no log of theirs can be read
    flow: ParticipantFlow | None
    is_whole: bool  # the report is of all sessions that can be read

    @classmethod
    def of(cls, plans: Sequence[PlanOutline], flow: ParticipantFlow | None) -> "Attrition":
        """Count participants and losses from the sessions' plans and the flow.

        A participant who withdrew has no plan. A report on some of a study's sessions does not count these among those
        who took part, because it is not known which versions of the protocol they played.
        """
        groups = Counter({plan.participant: plan.group for plan in plans}.values())
        sessions = Counter(plan.session for plan in plans)
        is_whole = flow is not None and (flow.analysis is None or not sum(flow.analysis.not_selected.values()))
        withdrew = Counter[str]()
        lost = Counter[str]()
        if is_whole and flow is not None and flow.analysis is not None:
            lost.update(flow.analysis.unreadable)
        if flow is not None:
            for session, course in flow.courses.items():
                withdrew.update(course.withdrew)
                if is_whole:
                    n_withdrew = sum(course.withdrew.values())  # they began this session last, and all before it
                    sessions.update(dict.fromkeys(range(1, session + 1), n_withdrew))
                    sessions[session] += sum(course.lost.values())
        if is_whole:
            groups.update(withdrew + lost)
        counted_sessions = {session: count for session, count in sessions.items() if count}
        return cls(groups, counted_sessions, withdrew, lost, flow, is_whole)

    def describe(self) -> str:
        """Return a sentence for each kind of loss that occurred, each followed by a space; "" if there was none."""
        if self.flow is None:
            return ""
        return "".join(f"{sentence} " for sentence in self._list_sentences(self.flow))

    def _list_sentences(self, flow: ParticipantFlow) -> Iterator[str]:
        """Yield a sentence for each kind of loss that occurred."""
        if flow.before:
            losses = ", ".join(f"{count} {label}" for label, count in flow.before.items())
            n_allocated = sum(flow.allocated.values())
            yield f"Of {flow.came} people who came to the study, {n_allocated} were allocated to a group ({losses})."
        if self.withdrew:
            of_whom = "Of these participants" if self.is_whole else "Of all participants of the study"
            yield (
                f"{of_whom}, {_count_by_group(self.withdrew)} withdrew after they had begun: no result contains their "
                "data."
            )
        if self.lost:
            yield f"No log of {_count_by_group(self.lost)} can be read: no result contains their data."
        n_before = sum(sum(course.withdrew_before.values()) for course in flow.courses.values())
        if n_before:
            yield f"Withdrawn with no session on record: {n_before}."
        if sum(flow.replaced.values()):
            yield f"Slots offered again, the data of their participants kept: {_count_by_group(flow.replaced)}."


def _count_by_group(counts: GroupCounts) -> str:
    """Return the total count and the count of each group as text."""
    groups = ", ".join(f"{count} in group {group}" for group, count in sorted(counts.items()))
    return f"{sum(counts.values())} ({groups})"
