"""A session in one row: the participant, progress and duration according to its log, as stored in the session index."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SessionSummary:
    """A session summarized in one row. Counts are over all its segments."""

    study: str
    participant: str
    group: str
    session: int
    player: str
    started_at: str  # ISO 8601 UTC
    segments: int
    clean: bool
    end_reason: str  # an EndReason, or "cut_off"
    episodes_planned: int  # without skipped ones
    episodes_completed: int  # with an outcome other than abandoned
    steps: int
    duration_s: float  # from a segment's start to its last message, summed
    complete: bool  # whether it ended as complete, or only closing pages were left
