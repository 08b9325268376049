"""Reads and checks the episodes that a page computed, from jsPsych's JSON and CSV or a file of saved games.

No file is trusted: its form, sizes and numbers are checked here before a world is made.
"""

import csv
import io
import json
import math
from collections.abc import Container, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import msgspec

from minihuman.errors import MinihumanError
from minihuman.experiment.keys import PUNCTUATION
from minihuman.web.key_codes import KEY_CODES
from minihuman.worlds.adapters.page_world import ActionsVerification, verify_actions
from minihuman.worlds.catalogue import BABYAI_WORLDS, DRAWN_LEVEL, FIRST_PERSON_WORLDS, GRID_WORLDS
from minihuman.worlds.source_digest import kernels_digest

TRIAL_TYPE = "minihuman-episode"  # of the jsPsych plugin
GAME_FORMAT = "minihuman-game"
GAME_VERSION = 1
MAX_FILE_BYTES = 256 * 1024 * 1024
MAX_STEPS = 100_000  # of an episode
NOT_PROVED = (
    "not proved: when keys were pressed and for how long, which of two keys of one action it was, whether a hand "
    "pressed it, and who played"
)
_DIGEST_LENGTH = 16
_WORLDS = frozenset(entry.id for entry in (*GRID_WORLDS, *BABYAI_WORLDS, *FIRST_PERSON_WORLDS, DRAWN_LEVEL))
_OPTIONS: Mapping[str, type] = {
    "max_steps": int,
    "trig": int,
    "mission": str,
    "diagram": str,
}  # that a page may have set
_CLOCK_TOLERANCE_MS = 1_000  # by which an adjustment of the clock may make episodes overlap
_PUNCTUATION = dict(zip("-=[]\\;'`,./ ", (*PUNCTUATION, "space"), strict=True))


class PageDataError(MinihumanError, ValueError):
    """Episodes that a page computed cannot be read, or replay differently."""

    exit_code = 1  # a check failed


EpisodeEnd = Literal["terminated", "truncated", "time_limit", "left"]


class PageEpisode(msgspec.Struct, frozen=True):
    """One episode, with the columns of ``page/episode_record.js``."""

    world: str
    options: dict[str, Any]
    seed: int
    view: Literal["partial", "full"]
    key_map: dict[str, str]  # `KeyboardEvent.key` -> action
    keys: tuple[str, ...]
    actions: tuple[int, ...]
    rt_ms: tuple[float, ...]  # after the first picture
    held_ms: tuple[float | None, ...]
    rewards: tuple[float, ...]
    digests: str  # 16 hexadecimal digits per step
    buttons: tuple[int, ...]  # steps made by a button on the screen
    untrusted: tuple[int, ...]  # steps made by a program's event, as the page reports
    end: EpisodeEnd
    time_limit_ms: float
    playing_ms: float
    reward: float
    success: bool
    sources: str  # what the page's rules were compiled from
    started_unix_ms: int

    @property
    def step_digests(self) -> list[str]:
        """Return the digest of each step."""
        starts = range(0, len(self.digests), _DIGEST_LENGTH)
        return [self.digests[start : start + _DIGEST_LENGTH] for start in starts]

    @property
    def name(self) -> str:
        """Return the name by which errors refer to the episode."""
        return f"{self.world} seed {self.seed}"

    @property
    def physical_keys(self) -> dict[str, str]:
        """Return minihuman's name of each key in the key map; "" for a key without one."""
        return {key: name_key(key) for key in self.key_map}


def name_key(key: str) -> str:
    """Return minihuman's name of a key, given its `KeyboardEvent.key`; "" if it has none."""
    if len(key) == 1 and key.isascii() and key.isalnum():
        return key.lower()
    return _PUNCTUATION.get(key) or KEY_CODES.get(key, "")


def list_data_files(path: Path) -> list[Path]:
    """Return the path itself if it is a file, or the data files (JSON, CSV, text) below a folder, sorted by name.

    Raises:
        PageDataError: if the folder has no such file.
    """
    if path.is_file():
        return [path]
    files = sorted(file for file in path.rglob("*") if file.suffix.lower() in (".json", ".csv", ".txt"))
    if not files:
        raise PageDataError(f"{path} has no data of a page (.json, .csv); name a file, or a folder of them")
    return files


def read_page_data(path: Path) -> list[PageEpisode]:
    """Read one session's episodes from a file.

    Raises:
        PageDataError: if the file is too large or not of a known form, or if it has no episodes, a malformed one, or
            several participants' trials.
        OSError: if the file cannot be read.
    """
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise PageDataError(f"{path} has {size} bytes; one session's data have at most {MAX_FILE_BYTES}")
    text = _read_text(path)
    if path.suffix.lower() == ".csv":
        rows = _read_csv_rows(text)
    else:
        rows = _read_json_rows(text, path)
    _check_trial_order(rows, path)
    episodes = [_convert_row(row, f"{path}: episode {number}") for number, row in enumerate(rows, 1)]
    if not episodes:
        raise PageDataError(f"{path} has no episodes: no trial of type {TRIAL_TYPE!r}, and it is no kept game")
    return episodes


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise PageDataError(f"{path} is not text in UTF-8 ({error.reason}); save it as jsPsych does") from error


def _read_json_rows(text: str, path: Path) -> list[dict[str, Any]]:
    """Return the rows of the trials in jsPsych's JSON, or of the episodes in a saved game.

    Raises:
        PageDataError: if the text is neither.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise PageDataError(f"{path} is not JSON ({error}); is it the file that the page saved?") from error
    if isinstance(content, dict) and content.get("format") == GAME_FORMAT:
        if content.get("version") != GAME_VERSION:
            raise PageDataError(f"{path} is a game of version {content.get('version')!r}; this reads {GAME_VERSION}")
        content = [{**game, "trial_type": TRIAL_TYPE} for game in content.get("episodes", ()) if isinstance(game, dict)]
    if not isinstance(content, list):
        raise PageDataError(f"{path} is neither a list of trials nor a kept game")
    return [trial for trial in content if isinstance(trial, dict) and trial.get("trial_type") == TRIAL_TYPE]


def _read_csv_rows(text: str) -> list[dict[str, Any]]:
    """Return the rows of the episodes in jsPsych's CSV."""
    rows = [row for row in csv.DictReader(io.StringIO(text)) if row.get("trial_type") == TRIAL_TYPE]
    text_columns = {
        field.name
        for field in msgspec.structs.fields(PageEpisode)
        if field.type is str or field.name in ("view", "end")
    }
    return [_decode_cells(row, text_columns) for row in rows]


def _decode_cells(row: Mapping[str, str | None], text_columns: Container[str]) -> dict[str, Any]:
    """Decode the cells of a CSV row as JSON, except those of columns that hold texts."""
    cells: dict[str, Any] = dict(row)
    for name in row:
        if name not in text_columns:
            cells[name] = _decode_cell(row[name])
    return cells


def _decode_cell(cell: str | None) -> Any:
    """Decode a cell as JSON; return None for an empty cell, and the text itself if it is not valid JSON."""
    try:
        return json.loads(cell or "null")
    except (ValueError, RecursionError):
        return cell


def _check_trial_order(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Check that the trials of the rows are in order, which they are not if several participants share a file.

    Raises:
        PageDataError: if they are out of order.
    """
    numbers = [row["trial_index"] for row in rows if isinstance(row.get("trial_index"), int)]
    for before, after in pairwise(numbers):
        if after <= before:
            raise PageDataError(
                f"{path}: trial {after} comes after trial {before}; give each participant a file of their own, in order"
            )


def _convert_row(row: Mapping[str, Any], source: str) -> PageEpisode:
    """Convert a row to an episode; raise PageDataError, which names the row's source, if it is malformed."""
    try:
        return msgspec.convert(dict(row), PageEpisode, strict=True)
    except msgspec.ValidationError as error:
        raise PageDataError(f"{source}: {error}") from error


def require_consistent(episodes: Sequence[PageEpisode], source: object, *, checks_world: bool = True) -> None:
    """Require that a session's episodes replay as the page recorded them, and can follow each other.

    Args:
        episodes: the session's episodes.
        source: the file from which they were read, or a description of it, for errors.
        checks_world: as for `verify_episode`.

    Raises:
        PageDataError: at the first difference.
    """
    for number, episode in enumerate(episodes, 1):
        if difference := describe_difference(episode, verify_episode(episode, checks_world=checks_world)):
            raise PageDataError(f"{source}: episode {number} ({episode.name}): {difference}")
    if order_error := find_order_error(episodes):
        raise PageDataError(f"{source}: {order_error}")


def verify_episode(episode: PageEpisode, *, checks_world: bool = True) -> ActionsVerification:
    """Check an episode's columns, replay its actions and compare each step.

    Args:
        episode: the episode.
        checks_world: whether to refuse worlds and options that no page computes. If not, the caller has chosen the
            world and trusts its code.

    Returns:
        The verification of the replayed steps.

    Raises:
        PageDataError: if a column is malformed, or the page used other rules than those installed here.
    """
    try:
        if checks_world:
            _require_catalogued(episode)
        for difference in _list_malformed_columns(episode):
            raise PageDataError(f"{episode.name}: {difference}")
        return verify_actions(
            episode.world,
            episode.seed,
            episode.actions,
            episode.step_digests,
            rewards=episode.rewards,
            options=episode.options,
        )
    except PageDataError:
        raise
    except (MinihumanError, ValueError) as error:  # such as options of which no world can be made
        raise PageDataError(f"{episode.name}: {error}") from error


def describe_difference(episode: PageEpisode, verification: ActionsVerification) -> str:
    """Return a sentence on how an episode first differs from its replay; "" if it does not."""
    if verification.difference:
        return verification.difference
    return next(_list_differences(episode, verification), "")


def _require_catalogued(episode: PageEpisode) -> None:
    """Raise PageDataError if an episode's world, or one of its options, is not one that a page may have used."""
    if episode.world not in _WORLDS:
        raise PageDataError(f"world {episode.world!r} is none that a page computes; `minihuman worlds` lists them")
    for wrong in _list_wrong_options(episode.options):
        raise PageDataError(f"{episode.name}: {wrong}")


def _list_malformed_columns(episode: PageEpisode) -> Iterator[str]:
    """Yield a sentence for each error in the columns of an episode that can be found without a replay."""
    steps = len(episode.actions)
    own_rules = kernels_digest()
    if episode.sources != own_rules:
        yield (
            f"played by rules {episode.sources!r}, checked by rules {own_rules!r}; import it with the version of "
            "minihuman that packed the worlds"
        )
    if steps > MAX_STEPS:
        yield f"{steps} steps are more than {MAX_STEPS}"
    for name in ("keys", "rt_ms", "held_ms", "rewards"):
        count = len(getattr(episode, name))
        if count != steps:
            yield f"{name} has {count} entries for {steps} actions"
    if len(episode.digests) != _DIGEST_LENGTH * steps:
        yield f"digests has {len(episode.digests)} digits for {steps} actions, {_DIGEST_LENGTH} each"
    if not 0 <= episode.seed < 2**63:
        yield "a seed is 0 or more and below 2**63"
    yield from _list_wrong_numbers(episode)


def _list_wrong_options(options: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each option of a world that no page sets, or whose value has another type."""
    for name, value in options.items():
        kind = _OPTIONS.get(name)
        if kind is None or type(value) is not kind:
            yield f"option {name} = {value!r} is none that a page sets"


def _list_wrong_numbers(episode: PageEpisode) -> Iterator[str]:
    """Yield a sentence for each rule that the numbers of an episode violate."""
    hold_times_ms = [hold_ms for hold_ms in episode.held_ms if hold_ms is not None]
    step_numbers = (*episode.rt_ms, *episode.rewards, *hold_times_ms)
    episode_numbers = (episode.reward, episode.playing_ms, episode.time_limit_ms)
    if not all(map(math.isfinite, (*step_numbers, *episode_numbers))):
        yield "a number is not finite"
    if any(later < earlier for earlier, later in pairwise((0.0, *episode.rt_ms))):
        yield "rt_ms falls from one key to the next"
    if any(hold_ms < 0 for hold_ms in hold_times_ms):
        yield "held_ms is below 0"
    if episode.started_unix_ms < 0 or episode.playing_ms < max(episode.rt_ms, default=0.0):
        yield "playing_ms is less than the last key's rt_ms, or the episode began before 1970"
    for name in ("buttons", "untrusted"):
        if not all(0 <= step < len(episode.actions) for step in getattr(episode, name)):
            yield f"{name} names a step that the episode does not have"


def _list_differences(episode: PageEpisode, verification: ActionsVerification) -> Iterator[str]:
    """Yield a sentence for each way in which an episode differs from its replay."""
    yield from _list_wrong_actions(episode, verification.action_names)
    yield from _list_wrong_endings(episode, verification)
    yield from _list_wrong_outcomes(episode, verification)


def _list_wrong_endings(episode: PageEpisode, verification: ActionsVerification) -> Iterator[str]:
    """Yield a sentence for each way in which the kind or the time of an episode's end is wrong."""
    if episode.end != _find_end(verification, episode.end):
        replayed_end = _find_end(verification, "not over")
        yield f"end is {episode.end!r}, played again it is {replayed_end!r}"
    last_key_ms = max(episode.rt_ms, default=0.0)
    if episode.end in ("terminated", "truncated") and episode.playing_ms != episode.rt_ms[-1]:
        yield f"playing_ms is {episode.playing_ms}, but the last key came at {episode.rt_ms[-1]}"
    if episode.end == "time_limit" and not last_key_ms <= episode.time_limit_ms <= episode.playing_ms:
        yield f"the time limit of {episode.time_limit_ms} ms is not between the last key and the end"


def _list_wrong_outcomes(episode: PageEpisode, verification: ActionsVerification) -> Iterator[str]:
    """Yield a sentence if an episode's reward or success differs from that of its replay."""
    if episode.reward != verification.reward:
        yield f"reward is {episode.reward!r}, played again {verification.reward!r}"
    has_succeeded = verification.terminated and episode.rewards[-1] > 0
    if episode.success != has_succeeded:
        yield f"success is {episode.success}, played again it is {has_succeeded}"


def _list_wrong_actions(episode: PageEpisode, action_names: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each step whose action is not its key's, and each key whose action the world lacks."""
    for step, (key, action) in enumerate(zip(episode.keys, episode.actions, strict=True), 1):
        expected = episode.key_map.get(key)
        if expected != action_names[action]:
            yield f"step {step}: key {key!r} has action {expected!r}, but {action_names[action]!r} was done"
    for key, name in episode.key_map.items():
        if name not in action_names:
            yield f"key {key!r} has action {name!r}, which {episode.world} has not"


def _find_end(verification: ActionsVerification, otherwise: str) -> str:
    """Return how an episode ended according to its replay.

    Args:
        verification: the verification of the replayed steps.
        otherwise: the ending to return if the world did not end the episode. If it is one that only the world can
            cause, "left" is returned instead.
    """
    if verification.terminated:
        return "terminated"
    if verification.truncated:
        return "truncated"
    if otherwise in ("terminated", "truncated"):
        return "left"
    return otherwise


def find_order_error(episodes: Sequence[PageEpisode]) -> str:
    """Return a sentence if an episode follows one that was left or ended later, so that the order is wrong; else "".

    Clock adjustments of up to one second are tolerated.
    """
    ended_ms = 0.0
    for number, episode in enumerate(episodes, 1):
        if episode.end == "left" and number < len(episodes):
            return f"episode {number} was left, but others follow; give each of them a file of its own"
        if episode.started_unix_ms + _CLOCK_TOLERANCE_MS < ended_ms:
            return f"episode {number} began before episode {number - 1} had ended"
        ended_ms = episode.started_unix_ms + episode.playing_ms
    return ""
