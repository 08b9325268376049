"""Trials: short episodes that follow each other by the clock, with no line of progress and no notice between them."""

from minihuman.activities.play.activity import PlayActivity
from minihuman.activities.trials.plan import TrialsPlan
from minihuman.experiment.machine.activity import ActivityKind


class TrialsActivity(PlayActivity):
    """Plays a block of trials; each has a world of its own, which is made between two pictures."""

    shows_progress = False

    @property
    def needs_new_world(self) -> bool:
        """Whether there is a notice while the next world is made: before the block's first alone."""
        return super().needs_new_world and not self.has_begun


TRIAL_BLOCK = ActivityKind(
    "trials",
    TrialsPlan,
    TrialsActivity,
    tables="minihuman.activities.trials.tables:TRIAL_TABLES",
    measures="minihuman.activities.trials.trial_measures:MEASURES",
    report="minihuman.activities.trials.report:build_section",
    is_played_alone=True,
    has_trials=True,
)
