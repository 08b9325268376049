"""The table of trials: stimuli and responses of the episodes in a trial world or with labels."""

import json
import math

from minihuman.activities.play.tables import PLAY_TABLES
from minihuman.activities.trials.columns import TRIAL_COLUMNS
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.dataset.measures import response_ms
from minihuman.experiment.trial_responses import NO_RESPONSE
from minihuman.log.model.session_log import EpisodeLog
from minihuman.worlds.catalogue import TRIAL_WORLDS


def _build_trial_row(episode: EpisodeLog) -> TableRow | None:
    plan = episode.plan
    if plan.world not in TRIAL_WORLDS and not plan.labels:
        return None
    correct = str(plan.options.get("correct", ""))
    if len(episode.actions):
        response = episode.start.action_names[episode.actions[-1]]
    else:
        response = ""
    times_ms = response_ms(episode)
    first_ms = float(times_ms[0]) if len(times_ms) else math.nan
    is_made = response not in ("", NO_RESPONSE) and not math.isnan(first_ms)
    return {
        "trial": plan.episode_in_block + 1,
        "stimulus": json.dumps(plan.options, sort_keys=True, ensure_ascii=False),
        "labels": json.dumps(plan.labels, sort_keys=True, ensure_ascii=False) if plan.labels else "",
        "correct": correct,
        "response": response,
        "is_correct": response == correct if correct and response else None,
        "response_ms": first_ms if is_made else None,
        "reward": episode.return_,
    }


TRIAL_TABLES = (*PLAY_TABLES, ActivityTable("trials", TRIAL_COLUMNS, episode_row=_build_trial_row))
