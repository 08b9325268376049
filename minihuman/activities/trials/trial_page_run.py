"""A trial with a time course as a page without a server runs it: its resolved schedule, and how it can end."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from minihuman.activities.trials.activity import TrialsActivity
from minihuman.activities.trials.schedule import (
    CUE_TRIALS_PER_PART,
    CUES_PER_TRIAL,
    NS_PER_MS,
    SOUND_LEAD_NS,
    TrialSchedule,
)
from minihuman.activities.trials.trial_run import PREPARATION_NS, TrialRun
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown, SoundStarted, Tick
from minihuman.web.site.page_run import PageRun

NO_RESPONSE_END = "none"  # the name of the end by the clock; that of another is the action's number
START_MARK = "\x00start\x00"  # stands for the time at which the first picture is due, which the page fills in
_STEP_NS = 1_000  # from one input of a simulated trial to the next


def build_trial_page_run(activity: Activity) -> PageRun | None:
    """Build the run by which a page presents the running trial with a time course; None if no such trial runs."""
    if not isinstance(activity, TrialsActivity) or activity.run is None or activity.running_trial is None:
        return None
    play = activity.running_trial
    episode = play.plan
    timeline = activity.plan.timeline
    assert timeline, "a trial runs"
    actions = {key: play.action_of(key) for key in episode.key_map.keys}
    schedule = activity.run.schedule
    values = _describe_schedule(schedule, activity.run) | {
        "actions": actions,
        "soa_ns": round(timeline.soa_ms * NS_PER_MS),
        "place": episode.episode_in_block,
        "first_cue": activity.number * CUE_TRIALS_PER_PART * CUES_PER_TRIAL,
        "cues_per_trial": CUES_PER_TRIAL,
    }
    ends: dict[str, Callable[[Activity], Iterator[Input]]] = {
        str(action): partial(_generate_inputs, key=key) for key, action in actions.items()
    }
    if schedule.end_ns is not None:
        ends[NO_RESPONSE_END] = partial(_generate_inputs, key="")
    screen_identity = ((episode.block, episode.episode), START_MARK)
    return PageRun("minihuman.activities.trials:trial_run.js", values, screen_identity, ends)


def _describe_schedule(schedule: TrialSchedule, run: TrialRun) -> dict[str, Any]:
    """Return, as values for the page, when a trial's picture changes and responses are taken.

    Times are in nanoseconds since the trial's first picture. The target's sound is given by its index, or None.
    """
    sound_names = [sound.name for sound in schedule.sound_list]
    return {
        "changes": run.changes_ns,
        "target": schedule.target_ns,
        "target_sound": sound_names.index(schedule.target) if schedule.target in sound_names else None,
        "opens": schedule.opens_ns,
        "closes": schedule.closes_ns,
        "end": schedule.end_ns,
        "responses": schedule.responses,
        "ends_at_response": schedule.ends_at_response,
        "has_early_sound": any(sound.is_early for sound in schedule.sound_list),
        "n_sounds": len(schedule.sound_list),
        "preparation_ns": PREPARATION_NS,
        "sound_lead_ns": SOUND_LEAD_NS,
    }


def _generate_inputs(activity: Activity, *, key: str) -> Iterator[Input]:
    """Yield inputs that lead a running trial to its end, with a key as every response; "" for no response.

    Each input must be handled before the next one is requested.
    """
    assert isinstance(activity, TrialsActivity)
    run = activity.run
    play = activity.running_trial
    assert run is not None, "a trial runs"
    assert play is not None, "and so does its episode"
    play.world.reset(play.plan.seed)  # other copies of the session have made steps in the same world
    while activity.run is run:
        now_ns = activity.context.now_ns + _STEP_NS
        yield ScreenShown(now_ns, now_ns, now_ns)
        if run.first_flip_ns is not None:
            for cue in activity.sound_cues:
                onset_ns = max(now_ns, cue.due_ns)
                yield SoundStarted(onset_ns, cue.number, cue.due_ns, onset_ns, 0)
        if key and run.target_onset_ns is not None and len(run.responses) < run.schedule.responses:
            opens_ns = run.target_onset_ns + run.schedule.opens_ns - run.schedule.target_ns
            pressed_ns = max(activity.context.now_ns + _STEP_NS, opens_ns)
            yield KeyDown(pressed_ns, key, key)
            continue
        due_ns = activity.next_tick_ns
        assert due_ns is not None, "a trial ends by the clock where no key is pressed"
        yield Tick(max(due_ns, now_ns))
