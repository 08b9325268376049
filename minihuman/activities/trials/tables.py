"""The tables of trials, of the pictures of those with a time course, and of their responses.

A trial is an episode in a trial world or with labels.
"""

import json
import math

from minihuman.activities.play.tables import PLAY_TABLES
from minihuman.activities.trials.columns import RESPONSE_COLUMNS, SOUND_COLUMNS, STIMULUS_COLUMNS, TRIAL_COLUMNS
from minihuman.activities.trials.events import ResponseTaken, SoundPlayed, StimuliShown
from minihuman.activities.trials.presentations import TrialRecord, read_trials
from minihuman.activities.trials.rows import RESPONSE_TOPIC, SOUND_TOPIC, STIMULI_TOPIC
from minihuman.activities.trials.schedule import NS_PER_MS
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.dataset.measures import response_ms
from minihuman.experiment.trial_responses import NO_RESPONSE
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.worlds.catalogue import TRIAL_WORLDS


def _build_trial_row(episode: EpisodeLog) -> TableRow | None:
    """Build the row of a trial; None if the episode is no trial.

    Whether the response is correct is None if the trial has no correct response or no response.
    """
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
    has_response_time = response not in ("", NO_RESPONSE) and not math.isnan(first_ms)
    return {
        "trial": plan.episode_in_block + 1,
        "stimulus": json.dumps(plan.options, sort_keys=True, ensure_ascii=False),
        "labels": json.dumps(plan.labels, sort_keys=True, ensure_ascii=False) if plan.labels else "",
        "correct": correct,
        "response": response,
        "is_correct": response == correct if correct and response else None,
        "response_ms": first_ms if has_response_time else None,
        "reward": episode.return_,
    }


def _count_attempts(event: StimuliShown | ResponseTaken, log: SessionLog) -> int:
    """Return the number of the event's attempt: how often its episode had begun by then, void trials included."""
    return sum(episode.plan.episode == event.episode and episode.start.t_ns <= event.t_ns for episode in log.episodes)


def _build_stimulus_row(event: StimuliShown, log: SessionLog) -> TableRow | None:
    """Build the row of a picture that reached the display; None for the empty picture before a trial's first."""
    if event.frame < 0:
        return None
    has_due_time = bool(event.due_ns)
    return {
        "part": event.part + 1,
        "episode": event.episode + 1,
        "attempt": _count_attempts(event, log),
        "picture": event.frame + 1,
        "stimuli": json.dumps(event.stimuli, ensure_ascii=False),
        "due_ns": event.due_ns if has_due_time else None,
        "flip_ns": event.flip_ns,
        "late_ms": (event.flip_ns - event.due_ns) / NS_PER_MS if has_due_time else None,
    }


def _list_sound_rows(log: SessionLog) -> list[TableRow]:
    """Return a row for each sound that began or was due before its trial's end, trial by trial in order of time."""
    rows: list[TableRow] = []
    for trial in read_trials(log):
        trial_rows = [_build_sound_row(event, trial) for event in trial.sounds]
        trial_rows += [_build_missing_row(name, due_ns, trial) for name, due_ns in trial.list_missing_sounds()]
        rows += sorted(trial_rows, key=lambda row: row["t_ns"])
    return rows


def _build_sound_row(event: SoundPlayed, trial: TrialRecord) -> TableRow:
    return _locate_sound(event.sound, event.t_ns, trial) | {
        "due_ns": event.due_ns,
        "scheduled_ns": event.scheduled_ns,
        "onset_ns": event.onset_ns,
        "late_ms": (event.onset_ns - event.due_ns) / NS_PER_MS,
        "uncertainty_ms": event.uncertainty_ms,
    }


def _build_missing_row(name: str, due_ns: int, trial: TrialRecord) -> TableRow:
    """Build the row of a sound that was due but did not begin before its trial's end."""
    unknown = dict.fromkeys(("scheduled_ns", "onset_ns", "late_ms", "uncertainty_ms"))
    return _locate_sound(name, due_ns, trial) | {"due_ns": due_ns, **unknown}


def _locate_sound(name: str, t_ns: int, trial: TrialRecord) -> TableRow:
    """Return the columns that say which sound it is and where in the session it belongs."""
    episode = trial.episode
    return {
        "segment": episode.segment,
        "t_ns": t_ns,
        "part": trial.part + 1,
        "episode": episode.number,
        "attempt": episode.attempt,
        "sound": name,
    }


def _build_response_row(event: ResponseTaken, log: SessionLog) -> TableRow:
    return {
        "part": event.part + 1,
        "episode": event.episode + 1,
        "attempt": _count_attempts(event, log),
        "number": event.number,
        "key": event.key,
        "pressed_ns": event.pressed_ns,
        "response_ms": (event.pressed_ns - event.target_ns) / NS_PER_MS,
    }


TRIAL_TABLES = (
    *PLAY_TABLES,
    ActivityTable("trials", TRIAL_COLUMNS, episode_row=_build_trial_row),
    ActivityTable("trial_stimuli", STIMULUS_COLUMNS, {StimuliShown: _build_stimulus_row}, topics=(STIMULI_TOPIC,)),
    ActivityTable("trial_sounds", SOUND_COLUMNS, session_rows=_list_sound_rows, topics=(SOUND_TOPIC,)),
    ActivityTable("trial_responses", RESPONSE_COLUMNS, {ResponseTaken: _build_response_row}, topics=(RESPONSE_TOPIC,)),
)
