"""Exclusion of participants for whom only practice is left, and the list of all excluded rows."""

import numpy as np
import pandas as pd

PRACTICE_ALONE = "only practice was played"


def exclude_practice_alone(participants: pd.DataFrame) -> pd.DataFrame:
    """Exclude the participants for whom only practice is included; participants who had nothing to play are kept."""
    is_included = participants["exclusion_reason"].isna()
    played = (participants["episodes"] > 0) | participants["completed_share"].isna()
    players = participants.loc[is_included & played, "participant"]
    practice_only = is_included & ~participants["participant"].isin(players)
    return participants.assign(exclusion_reason=participants["exclusion_reason"].mask(practice_only, PRACTICE_ALONE))


def list_exclusions(episodes: pd.DataFrame, participants: pd.DataFrame) -> pd.DataFrame:
    """List every excluded row with its reason: participants first, then the episodes of the others.

    The level of an excluded session is "session" if another session of the participant is included, else "participant".
    """
    people = participants.loc[participants["exclusion_reason"].notna(), ["exclusion_reason", "participant", "session"]]
    included = participants.loc[participants["exclusion_reason"].isna(), "participant"]
    people = people.assign(level=np.where(people["participant"].isin(included), "session", "participant"))
    excluded_sessions = set(zip(people["exclusion_reason"], people["participant"], people["session"], strict=True))
    single = episodes.loc[
        episodes["exclusion_reason"].notna(), ["exclusion_reason", "participant", "session", "episode", "attempt"]
    ]
    session_keys = zip(single["exclusion_reason"], single["participant"], single["session"], strict=True)
    single = single[np.array([key not in excluded_sessions for key in session_keys], bool)].assign(level="episode")
    exclusions = pd.concat([people.astype(object), single.astype(object)], ignore_index=True)
    return exclusions.reindex(columns=["exclusion_reason", "level", "participant", "session", "episode", "attempt"])
