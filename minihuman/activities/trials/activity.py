"""Trials: short episodes that follow each other by the clock, without progress lines or notices between them."""

from minihuman.activities.play.activity import PlayActivity
from minihuman.activities.trials.plan import TrialsPlan
from minihuman.experiment.machine.activity import ActivityKind


class TrialsActivity(PlayActivity):
    """An activity that plays a block of trials; each trial's own world is created between two pictures."""

    shows_progress = False

    @property
    def needs_new_world(self) -> bool:
        """Whether a notice is shown while the next world is created; only before the block's first trial."""
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
