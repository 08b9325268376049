"""Dry run of a protocol: describe a session plan as text, and make and play the world of every block."""

import difflib
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator

from minihuman.errors import ProtocolError, WorldError
from minihuman.experiment.activities.block_plans import PlayPlan, computed_by
from minihuman.experiment.activities.pages import PagePlan
from minihuman.experiment.activities.questions.questionnaire import QuestionsPlan
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.experiment.protocol.validation_errors import build_protocol_error
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import WORLDS


def describe_plan(plan: SessionPlan) -> Iterator[str]:
    """Everything a participant will do, part by part."""
    who = plan.participant
    yield f"study        {plan.study} {plan.study_version}, seed {plan.study_seed}, language {plan.language}"
    yield f"protocol     SHA-256 {plan.protocol_sha256}"
    if plan.allocation_sha256:
        yield f"allocation   SHA-256 {plan.allocation_sha256}"
    stratum = f", stratum {who.stratum}" if who.stratum else ""
    yield f"participant  {who.id}, group {who.group}{stratum}, session {plan.session}"
    yield f"consent      {'SHA-256 ' + plan.consent_sha256 if plan.consent_text else 'not asked for'}"
    yield f"keys         {' '.join(plan.key_pool)}{', each checked first' if plan.keyboard_check else ''}"
    if plan.bonus:
        most = "" if plan.bonus.most is None else f", at most {plan.bonus.most:g}"
        yield f"bonus        {plan.bonus.base:g} + {plan.bonus.per_point:g} a point{most} {plan.bonus.currency}"
    for number, part in enumerate(plan.parts, 1):
        yield ""
        yield from _describe_part(plan, number, part)


def describe_strata(protocol: Protocol) -> Iterator[str]:
    """How many slots of each group each stratum has, where groups are drawn after an answer."""
    strata = build_strata(protocol)
    if strata is None:
        return
    of_each = Counter((slot.stratum, slot.group) for slot in build_allocation_list(protocol))
    yield ""
    yield f"strata of {strata.question}: the group is drawn after the answer, from the stratum's own list"
    for name in strata.names:
        groups = ", ".join(f"{group.name} {of_each[name, group.name]}" for group in protocol.groups)
        yield f"  {name}  of the first {protocol.study.participants}: {groups}"


def _describe_part(plan: SessionPlan, number: int, part: PlannedPart) -> Iterator[str]:
    match part.plan:
        case PlayPlan() as play:
            yield from _describe_block(plan, number, part, play)
        case PagePlan() as page:
            what = "consent" if page.agree else "last words" if page.closing else "page"
            pictures = f", {len(page.pictures)} pictures" if page.pictures else ""
            example = ", an example of the world" if page.example else ""
            yield f"part {number}: {part.name}, {what} of {_format_count(len(page.pages), 'page')}{pictures}{example}"
        case QuestionsPlan() as asked:
            yield f"part {number}: {part.name}, {_format_count(len(asked.items), 'question')}"
            for item in asked.items:
                right = "" if item.right is None else f", right: {item.right}"
                yield f"  {item.name}  {item.kind}{right}"
            if any(item.right is not None for item in asked.items):
                back = "" if asked.back_to is None else f", wrong answers lead back to part {asked.back_to + 1}"
                then = "the session ends" if asked.failed == "end" else "the session goes on"
                yield f"  tries  {asked.tries}{back}, then {then}"
        case _:
            yield f"part {number}: {part.name}, {part.kind}"


def _format_count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _describe_block(plan: SessionPlan, number: int, part: PlannedPart, play: PlayPlan) -> Iterator[str]:
    episodes = plan.episodes[play.first : play.first + play.count]
    first = episodes[0]
    options = "".join(f", {name}={value!r}" for name, value in first.options.items())
    what = f"{first.block_name}, {first.world}{options}, {first.view} view, {first.palette}"
    yield f"part {number}: block {first.block + 1}, {what}"
    keys = ", ".join(f"{key} {action}" for key, action in sorted(first.key_map.keys.items()))
    yield f"  keys   {keys}{' (shown)' if first.show_keys else ''}"
    yield f"  pace   {_describe_pace(first)}; at most {first.max_steps} steps"
    yield f"  in a browser computed by the {computed_by(part, first)}"
    yield from _describe_limits(play)
    for episode in episodes:
        yield f"  {episode.episode + 1:3}  episode {episode.episode_in_block + 1:2} of the block  seed {episode.seed}"
    if play.rest_s:
        yield f"  rest   {play.rest_s:g} s or longer afterwards"


def _describe_pace(first: EpisodePlan) -> str:
    if first.pace == "real_time":
        onset = "the first picture" if first.onset_at_reset else "the world's info['onset'], NULL where it names none"
        return (
            f"a step every {first.step_period_ms:g} ms, without a key {first.noop or 'none'}; response_ms from {onset}"
        )
    return "one press one step" + (", held keys repeat" if first.auto_repeat else "")


def _describe_limits(play: PlayPlan) -> Iterator[str]:
    if play.until:
        yield f"  until  {play.until.successes} of the last {play.until.of} reach the goal, then {play.until.otherwise}"
    limits = [f"{name} {value:g} s" for name, value in (("episode", play.max_s), ("block", play.block_max_s)) if value]
    if limits:
        yield f"  time   at most {', '.join(limits)}"
    if play.points:
        each = {"goal": play.points.goal, "timeout": play.points.timeout, "failure": play.points.failure}
        each |= {"a step": play.points.per_step, "a reward of 1": play.points.per_reward}
        yield f"  points {', '.join(f'{name} {value:+g}' for name, value in each.items() if value)}"


_OURS = "minihuman/"

N_TRIED_SEEDS = 5  # that are laid out where a block does not say which


def check_worlds(
    protocol: Protocol, source: str = "protocol", *, before: Callable[[BlockSpec], None] = lambda block: None
) -> None:
    """Make every block's world, look its actions up, and play it; ``source`` names the file in errors.

    ``before`` is called with each block before its world is played.

    Raises:
        ProtocolError: of every block whose world is not as it says, or at the first whose world cannot be played.
    """
    _check_actions(protocol, source)
    for number, block in enumerate(protocol.blocks):
        try:
            before(block)
            try_world(block)
        except Exception as error:  # whatever a lab's world may raise
            reason = str(error) if isinstance(error, WorldError) else f"{type(error).__name__}: {error}"
            raise ProtocolError(f"{source}: $.blocks[{number}].world: {block.world} fails ({reason})") from error


def try_world(block: BlockSpec) -> None:
    """Do everything once that an episode of a block does with its world, with each of its layouts and actions."""
    seeds = sorted(set(block.seeds)) if isinstance(block.seeds, tuple) else range(N_TRIED_SEEDS)
    world = World(block.world, block.options)
    try:
        for seed in seeds:
            world.reset(seed)
        for action in (*block.actions, *block.distractors):
            world.reset(seeds[0])
            world.map(), world.pose(), world.state_hash()
            world.step(world.action_names.index(action))
        world.frame(block.view, palette=block.palette)
    finally:
        world.close()


def _check_actions(protocol: Protocol, source: str) -> None:
    text = protocol.toml.decode("utf-8-sig")
    complaints = [
        (f"$.blocks[{number}].{field}", complaint)
        for number, block in enumerate(protocol.blocks)
        for field, complaint in _find_world_errors(block)
    ]
    if wrong := build_protocol_error(complaints, source=source, text=text, tree=tomllib.loads(text)):
        raise wrong


def _find_world_errors(block: BlockSpec) -> Iterator[tuple[str, str]]:
    try:
        world = World(block.world, block.options)
    except WorldError as error:
        yield "world", f"is {block.world!r}: {_explain_world_error(block, error)}"
        return
    known, limit = world.action_names, world.step_limit
    if block.computed == "page" and not world.is_compiled:
        what = "but its rules or pictures are Python, which no page runs; leave it out, or use 'server'"
        yield "computed", f"is 'page' for {block.world}, {what}"
    world.close()
    named = {
        "actions": block.actions,
        "distractors": block.distractors,
        "noop": (block.noop_action,) if block.noop_action else (),
    }
    for field, names in named.items():
        for name in names:
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                meant = f"; did you mean {close[0]!r}?" if close else ""
                yield (
                    field,
                    f"names {name!r}, which {block.world} does not have; its actions are {_join_names(known)}{meant}",
                )
    if limit is not None and block.max_steps > limit:
        more = f"options = {{ max_steps = {block.max_steps} }} if it has that option"
        asked = f"ask for {limit} or fewer, or give the world more with {more}"
        yield "max_steps", f"is {block.max_steps}, but {block.world} ends an episode after {limit} steps; {asked}"


def _join_names(names: tuple[str, ...]) -> str:
    return ", ".join(names)


def _explain_world_error(block: BlockSpec, error: WorldError) -> str:
    """Why there is no such world, and which may have been meant."""
    reason = str(error).removeprefix(f"{block.world}: ")
    name = block.world.rpartition("/")[2].rpartition(":")[2]
    ours = [entry.id for entry in WORLDS]
    if block.world in ours:
        return reason
    if f"{_OURS}{name}" in ours:
        upstream = "miniworld" if name.startswith("MiniWorld") else "minigrid"
        return f"there is none of that name alone; write {_OURS + name!r}, or {f'{upstream}:{name}'!r} for the original"
    close = difflib.get_close_matches(block.world, ours, n=1) or difflib.get_close_matches(f"{_OURS}{name}", ours, n=1)
    meant = f"; did you mean {close[0]!r}? `minihuman worlds` lists ours" if close else ""
    return f"{reason}{meant}"
