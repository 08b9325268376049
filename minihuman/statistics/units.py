"""The unit of analysis: a participant or a team.

The behaviour of a team's members is not independent. A team therefore has one value, the mean over its members, and
tests over participants become tests over teams: the permutation of |Welch's t| regroups whole teams.
"""

from collections.abc import Mapping

import pandas as pd


def find_units(teams: pd.DataFrame) -> dict[str, str]:
    """Return the unit of analysis of each participant who ever played with another person.

    A unit contains all people who are connected by a chain of teams. A participant whose partners were all agents is a
    unit alone and is omitted.

    Args:
        teams: rows of the table "teams" of one block, with the columns ``participant`` and ``team``

    Returns:
        By participant, the name of the unit: the id of one of its teams.
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
    """Return the rows with each participant replaced by the participant's unit, so that analyses cluster by team.

    ``units`` are those of ``find_units``; a participant who is not among them stays.
    """
    return rows.assign(participant=rows["participant"].map(lambda code: units.get(str(code), str(code))))
