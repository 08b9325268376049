"""Evidence from a log's key times on whether a person or a program played, as a likelihood ratio with reasons.

People and programs are modelled as mixtures of kinds fitted to simulations: some kinds of people, some of programs and,
because not every program is known, one that can be anything. Each kind has a histogram of every measure of the key
times (``analysis/bots.py`` fits them). Since measures are correlated, the ratio of the mixtures is shrunk by a logistic
regression and bounded. It is not calibrated on people: it flags a session, and a person decides. Scripted keys, keys
without focus and times shared with another session are reported as separate facts.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from minihuman.dataset.annotations import collect_tags
from minihuman.dataset.selection import SelectedSession
from minihuman.experiment.machine.events import UNPRESSED_VERDICTS, Noted, TextChanged, TextTyped
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.model.session_log import EpisodeLog, SessionLog

Array = NDArray[np.float64]
MEASURES = {  # words, and the range of the histogram; what lies outside counts in the outermost bin
    "median": ("median time between keys, log10 ms", 1.5, 4.5),
    "spread": ("their interquartile range over the median, log10", -3.0, 0.7),
    "skewness": ("their upper over their lower quartile distance, log10", -0.8, 1.2),
    "autocorrelation": ("correlation of each log time with the one before", -0.5, 1.0),
    "repetition": ("time of the same key again over that of another, log10", -1.0, 0.4),
    "first": ("time of an episode's first key over the median, log10", -1.0, 1.2),
    "practice": ("rank correlation of time and number of the key", -0.8, 0.8),
    "hold": ("median time that a key is held, log10 ms", 0.0, 3.0),
    "hold_spread": ("the interquartile range of holds over the median, log10", -3.0, 0.7),
    "overlap": ("share of keys pressed before the last one was released", -0.05, 1.0),
}
BINS = 20
N_INTERVALS = 20  # the fewest intervals of a session that are measured
N_OTHERS = 5  # the fewest on each side of a ratio or correlation
BOUND = 3.0  # a ratio beyond 1000 is not claimed from some hundred simulated people
FLAG = -2.0  # log10 of the ratio at which a session is flagged
NOT_CALIBRATED = "not calibrated on people: fitted to simulated people and programs"
_N_REASONS = 3  # measures that a session's verdict names
_NS_PER_MS = 1e6
_SAME_RUN = 5  # successive times that another session must share to be a copy
_SAME_MS = 2.0  # the largest difference of shared times
_VARIED_MS = 50 * _SAME_MS  # a steadier run, as of a held key, can be the same in two sessions by chance
_MIN_MS = 0.1  # shorter times count as this, so that each has a logarithm
_MIN_RATIO = 1e-3  # added to a spread for the same reason
_ADDED_MS = 1.0  # added to both quartile distances for the same reason
_NO_SPREAD = 1e-9  # a smaller standard deviation is rounding
_ANSWER_AT_ONCE = 40  # characters


@dataclass(frozen=True, slots=True)
class PressTimes:
    """A session's key presses while playing; NaN separates episodes and marks pauses.

    Attributes:
        intervals_ms: the times in milliseconds from each press to the next in its episode, an array of shape (n,).
        same: whether the next press is of the same key, an array of shape (n,).
        firsts_ms: per episode, the time in milliseconds from its reset to its first press.
        holds_ms: how long keys were held, in milliseconds, one time per press with a release.
        overlap: the share of presses, without each episode's first, that came before the previous key was released.
    """

    intervals_ms: Array
    same: NDArray[np.bool_]
    firsts_ms: Array
    holds_ms: Array
    overlap: float


def read_key_times(log: SessionLog) -> PressTimes:
    """Read the key times of a session, from the episodes in which a key was pressed.

    Without such an episode, the arrays are empty and the overlap is NaN.
    """
    parts = [part for part in map(_read_episode_times, log.episodes) if part is not None]
    if not parts:
        return PressTimes(np.empty(0), np.empty(0, bool), np.empty(0), np.empty(0), np.nan)
    intervals_ms, same, firsts_ms, holds_ms, overlaps = map(np.concatenate, zip(*parts, strict=True))
    overlap = float(overlaps.mean()) if len(overlaps) else np.nan
    return PressTimes(intervals_ms, same.astype(bool), firsts_ms, holds_ms, overlap)


def _read_episode_times(episode: EpisodeLog) -> tuple[Array, ...] | None:
    """Return an episode's intervals, repetitions, first time, hold times and overlaps; None if no key was pressed.

    Times are in milliseconds, and repetitions and overlaps are 1 or 0 for each press. A press is an overlap if the next
    key went down before its own came up.
    """
    keys = episode.keys
    t_ns = np.asarray(keys.column("t_ns")) - np.asarray(keys.column("waited_ns"))
    is_down = np.asarray(keys.column("down"), bool)
    codes = keys.column("key").codes
    verdict = keys.column("verdict")
    is_press = is_down & ~verdict.equals_any((*UNPRESSED_VERDICTS, "typing", "not_playing"))
    is_release = ~is_down & ~verdict.equals_any(("release_at_focus_loss",))  # no finger left the key then
    down_ns = t_ns[is_press]
    pressed_codes = codes[is_press]
    if not len(down_ns):
        return None
    up_ns = np.full(len(down_ns), np.nan)
    for code in np.unique(pressed_codes):
        is_of_key = pressed_codes == code
        up_ns[is_of_key] = _find_next(np.sort(t_ns[is_release & (codes == code)]), down_ns[is_of_key])
    n_pauses_before = np.searchsorted([begin for begin, _ in episode.pauses], down_ns)
    is_before_pause = np.append(np.diff(n_pauses_before) > 0, False)
    intervals_ms = np.append(np.diff(down_ns) / _NS_PER_MS, np.nan)
    intervals_ms[is_before_pause] = np.nan
    is_repeated = np.append(pressed_codes[1:] == pressed_codes[:-1], False)
    first_ms = (down_ns[0] - episode.t_ns[0]) / _NS_PER_MS
    holds_ms = ((up_ns - down_ns) / _NS_PER_MS)[~np.isnan(up_ns)]
    overlaps = down_ns[1:] < up_ns[:-1]
    return intervals_ms, is_repeated.astype(float), np.array([first_ms]), holds_ms, overlaps.astype(float)


def _find_next(times_ns: Array, after_ns: Array) -> Array:
    """Return, for each time in ``after_ns``, the first of the sorted ``times_ns`` at or after it; NaN without one."""
    with_none = np.append(times_ns.astype(float), np.nan)
    return with_none[np.searchsorted(with_none[:-1], after_ns)]


def measure_key_times(times: PressTimes) -> dict[str, float]:
    """Return each measure of `MEASURES`, NaN if its data are insufficient; an empty dict if intervals are too few."""
    is_present = ~np.isnan(times.intervals_ms)
    intervals = np.maximum(times.intervals_ms, _MIN_MS)
    if is_present.sum() < N_INTERVALS:
        return {}
    logs = np.log10(intervals)
    same_key_logs = logs[is_present & times.same]
    other_key_logs = logs[is_present & ~times.same]
    # Repeated keys come faster and in runs, which alone would correlate successive times.
    if min(len(same_key_logs), len(other_key_logs)) >= N_OTHERS:
        logs = logs - np.where(times.same, np.median(same_key_logs), np.median(other_key_logs))
    is_pair = is_present[1:] & is_present[:-1]
    low, middle, high = np.quantile(intervals[is_present], (0.25, 0.5, 0.75))
    if len(times.holds_ms) >= N_OTHERS:
        holds_ms = np.maximum(times.holds_ms, _MIN_MS)
    else:
        holds_ms = np.full(1, np.nan)
    measures = {
        "median": np.log10(middle),
        "spread": np.log10((high - low) / middle + _MIN_RATIO),
        "skewness": np.log10((high - middle + _ADDED_MS) / (middle - low + _ADDED_MS)),
        "autocorrelation": _correlate(logs[1:][is_pair], logs[:-1][is_pair]),
        "repetition": _compare_medians(intervals[is_present & times.same], intervals[is_present & ~times.same]),
        "first": _compare_medians(times.firsts_ms, intervals[is_present]),
        "practice": _correlate(scipy.stats.rankdata(intervals[is_present]), np.arange(is_present.sum())),
        "hold": np.log10(np.median(holds_ms)),
        "hold_spread": np.log10(np.ptp(np.quantile(holds_ms, (0.25, 0.75))) / np.median(holds_ms) + _MIN_RATIO),
        "overlap": times.overlap,
    }
    return {name: float(value) for name, value in measures.items()}


def _correlate(first: Array, second: Array) -> float:
    """Return Pearson's correlation; NaN if there are too few values or one side does not vary."""
    if len(first) < N_OTHERS or min(np.std(first), np.std(second)) < _NO_SPREAD:
        return float("nan")
    return float(np.corrcoef(first, second)[0, 1])


def _compare_medians(first: Array, second: Array) -> float:
    """Return log10 of the ratio of two medians; NaN if there are too few values."""
    if min(len(first), len(second)) < N_OTHERS:
        return float("nan")
    first_median = max(float(np.median(first)), _MIN_MS)
    second_median = max(float(np.median(second)), _MIN_MS)
    return float(np.log10(first_median / second_median))


def place_in_bin(name: str, value: float) -> int:
    """Return the index of a measure's histogram bin for a value, which is the outermost one if no bin contains it."""
    _, low, high = MEASURES[name]
    return int(np.clip((value - low) / (high - low) * BINS, 0, BINS - 1))


def weigh_measures(
    measured: Mapping[str, float], model: Mapping[str, Any], *, bound: float = BOUND
) -> tuple[float, dict[str, float]]:
    """Return log10 of the likelihood ratio of a person against a program, and each measure's contribution to it.

    A measure's contribution compares the best-fitting kind of person with the best-fitting kind of program. Measures
    that are NaN have none.

    Args:
        measured: the measures returned by `measure_key_times`.
        model: ``people`` and ``programs``, each a list of kinds with a ``weight`` and, by measure, the ``log10`` of
            each bin's probability; ``slope`` and ``intercept`` of the logistic regression.
        bound: the largest absolute value of the returned log10; a larger one is clipped.
    """
    bins = {name: place_in_bin(name, value) for name, value in measured.items() if np.isfinite(value)}
    people_likelihood, best_person = _fit_kinds(model["people"], bins)
    program_likelihood, best_program = _fit_kinds(model["programs"], bins)
    slope: float = model["slope"]
    ratio = slope * (people_likelihood - program_likelihood) + model["intercept"]
    shares = {name: slope * (best_person[name][index] - best_program[name][index]) for name, index in bins.items()}
    return float(np.clip(ratio, -bound, bound)), shares


def _fit_kinds(kinds: Sequence[Mapping[str, Any]], bins: Mapping[str, int]) -> tuple[float, Mapping[str, Any]]:
    """Return log10 of the likelihood under all kinds together, and the log10 probabilities of the best-fitting kind.

    Args:
        kinds: the kinds of people or of programs in the model.
        bins: the index of the histogram bin of each measure.
    """
    fits = []
    for kind in kinds:
        log_probability = sum(kind["log10"][name][index] for name, index in bins.items())
        fits.append(np.log10(kind["weight"]) + log_probability)
    likelihood = np.logaddexp.reduce(np.array(fits) * np.log(10)) / np.log(10)
    return likelihood, kinds[int(np.argmax(fits))]["log10"]


@cache
def load_model() -> dict[str, Any]:
    """Load the fitted model that is shipped with the package."""
    text = (files("minihuman.reporting") / "data" / "bots.json").read_text(encoding="utf-8")
    model: dict[str, Any] = json.loads(text)
    return model


@dataclass(frozen=True, slots=True)
class Evidence:
    """The evidence from one session's key times on whether a person played."""

    participant: str
    session: int
    log: Path
    presses: int
    log10_ratio: float | None  # of a person against a program; None with too few presses
    reasons: tuple[str, ...]  # what weighs most, in words
    facts: tuple[str, ...]  # each flags by itself
    flagged: bool
    decision: str  # a reviewer's annotations of the whole session

    def line(self) -> str:
        """State the verdict in one line; ``facts`` and ``reasons`` explain the verdict."""
        verdict = "FLAGGED" if self.flagged else "-"
        line = f"{self.participant} session {self.session}: {verdict}  {self._format_ratio()}"
        if self.decision:
            line += f"; annotated {self.decision}"
        return line

    def _format_ratio(self) -> str:
        """Format the likelihood ratio of a person against a program as odds."""
        if self.log10_ratio is None:
            return "too few keys"
        odds = f"{10 ** abs(self.log10_ratio):.2g}"
        if self.log10_ratio >= 0:
            return f"person : program = {odds} : 1"
        return f"person : program = 1 : {odds}"


def weigh_sessions(sessions: Iterable[SelectedSession], *, typing: bool = False) -> Iterator[Evidence]:
    """Yield the evidence for each session.

    Args:
        sessions: the sessions of one study, as key times of one session are searched for in the others.
        typing: whether to examine also how answers were typed.
    """
    sessions_with_times = [(session.log, session.marks, read_key_times(session.log)) for session in sessions]
    copies = find_same_times([times for _, _, times in sessions_with_times])
    for number, (log, marks, times) in enumerate(sessions_with_times):
        measured = measure_key_times(times)
        total: float | None = None
        shares: dict[str, float] = {}
        if measured:
            total, shares = weigh_measures(measured, load_model())
        facts = list(_find_facts(log, typing=typing))
        if number in copies:
            similar_log, _, _ = sessions_with_times[copies[number]]
            name = f"{similar_log.plan.participant.id} session {similar_log.plan.session}"
            facts.append(f"{_SAME_RUN} times in a row within {_SAME_MS:g} ms of those of {name}")
        is_ratio_low = total is not None and total <= FLAG
        direction = np.sign(total or 1)  # -1 if a program is more likely
        strongest = sorted(shares, key=lambda name: -shares[name] * direction)[:_N_REASONS]
        yield Evidence(
            participant=log.plan.participant.id,
            session=log.plan.session,
            log=log.path,
            presses=len(times.intervals_ms),
            log10_ratio=total,
            reasons=tuple(f"{MEASURES[name][0]}: {measured[name]:.2f} ({shares[name]:+.1f})" for name in strongest),
            facts=tuple(facts),
            flagged=bool(facts) or is_ratio_low,
            decision=", ".join(sorted(collect_tags(marks).get(None, ()))),
        )


def _find_facts(log: SessionLog, *, typing: bool) -> Iterator[str]:
    """Yield facts each of which flags a session: scripted keys, keys without focus; with ``typing``, pasted answers."""
    scripted = sum(
        isinstance(note, Noted) and note.kind == BROWSER_NOTE and note.text.endswith("made by a script")
        for note in log.notes
    )
    if scripted:
        yield f"{scripted} key events were made by a script (isTrusted)"
    without_focus = _count_keys_without_focus(log)
    if without_focus:
        yield f"{without_focus} keys were pressed while the page had no focus"
    if typing:
        longest = max(_list_lengths_at_once(log), default=0)
        if longest >= _ANSWER_AT_ONCE:
            yield f"{longest} characters of an answer came at once: pasted, dictated or made by a program"


def _list_lengths_at_once(log: SessionLog) -> Iterator[int]:
    """Yield the number of characters of each text input, and of each field change beyond the keys pressed for it."""
    lengths: dict[tuple[int, str], int] = {}
    for event in log.part_events:
        if isinstance(event, TextTyped):
            yield len(event.text)
        elif isinstance(event, TextChanged):
            field = (event.part, event.item)
            yield len(event.text) - lengths.get(field, 0) - event.keys
            lengths[field] = len(event.text)


def _count_keys_without_focus(log: SessionLog) -> int:
    """Count the keys that were pressed while the page had no focus."""
    focus_notes = [note for note in log.notes if isinstance(note, Noted) and note.kind == "focus"]
    if not focus_notes:
        return 0
    is_press = np.asarray(log.keys.column("down"), bool)
    pressed_ns = np.asarray(log.keys.column("t_ns"))[is_press]
    n_earlier_notes = np.searchsorted([note.t_ns for note in focus_notes], pressed_ns)
    is_focus_lost = np.array([False, *(note.text == "lost" for note in focus_notes)])  # focused before the first note
    return int(is_focus_lost[n_earlier_notes].sum())


def find_same_times(times: list[PressTimes]) -> dict[int, int]:
    """Find the sessions that share a run of key times with another session, as replayed logs do.

    ``times`` has the key times of each session. Return, by the index of each session found, the index of a session that
    shares a run with it.
    """
    rows = [np.empty((0, _SAME_RUN))]
    owners = [np.empty(0, int)]
    for number, press_times in enumerate(times):
        if len(press_times.intervals_ms) >= _SAME_RUN:
            runs = np.lib.stride_tricks.sliding_window_view(press_times.intervals_ms, _SAME_RUN)
            varied = runs[~np.isnan(runs).any(axis=1) & (np.ptp(np.nan_to_num(runs), axis=1) > _VARIED_MS)]
            rows.append(varied)
            owners.append(np.full(len(varied), number))
    owner = np.concatenate(owners)
    run_pairs = scipy.spatial.cKDTree(np.concatenate(rows)).query_pairs(_SAME_MS, p=np.inf, output_type="ndarray")
    session_pairs = owner[run_pairs]
    if not len(session_pairs):
        return {}
    between_sessions = session_pairs[session_pairs[:, 0] != session_pairs[:, 1]]
    copies: dict[int, int] = {}
    for pairs in (between_sessions, between_sessions[:, ::-1]):
        # reversed, so that a session's first pair replaces its later pairs
        copies |= {int(session): int(similar_session) for session, similar_session in pairs[::-1]}
    return copies
