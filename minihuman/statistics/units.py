"""The unit of analysis: a participant, or a team.

What members of one team did is not independent, so a team has one value, the mean over its members, and tests over
participants become tests over teams: the permutation of |Welch's t| then regroups whole teams.
"""

from collections.abc import Mapping

import pandas as pd


def find_units(teams: pd.DataFrame) -> dict[str, str]:
    """Return the unit of each participant who ever played with another person: all whom a chain of teams connects.

    Args:
        teams: rows of the table "teams" of one block, with participant and team.

    Returns:
        By participant, the unit's name: the id of one of its teams. Participants whose partners were agents are
        units of their own, and left out.
    """
    units: dict[str, str] = {}
    for team, rows in teams.groupby("team", sort=True):
        members = sorted(set(rows["participant"]))
        if len(members) < 2:
            continue
        joined = {units[member] for member in members if member in units}
        units |= {member: str(team) for member, unit in tuple(units.items()) if unit in joined}
        units |= dict.fromkeys(members, str(team))
    return units


def name_units(rows: pd.DataFrame, units: Mapping[str, str]) -> pd.DataFrame:
    """Put each row's unit in the place of its participant, so that what clusters by participant clusters by team."""
    return rows.assign(participant=rows["participant"].map(lambda code: units.get(str(code), str(code))))
