"""Recording quality of a session (late and missing frames, pauses, displays), and an outline of its plan."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.experiment.protocol.protocol import decode_logged_protocol
from minihuman.log.model.doubtful_presses import describe_doubtful_presses, find_doubtful_presses
from minihuman.log.model.event_columns import CategoricalTexts
from minihuman.log.model.session_log import EpisodeLog, SessionLog

LATE_MS = 5.0  # presses that waited longer to be processed are counted as late
_NS_PER_MS = 1e6
_NO_FLIP = -1
_DISPLAY = ("window", "window_size_px", "refresh_hz_reported", "vsync", "key_times")
_SOFTWARE = (
    *("version_minihuman", "git_commit", "rules", "python", "system", "version_numpy", "window_version"),
    "page_kernels",
)


@dataclass(frozen=True, slots=True)
class RecordingQuality:
    """The recording quality of one session. Times are in milliseconds; NaN where nothing could be measured."""

    participant: str
    session: int
    presses: int
    late: int  # presses processed more than LATE_MS after they were made
    latest_ms: float
    steps: int
    pictures_missing: int  # steps and resets whose picture was not shown
    key_to_flip_ms: tuple[float, float, float]  # median, 95 %, 99 %: from a step's key to its picture's flip
    focus_lost: int
    pauses: int
    paused_s: float
    segments: int
    clean: bool
    displays: tuple[dict[str, str], ...]  # the distinct displays of the segments
    software: tuple[dict[str, str], ...]  # the distinct software versions of the segments
    periods: int = 0  # step periods of real-time blocks that step without a key
    periods_missed: int = 0  # periods without a step, because the world or the machine was too slow
    doubtful_presses: str = ""  # describes accepted presses of keys that were down before the window had the focus


class PlanOutline(msgspec.Struct, frozen=True):
    """An outline of a session's plan, as a methods section reports it."""

    study: str
    version: str
    protocol_sha256: str
    seed: int
    participant: str
    group: str
    session: int
    by_hand: bool  # whether participant or group was chosen instead of allocated
    blocks: tuple[EpisodePlan, ...]  # the first episode of each block
    stratum: str = ""
    stratified_by: str = ""  # the question whose answer is the stratum
    computed: tuple[str, ...] = ()  # blocks that the web page computes with its own kernels

    @classmethod
    def of(cls, plan: SessionPlan) -> "PlanOutline":
        """Outline a session's plan."""
        first: dict[str, EpisodePlan] = {}
        for episode in plan.episodes:
            first.setdefault(episode.block_name, episode)
        stratified_by = ""
        if plan.participant.stratum:
            stratified_by = decode_logged_protocol(plan.protocol_toml).allocation.stratify_by
        return cls(
            study=plan.study,
            version=plan.study_version,
            protocol_sha256=plan.protocol_sha256,
            seed=plan.study_seed,
            participant=plan.participant.id,
            group=plan.participant.group,
            session=plan.session,
            by_hand=plan.overridden,
            blocks=tuple(first.values()),
            stratum=plan.participant.stratum,
            stratified_by=stratified_by,
            computed=tuple(
                plan.episodes[part.plan.first].block_name
                for part in plan.parts
                if isinstance(part.plan, PlayPlan) and part.plan.computed == "page"
            ),
        )


def measure_recording_quality(log: SessionLog) -> RecordingQuality:
    """Measure the recording quality of one session."""
    press_waits_ms = _measure_press_waits_ms(log)
    latest_ms = np.nan
    if press_waits_ms.size:
        latest_ms = float(press_waits_ms.max())
    pauses = [pause for segment in log.segments for pause in segment.pauses]
    paused_ns = sum(end_ns - begin_ns for begin_ns, end_ns in pauses)
    periods = [_count_periods(episode, pauses) for episode in log.episodes]
    return RecordingQuality(
        participant=log.plan.participant.id,
        session=log.plan.session,
        presses=int(press_waits_ms.size),
        late=int((press_waits_ms > LATE_MS).sum()),
        latest_ms=latest_ms,
        steps=sum(len(episode.actions) for episode in log.episodes),
        pictures_missing=sum(_count_missing_pictures(episode) for episode in log.episodes),
        key_to_flip_ms=_measure_flip_percentiles_ms(log),
        focus_lost=sum(_is_focus_loss(note) for note in log.notes),
        pauses=len(pauses),
        paused_s=paused_ns / 1e9,
        segments=len(log.segments),
        clean=log.clean,
        displays=_list_station_facts(log, _DISPLAY),
        software=_list_station_facts(log, _SOFTWARE),
        periods=int(sum(gaps.sum() for gaps in periods)),
        periods_missed=int(sum((gaps - 1).sum() for gaps in periods)),
        doubtful_presses=describe_doubtful_presses(find_doubtful_presses(log)),
    )


def _measure_press_waits_ms(log: SessionLog) -> NDArray[np.float64]:
    """Return how long each key press of a session waited until it was read, in milliseconds."""
    waits_ms = []
    for segment in log.segments:
        is_down = np.asarray(segment.keys.column("down"), bool)
        waits_ms.append(np.asarray(segment.keys.column("waited_ns"))[is_down] / _NS_PER_MS)
    return _concatenate(waits_ms)


def _measure_flip_percentiles_ms(log: SessionLog) -> tuple[float, float, float]:
    """Return the median, 95th and 99th percentile of the time from key to flip, in milliseconds; NaN if unknown."""
    to_flip_ms = list_key_to_flip_ms(log)
    if not to_flip_ms.size:
        return (np.nan, np.nan, np.nan)
    median_ms, p95_ms, p99_ms = np.percentile(to_flip_ms, (50, 95, 99)).tolist()
    return (median_ms, p95_ms, p99_ms)


def _is_focus_loss(note: object) -> bool:
    return isinstance(note, Noted) and note.kind == "focus" and note.text == "lost"


def _list_station_facts(log: SessionLog, names: Sequence[str]) -> tuple[dict[str, str], ...]:
    """List the named facts of the stations on which the session's segments were played, without duplicates."""
    station_facts: list[dict[str, str]] = []
    for segment in log.segments:
        facts = {name: segment.facts[name] for name in names if name in segment.facts}
        if facts not in station_facts:
            station_facts.append(facts)
    return tuple(station_facts)


def list_key_to_flip_ms(log: SessionLog) -> NDArray[np.float64]:
    """List the times in milliseconds from a step's key to the first flip of its picture, over all episodes.

    Steps without a key or without a shown picture are omitted.
    """
    return _concatenate(_key_to_flip_ms(episode) for episode in log.episodes)


def _concatenate(parts: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([np.empty(0), *parts])


def _count_missing_pictures(episode: EpisodeLog) -> int:
    """Count an episode's pictures that were never shown, including the picture of the reset."""
    shown_steps = set(np.asarray(episode.frames.column("step")).tolist())
    return len(episode.actions) + 1 - len(shown_steps)


def _count_periods(episode: EpisodeLog, pauses: Sequence[tuple[int, int]]) -> NDArray[np.int64]:
    """Count the step periods from each real-time step to the next; 1 means that no period was without a step.

    Pairs of steps around one of the ``pauses``, given by begin and end in ns of session time, are omitted. The array is
    empty if the episode has steps only when a key is pressed.
    """
    if episode.plan.pace != "real_time" or episode.plan.noop is None:
        return np.empty(0, np.int64)
    steps_ns = episode.t_ns[1:]
    is_paused = np.zeros(max(0, len(steps_ns) - 1), bool)
    for begin_ns, end_ns in pauses:
        is_paused |= (steps_ns[:-1] < end_ns) & (steps_ns[1:] > begin_ns)
    began_ns = next(iter(episode.frames.column("flip_ns")), 0)  # the clock starts with the first picture
    gaps = np.diff((steps_ns - began_ns) // round(episode.plan.step_period_ms * _NS_PER_MS))
    return np.maximum(1, gaps[~is_paused])


def _key_to_flip_ms(episode: EpisodeLog) -> NDArray[np.float64]:
    """List the times in milliseconds from a step's key to the first flip of its picture, for steps that have both."""
    # reversed, so that of several pictures of a step the assignment below keeps the first
    steps, flips_ns = (np.asarray(episode.frames.column(name), np.int64)[::-1] for name in ("step", "flip_ns"))
    is_done = (steps > 0) & (steps <= len(episode.actions))  # a log may break off between a picture and its step
    first_ns = np.full(len(episode.actions), _NO_FLIP, np.int64)
    first_ns[steps[is_done] - 1] = flips_ns[is_done]
    has_both = ~CategoricalTexts.of(episode.step_keys).equals_any(("",)) & (first_ns != _NO_FLIP)
    return np.asarray((first_ns[has_both] - episode.key_t_ns[has_both]) / _NS_PER_MS)
