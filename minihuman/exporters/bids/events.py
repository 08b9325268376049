"""The events of a BIDS dataset for one segment of a session, and what their columns mean.

Onsets and durations are in seconds from the start of the run. `trial_type` is `episode`, `step`, `key`, `flip`, `sound`
or `pause`: all but `sound` are the words that are also sent as LSL markers.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from minihuman.dataset.info_columns import LABELS
from minihuman.dataset.measures import response_ms
from minihuman.dataset.table_columns import table_key_name
from minihuman.experiment.machine.events import Paused
from minihuman.experiment.plan.session_plan import name_label_column
from minihuman.exporters.bids.stimulus_files import STIM_FILE, SessionStimuli
from minihuman.log.model.session_log import EpisodeLog, Segment

_S_PER_NS = 1e-9
EVENT_COLUMNS = {
    "onset": ("s", "When it happened, since the run's first moment."),
    "duration": ("s", "How long it lasted: an episode to its last step, a key until it came up, a pause."),
    "trial_type": ("", "What happened."),
    "block": ("", "The block's name in the protocol."),
    "episode": ("", "The session's episode, 1 for the first."),
    "attempt": ("", "1, or more where an interrupted episode was begun again."),
    "step": ("", "The episode's step, 1 for the first; of a flip the step that the picture shows, 0 for the reset."),
    "key": ("", "The physical key."),
    "action": ("", "The action's name."),
    "verdict": ("", "What became of a key press."),
    "reward": ("", "The step's reward."),
    "response_time": (
        "s",
        "Key press minus stimulus onset, as response_ms in the tables: in real time n/a where no onset is named.",
    ),
    "outcome": ("", "How the episode ended: goal, timeout, failure, abandoned, agent_failed or cut_off."),
    "counts": ("", "Whether the episode counts: it was finished, not tagged and passes the protocol's exclusions."),
    "detail": ("", "Of an episode the world; of a pause its reason; of a trial's picture or sound its stimuli."),
}
HED = {
    "episode": ("An episode, from its reset to its last step.", "(Experiment-structure, Label/Episode)"),
    "step": ("A step of the world.", "(Agent-action, Move, Label/Step)"),
    "key": ("A key that went down.", "(Agent-action, Press, Label/Key)"),
    "flip": ("A picture that came to the display.", "(Sensory-event, Visual-presentation, Label/Flip)"),
    "sound": ("A sound that began.", "(Sensory-event, Auditory-presentation, Label/Sound)"),
    "pause": ("Play stopped, and went on.", "(Experiment-structure, Label/Pause)"),
}
_ORDER = ("key", "step", "episode", "flip", "sound", "pause")  # of what shares a moment: the cause first
_Row = dict[str, Any]


def describe_event_columns() -> dict[str, Any]:
    """Return the description of every event column, by the column's name, for the JSON sidecar of the events."""
    descriptions: dict[str, Any] = {}
    for name, (unit, meaning) in EVENT_COLUMNS.items():
        descriptions[name] = {"Description": meaning}
        if unit:
            descriptions[name]["Units"] = unit
    descriptions["trial_type"] |= {
        "Levels": {word: meaning for word, (meaning, _) in HED.items()},
        "HED": {word: tags for word, (_, tags) in HED.items()},
    }
    return descriptions


def list_labels(episode: EpisodeLog) -> dict[str, Any]:
    """Return the labels of an episode's stimulus, by their column names in the events."""
    return {name_label_column(key): label for key, label in episode.plan.labels.items()}


def describe_label_columns(episodes: Sequence[EpisodeLog]) -> dict[str, Any]:
    """Return the description of the column of each label that an episode has, by name, for the events' sidecar."""
    keys = dict.fromkeys(key for episode in episodes for key in episode.plan.labels)
    return {name_label_column(key): {"Description": LABELS.meaning.format(key)} for key in keys}


def build_events(
    segment: Segment,
    episodes: Sequence[EpisodeLog],
    counting: frozenset[tuple[int, int]],
    stimuli: SessionStimuli,
) -> list[_Row]:
    """Build the rows of a segment's events, in order of time.

    Args:
        segment: the segment.
        episodes: the selected attempts at episodes in this segment, in order of time.
        counting: the (number, attempt) of each included episode.
        stimuli: what the session presented; the files of its stimuli are written.
    """
    rows = [*_list_pauses(segment)]
    for episode in episodes:
        rows += _list_episode_events(episode, segment, counting)
        rows += _list_presentation_events(episode, segment, stimuli)
    rows += _list_key_events(segment, episodes)

    def make_sort_key(row: _Row) -> tuple[Any, int]:
        return row["onset"], _ORDER.index(row["trial_type"])

    return sorted(rows, key=make_sort_key)


def _list_pauses(segment: Segment) -> Iterator[_Row]:
    """Yield a row for every pause of the segment, with its duration and reason."""
    reasons = {note.t_ns: note.reason for note in segment.notes if isinstance(note, Paused)}
    for begin_ns, end_ns in segment.pauses:
        yield _build_event_row(
            "pause", begin_ns, segment, duration=(end_ns - begin_ns) * _S_PER_NS, detail=reasons.get(begin_ns, "")
        )


def _list_episode_events(episode: EpisodeLog, segment: Segment, counting: frozenset[tuple[int, int]]) -> Iterator[_Row]:
    """Yield a row for the episode and for each of its steps; ``counting`` is as for `build_events`."""
    episode_columns = _identify_episode(episode) | list_labels(episode)
    begin_ns, *step_times_ns = episode.t_ns.tolist()
    yield _build_event_row(
        "episode",
        begin_ns,
        segment,
        duration=int(episode.t_ns[-1] - episode.t_ns[0]) * _S_PER_NS,
        outcome=episode.outcome_word,
        counts=(episode.number, episode.attempt) in counting,
        detail=episode.plan.world,
        **episode_columns,
    )
    names = episode.start.action_names
    actions = episode.actions.tolist()
    rewards = episode.rewards.tolist()
    responses_ms = response_ms(episode).tolist()
    for index, t_ns in enumerate(step_times_ns):
        yield _build_event_row(
            "step",
            t_ns,
            segment,
            step=index + 1,
            action=names[actions[index]],
            key=table_key_name(episode.step_keys[index]),
            reward=rewards[index],
            response_time=responses_ms[index] / 1e3,
            **episode_columns,
        )


def _list_presentation_events(episode: EpisodeLog, segment: Segment, stimuli: SessionStimuli) -> Iterator[_Row]:
    """Yield a row for each picture of an episode on the display and each sound that began; write their files."""
    episode_columns = _identify_episode(episode) | list_labels(episode)
    image = stimuli.find_image(episode.plan.options)
    flips = zip(episode.frames.column("flip_ns").tolist(), episode.frames.column("step").tolist(), strict=True)
    for flip_ns, step in flips:
        row = _build_event_row("flip", flip_ns, segment, step=step, **episode_columns)
        if step == 0 and image:
            row[STIM_FILE] = image
        yield row
    for presentation, columns in stimuli.list_presented(episode.number, episode.attempt):
        yield _build_event_row(presentation.kind, presentation.onset_ns, segment, **episode_columns) | columns


def _list_key_events(segment: Segment, episodes: Sequence[EpisodeLog]) -> Iterator[_Row]:
    """Yield a row for each key press of a segment, with the episode in which it happened, if any, and its duration.

    The duration is missing if the key's release was not recorded.
    """
    begins = np.array([episode.t_ns[0] for episode in episodes], np.int64)
    pressed: dict[str, _Row] = {}
    for press in segment.keys:
        if not press.down:
            if press.key in pressed:
                row = pressed.pop(press.key)
                row["duration"] = (press.t_ns - segment.start_ns) * _S_PER_NS - row["onset"]
                yield row
            continue
        if press.key in pressed:
            yield pressed.pop(press.key)  # its release was not recorded
        episode_columns = {}
        action = ""
        # the last episode that began before the press; the press that begins an episode is outside it
        index = int(np.searchsorted(begins, press.t_ns, side="left")) - 1
        if index >= 0 and press.t_ns <= episodes[index].t_ns[-1]:
            episode_columns = _identify_episode(episodes[index])
            if press.action is not None:
                action = episodes[index].start.action_names[press.action]
        pressed[press.key] = _build_event_row(
            "key",
            press.t_ns,
            segment,
            key=table_key_name(press.key),
            action=action,
            verdict=press.verdict,
            **episode_columns,
        )
    yield from pressed.values()


def _identify_episode(episode: EpisodeLog) -> _Row:
    """Return the cells that identify an episode: its block, number and attempt."""
    return {"block": episode.plan.block_name, "episode": episode.number, "attempt": episode.attempt}


def _build_event_row(kind: str, t_ns: int, segment: Segment, *, duration: float | None = None, **more: Any) -> _Row:
    """Build the row of an event.

    Args:
        kind: the event's ``trial_type``.
        t_ns: when it happened, on the log's clock.
        segment: the segment, from whose start the onset counts.
        duration: in seconds; None stands for no duration of a key, and for 0 s of other kinds.
        more: further cells, by column.
    """
    if duration is not None:
        duration_s = duration
    elif kind == "key":
        duration_s = None
    else:
        duration_s = 0.0
    return {"onset": (t_ns - segment.start_ns) * _S_PER_NS, "duration": duration_s, "trial_type": kind, **more}
