"""Plans of blocks of trials, and the tables that their options come from."""

from typing import Literal

import msgspec

from minihuman.activities.play.plan import PlayPlan


class TrialsPlan(PlayPlan, frozen=True):
    """The plan of a block of trials."""


class StimuliSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of ``[blocks.stimuli]`` in the protocol: a table of the world options of each trial."""

    file: str = ""  # CSV beside the protocol, columns by name
    rows: tuple[dict[str, str | int | float | bool], ...] = ()  # or the rows themselves
    order: Literal["shuffled", "fixed"] = "shuffled"
    labels: tuple[str, ...] = ()  # columns that say what kind of trial a row is, where the world's options do not tell
    balanced_by: tuple[str, ...] = ()  # columns whose levels keep their shares where part of the table is played
    max_run: dict[str, int] = {}  # column -> how often one of its levels comes in a row at most
