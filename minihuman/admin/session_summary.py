"""A session in one row: what its log says of who, how far and how long, as the session index keeps it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SessionSummary:
    """A session summed up in one row. Counts are of all its segments together."""

    study: str
    participant: str
    group: str
    session: int
    player: str
    started_at: str  # ISO 8601 UTC
    segments: int
    clean: bool
    end_reason: str  # an EndReason, or "cut_off"
    episodes_planned: int  # less those that were skipped
    episodes_completed: int  # with an outcome other than abandoned
    steps: int
    duration_s: float  # from a segment's start to its last message, summed
    complete: bool  # it said so, or nothing was left to do but to read last words
