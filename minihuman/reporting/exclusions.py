"""Exclusion of participants for whom only practice is left, and the list of all excluded rows."""

from collections import Counter

import numpy as np
import pandas as pd

from minihuman.reporting.template import to_records

PRACTICE_ALONE = "only practice was played"


def exclude_practice_alone(participants: pd.DataFrame) -> pd.DataFrame:
    """Return the table of participants with a reason to exclude those of whom only practice is included.

    Participants whose sessions planned no episodes are kept.
    """
    is_included = participants["exclusion_reason"].isna()
    is_kept = (participants["episodes"] > 0) | participants["completed_share"].isna()  # no share: none was planned
    codes = participants.loc[is_included & is_kept, "participant"]
    has_practice_alone = is_included & ~participants["participant"].isin(codes)
    reasons = participants["exclusion_reason"].mask(has_practice_alone, PRACTICE_ALONE)
    return participants.assign(exclusion_reason=reasons)


def list_exclusion_reasons(participants: pd.DataFrame) -> dict[str, str]:
    """Return, by participant, the exclusion reason of the first session; "" if any of the sessions is included."""
    reasons: dict[str, str] = {}
    for row in to_records(participants):
        code = str(row["participant"])
        if pd.isna(row["exclusion_reason"]):
            reasons[code] = ""
        else:
            reasons.setdefault(code, str(row["exclusion_reason"]))
    return reasons


def count_excluded(participants: pd.DataFrame) -> dict[str, int]:
    """Count the participants of whom no session is included, by reason."""
    return dict(Counter(reason for reason in list_exclusion_reasons(participants).values() if reason))


def list_exclusions(episodes: pd.DataFrame, participants: pd.DataFrame) -> pd.DataFrame:
    """List the excluded sessions with their reasons, then the excluded episodes of all other sessions.

    The columns are exclusion_reason, level, participant, session, and episode and attempt if it is an episode. The
    level of an excluded session is "session" if another session of the participant is included, else "participant".
    """
    people = participants.loc[participants["exclusion_reason"].notna(), ["exclusion_reason", "participant", "session"]]
    included = participants.loc[participants["exclusion_reason"].isna(), "participant"]
    people = people.assign(level=np.where(people["participant"].isin(included), "session", "participant"))
    excluded_sessions = set(zip(people["exclusion_reason"], people["participant"], people["session"], strict=True))
    rows = episodes.loc[
        episodes["exclusion_reason"].notna(), ["exclusion_reason", "participant", "session", "episode", "attempt"]
    ]
    session_keys = zip(rows["exclusion_reason"], rows["participant"], rows["session"], strict=True)
    is_single = np.array([key not in excluded_sessions for key in session_keys], bool)
    rows = rows[is_single].assign(level="episode")
    exclusions = pd.concat([people.astype(object), rows.astype(object)], ignore_index=True)
    return exclusions.reindex(columns=["exclusion_reason", "level", "participant", "session", "episode", "attempt"])
