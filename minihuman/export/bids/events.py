"""A segment's events as BIDS has them: onset and duration in seconds from the segment's start, in words of the tables.

``trial_type`` is ``episode``, ``step``, ``key``, ``flip`` or ``pause``: the same words that go out as LSL markers.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from minihuman.data.rows import key_in_tables
from minihuman.recorded.episode import Episode
from minihuman.recorded.segment import Segment
from minihuman.study.events import Paused

_S = 1e-9
COLUMNS = {
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
    "response_time": ("s", "Key press minus the flip of the picture it answers."),
    "outcome": ("", "How the episode ended: goal, timeout, failure, abandoned or cut_off."),
    "counts": ("", "Whether the episode counts: it was finished, not tagged and passes the protocol's exclusions."),
    "detail": ("", "Of an episode the world; of a pause its reason."),
}
HED = {
    "episode": ("An episode, from its reset to its last step.", "(Experiment-structure, Label/Episode)"),
    "step": ("A step of the world.", "(Agent-action, Move, Label/Step)"),
    "key": ("A key that went down.", "(Agent-action, Press, Label/Key)"),
    "flip": ("A picture that came to the display.", "(Sensory-event, Visual-presentation, Label/Flip)"),
    "pause": ("Play stopped, and went on.", "(Experiment-structure, Label/Pause)"),
}
_ORDER = ("key", "step", "episode", "flip", "pause")  # of what shares a moment: the cause first
_Row = dict[str, Any]


def sidecar() -> dict[str, Any]:
    """What every column of the events means."""
    described: dict[str, Any] = {
        name: {"Description": meaning} | ({"Units": unit} if unit else {}) for name, (unit, meaning) in COLUMNS.items()
    }
    described["trial_type"] |= {
        "Levels": {word: meaning for word, (meaning, _) in HED.items()},
        "HED": {word: tags for word, (_, tags) in HED.items()},
    }
    return described


def events_of(segment: Segment, episodes: Sequence[Episode], counting: frozenset[tuple[int, int]]) -> list[_Row]:
    """A segment's rows in order of time; ``counting`` are the (number, attempt) of the episodes that count."""
    rows = [
        *_pauses(segment),
        *(row for episode in episodes for row in _episode(episode, segment, counting)),
        *_keys(segment, episodes),
    ]
    return sorted(rows, key=lambda row: (row["onset"], _ORDER.index(row["trial_type"])))


def _pauses(segment: Segment) -> Iterator[_Row]:
    reasons = {note.t_ns: note.reason for note in segment.notes if isinstance(note, Paused)}
    for begin_ns, end_ns in segment.pauses:
        yield _row("pause", begin_ns, segment, duration=(end_ns - begin_ns) * _S, detail=reasons.get(begin_ns, ""))


def _episode(episode: Episode, segment: Segment, counting: frozenset[tuple[int, int]]) -> Iterator[_Row]:
    place = _place(episode)
    yield _row(
        "episode",
        int(episode.t_ns[0]),
        segment,
        duration=int(episode.t_ns[-1] - episode.t_ns[0]) * _S,
        outcome=episode.outcome_word,
        counts=(episode.number, episode.attempt) in counting,
        detail=episode.plan.world,
        **place,
    )
    names = episode.start.action_names
    for step, (t_ns, action, key, reward, rt_ms) in enumerate(
        zip(
            episode.t_ns[1:].tolist(),
            episode.actions.tolist(),
            episode.step_keys,
            episode.rewards.tolist(),
            episode.rt_ms.tolist(),
            strict=True,
        ),
        1,
    ):
        yield _row(
            "step",
            t_ns,
            segment,
            step=step,
            action=names[action],
            key=key_in_tables(key),
            reward=reward,
            response_time=rt_ms / 1e3,
            **place,
        )
    flips = zip(episode.frames.column("flip_ns").tolist(), episode.frames.column("step").tolist(), strict=True)
    for flip_ns, step in flips:
        yield _row("flip", flip_ns, segment, step=step, **place)


def _keys(segment: Segment, episodes: Sequence[Episode]) -> Iterator[_Row]:
    """Every press of the segment, with how long it was held and the episode that it came in."""
    begins = np.array([episode.t_ns[0] for episode in episodes], np.int64)
    held: dict[str, _Row] = {}
    for press in segment.keys:
        if not press.down:
            if press.key in held:
                row = held.pop(press.key)
                row["duration"] = (press.t_ns - segment.start_ns) * _S - row["onset"]
                yield row
            continue
        if press.key in held:
            yield held.pop(press.key)  # it came up elsewhere
        place, action = {}, ""
        at = int(np.searchsorted(begins, press.t_ns, side="left")) - 1  # what begins an episode is no key of it
        if at >= 0 and press.t_ns <= episodes[at].t_ns[-1]:
            place = _place(episodes[at])
            action = "" if press.action is None else episodes[at].start.action_names[press.action]
        held[press.key] = _row(
            "key", press.t_ns, segment, key=key_in_tables(press.key), action=action, verdict=press.verdict, **place
        )
    yield from held.values()


def _place(episode: Episode) -> _Row:
    return {"block": episode.plan.block_name, "episode": episode.number, "attempt": episode.attempt}


def _row(kind: str, t_ns: int, segment: Segment, *, duration: float | None = None, **more: Any) -> _Row:
    lasted = duration if duration is not None else None if kind == "key" else 0.0
    return {"onset": (t_ns - segment.start_ns) * _S, "duration": lasted, "trial_type": kind, **more}
