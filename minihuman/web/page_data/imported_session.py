"""Writes a page's episodes as a session's log, by playing them again under a protocol made from them.

The session machine and the recorder are those of every session; the window is one that presses the page's keys. The log
says `collected = "page"`: it is consistent with the rules, but nobody witnessed it.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import groupby
from pathlib import Path
from typing import Any

import msgspec

from minihuman.admin.enrolment_entries import SlotTaken, open_enrolment_log
from minihuman.admin.manifest import record_log_end
from minihuman.display.windows.window import VirtualClock, Window
from minihuman.experiment.keys import RESERVED_KEYS
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, ScreenShown, Stop
from minihuman.experiment.machine.running_episode import NS_PER_MS, RunningEpisode
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.participant_codes import format_participant_code
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.evidence import COLLECTED, PAGE
from minihuman.log.paths import SegmentPath
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import BufferedRecorder
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts, list_world_ids
from minihuman.runtime.session_loop import run_session
from minihuman.web.page_data.imported_slots import build_imported_slot, require_only_imported
from minihuman.web.page_data.page_episodes import PageDataError, PageEpisode
from minihuman.worlds.adapters.world import World

GROUP = "page"
_IMPORTED = "imported from a page, data "  # the reason for which a slot was taken, followed by the data's digest
_LEAST_PLAYING_MS = 0.001  # of a block's time limit, which must not be 0
_HOLD_MS = 0.0  # of a key whose release the page did not see


def digest_episodes(episodes: Sequence[PageEpisode]) -> str:
    """Return the SHA-256 of a session's episodes in hexadecimal, with which a repeated import is recognised."""
    return hashlib.sha256(msgspec.json.encode(episodes)).hexdigest()


def write_session(episodes: Sequence[PageEpisode], study: Path) -> Path | None:
    """Write verified episodes as the log of the study's next participant.

    Returns:
        The log's path; None if the study has these episodes already.

    Raises:
        PageDataError: if the study has sessions that did not come from a page's data, or the episodes form no protocol.
        ProtocolError: if the study's folder has a name that no study may have.
        LogError: if the log cannot be written.
    """
    digest = digest_episodes(episodes)
    study.mkdir(parents=True, exist_ok=True)
    with open_enrolment_log(study).hold() as register:
        taken_slots = [line for line in register.lines if isinstance(line, SlotTaken)]
        require_only_imported(taken_slots, study, _IMPORTED)
        imported_slot = next((line for line in taken_slots if line.reason == _IMPORTED + digest), None)
        if imported_slot is None:
            plan = _plan_session(episodes, study.name, len(taken_slots))
            index = plan.participant.index
            register.append(build_imported_slot(plan, index, _IMPORTED + digest, list_length=index + 1))
        else:
            plan = _plan_session(episodes, study.name, imported_slot.index)
    if SegmentPath.of_plan(study.parent, plan).log.exists():
        return None
    return _record_session(episodes, plan, study.parent, digest)


def _plan_session(episodes: Sequence[PageEpisode], study: str, index: int) -> SessionPlan:
    """Plan the session of the allocation slot ``index``, under a protocol that is made from the episodes."""
    protocol = decode_protocol(format_protocol(episodes, study, index + 1).encode(), f"the protocol of {study}")
    # 0: nobody had the slot before
    participant = msgspec.structs.replace(
        enrol_participant(protocol, index, None), id=format_participant_code(index, 0)
    )
    return expand_protocol(protocol, participant)


def _record_session(episodes: Sequence[PageEpisode], plan: SessionPlan, data: Path, digest: str) -> Path | None:
    """Play verified episodes again as a session and record it.

    Args:
        episodes: the episodes.
        plan: the plan of the session.
        data: the data folder, which contains the study's folder.
        digest: the digest of the episodes, for the log.

    Returns:
        The path of the log, as ``run_session`` returns it.
    """
    clock = VirtualClock()
    facts = {
        "player": "human",
        COLLECTED: PAGE,
        "page_data": digest,
        "page_rules": episodes[0].sources,
        **collect_machine_facts(),
        **collect_world_facts(list_world_ids(plan)),
        "window": "page",
        "utc_offset_min": "0",
    }
    session = SessionMachine(plan, World, facts, picture_px=None)
    recorder = BufferedRecorder(McapRecorder(data, plan, started_ns=episodes[0].started_unix_ms * NS_PER_MS))
    window = RecordedKeys(session, clock, episodes)
    return run_session(session, window, recorder, clock, finished=record_log_end)


class RecordedKeys(Window):
    """Presses a page's recorded keys again, each at its recorded time after the first picture."""

    def __init__(self, session: SessionMachine, clock: VirtualClock, episodes: Sequence[PageEpisode]) -> None:
        self._session = session
        self._clock = clock
        self._episodes = episodes
        self._play: RunningEpisode | None = None  # the episode of the next inputs
        self._pending: list[Input] = []  # the episode's further inputs, in order of time

    def show(self, screen: Screen) -> ScreenShown:
        """Report a screen as shown at once; with an episode's first picture, schedule the episode's recorded keys."""
        now_ns = self._clock()
        play = self._session.play
        if play is not None and play is not self._play and play.started:
            self._play = play
            self._pending = list(_list_inputs(self._episodes[play.plan.episode], now_ns))
        return ScreenShown(t_ns=now_ns, submit_ns=now_ns, flip_ns=now_ns)

    def wait(self, until_ns: int | None) -> list[Input]:
        """Move the clock to the next input, or to ``until_ns`` if that is earlier, and return the input, if any.

        If neither is due, return a press of Enter, which continues after an episode, or the end of an episode that the
        page left unfinished.
        """
        is_due = bool(self._pending) and (until_ns is None or self._pending[0].t_ns <= until_ns)
        if is_due:
            next_input = self._pending.pop(0)
            self._clock.advance_to(next_input.t_ns)
            return [next_input]
        is_more_to_come = bool(self._pending) or self._session.next_tick_ns is not None
        if until_ns is not None and is_more_to_come:
            self._clock.advance_to(until_ns)
            return []
        play = self._play
        now_ns = self._clock()
        is_unfinished = play is not None and play is self._session.play and play.outcome is None
        if is_unfinished:
            return [Stop(now_ns, "window_closed", "the page has no more of this episode")]
        return [KeyDown(now_ns, "enter", "enter"), KeyUp(now_ns, "enter", "enter")]

    def facts(self) -> dict[str, str]:
        """Return the fact that the window was a page."""
        return {"window": "page"}

    def close(self) -> None:
        """Do nothing, since this window holds no resources."""


def _list_inputs(episode: PageEpisode, shown_ns: int) -> Iterator[Input]:
    """Yield an episode's key presses and releases, and its end if the page was left, in order of time.

    Args:
        episode: the episode.
        shown_ns: the session's time at which the episode's first picture was shown.
    """
    inputs: list[Input] = []
    names = episode.physical_keys
    for key, rt_ms, held_ms in zip(episode.keys, episode.rt_ms, episode.held_ms, strict=True):
        down_ns = shown_ns + round(rt_ms * NS_PER_MS)
        up_ns = down_ns + round((held_ms or _HOLD_MS) * NS_PER_MS)
        inputs += [KeyDown(down_ns, names[key], key), KeyUp(up_ns, names[key], key)]
    if episode.end == "left":
        inputs.append(Stop(shown_ns + round(episode.playing_ms * NS_PER_MS), "window_closed", "the page was left"))
    yield from sorted(inputs, key=lambda page_input: page_input.t_ns)


def format_protocol(episodes: Sequence[PageEpisode], study: str, participants: int) -> str:
    """Return a protocol, as TOML, for episodes that a page has played.

    It has a block for each run of consecutive episodes that differ only in their seeds.

    Args:
        episodes: the episodes.
        study: the study's name.
        participants: the study's number of participants.

    Raises:
        PageDataError: if a pressed key is one that a session cannot assign to an action.
    """
    blocks: list[dict[str, Any]] = []
    pool: set[str] = set()
    for _, run in groupby(episodes, key=_describe_condition):
        block = _describe_block(len(blocks) + 1, list(run))
        blocks.append(block)
        pool |= set(block["fixed_keys"])
    header = {
        "study": {
            "name": study,
            "version": "page",
            "seed": 0,
            "participants": participants,
            "closing": "",
        },
        "keys": {"pool": sorted(pool), "keyboard_check": False},
    }
    lines: list[str] = []
    for name, table in header.items():
        lines += _format_table(f"[{name}]", table)
    lines += _format_table("[[groups]]", {"name": GROUP, "blocks": [block["name"] for block in blocks]})
    for block in blocks:
        lines += _format_table("[[blocks]]", block)
    return "\n".join(lines) + "\n"


def _describe_condition(episode: PageEpisode) -> tuple[Any, ...]:
    """Return the settings that all episodes of a block share."""
    limit_ms = 0.0
    if episode.end == "time_limit":
        limit_ms = episode.time_limit_ms
    return episode.world, episode.options, episode.view, episode.key_map, limit_ms


def _describe_block(number: int, episodes: Sequence[PageEpisode]) -> dict[str, Any]:
    """Return a block of the protocol, as a table, for a run of consecutive episodes; ``number``, from 1, names it."""
    first = episodes[0]
    keys = _list_session_keys(episodes)
    with closing(World(first.world, first.options)) as world:
        # without a limit of the world's own, one that none of the episodes reaches
        max_steps = world.step_limit or max(len(episode.actions) for episode in episodes) + 1
    block: dict[str, Any] = {
        "name": f"episodes-{number}",
        "world": first.world,
        "options": first.options,
        "episodes": len(episodes),
        "seeds": [episode.seed for episode in episodes],
        "actions": list(dict.fromkeys(keys.values())),
        "key_map": "fixed",
        "fixed_keys": keys,
        "max_steps": max_steps,
        "view": first.view,
        "ready": "none",
        "final_frame_ms": 0.0,
    }
    if first.end == "time_limit":
        block["max_episode_s"] = max(first.time_limit_ms, _LEAST_PLAYING_MS) / 1_000
    return block


def _list_session_keys(episodes: Sequence[PageEpisode]) -> dict[str, str]:
    """Return the action of each key by minihuman's name of the key.

    Keys that no session can assign, since they are reserved or have no name, are left out if they were not pressed.

    Raises:
        PageDataError: if a pressed key cannot be assigned to an action.
    """
    first = episodes[0]
    pressed = {key for episode in episodes for key in episode.keys}
    keys: dict[str, str] = {}
    for key, action in first.key_map.items():
        name = first.physical_keys[key]
        if name and name not in RESERVED_KEYS:
            keys[name] = action
        elif key in pressed:
            raise PageDataError(
                f"{first.name}: no log can hold key {key!r} as an action's; use a letter, a digit or an arrow"
            )
    return keys


def _format_table(head: str, table: dict[str, Any]) -> list[str]:
    return [head, *(f"{name} = {_format_toml(value)}" for name, value in table.items()), ""]


def _format_toml(value: Any) -> str:
    """Format a value as TOML: as JSON, but with inline tables, and with DEL (U+007F) escaped, as TOML requires."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_format_toml(name)} = {_format_toml(field)}" for name, field in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_format_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
