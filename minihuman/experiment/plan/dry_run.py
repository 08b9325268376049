"""Dry run of a protocol: describe a session plan as text, and make and play the world of every block."""

import difflib
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress

import msgspec

from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.team.plan import TeamPlayPlan
from minihuman.errors import ProtocolError, WorldError
from minihuman.experiment.machine.bindings import Bindings
from minihuman.experiment.machine.points import compute_bonus
from minihuman.experiment.machine.running_episode import check_bindings
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.expansion import list_world_options
from minihuman.experiment.plan.session_plan import BonusSpec, EpisodePlan, PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.experiment.protocol.validation_errors import build_protocol_error
from minihuman.worlds.adapters.spaces import VectorActions
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import TEAM_WORLDS, WORLDS
from minihuman.worlds.contract import NativeWorld


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
        yield from _describe_pay(plan, plan.bonus)
    for number, part in enumerate(plan.parts, 1):
        yield ""
        yield from _describe_part(plan, number, part)


def _describe_pay(plan: SessionPlan, bonus: BonusSpec) -> Iterator[str]:
    """What each ending of a session with partners pays."""
    teams = [part.plan.team for part in plan.parts if isinstance(part.plan, TeamPlayPlan)]
    teams = [team for team in teams if len(team.persons) > 1]
    if not teams:
        return
    rate, wait_s = bonus.waiting_per_min or 0.0, sum(team.lobby_s for team in teams)
    waiting = f", and {rate:g} for each minute in a lobby, at most {wait_s / 60:g} min" if rate else ""
    least = f"at least {compute_bonus(bonus, 0.0, stranded=True):g}"
    after = {"end": least, "agent": "as if played, with a stand-in"}
    pay = {
        "all played": f"the bonus{waiting}",
        "no partner": " or ".join(dict.fromkeys(after[team.partner_leaves] for team in teams)) + waiting,
        "partner left": " or ".join(dict.fromkeys(after[team.partner_leaves] for team in teams)) + waiting,
        "screened out": least + waiting,
        "left early": f"the bonus for the points until then{waiting}",
    }
    yield from (f"pay          {case}: {amount}" for case, amount in pay.items())


def describe_strata(protocol: Protocol) -> Iterator[str]:
    """How many slots of each group each stratum has, where groups are drawn after an answer."""
    strata = build_strata(protocol)
    if strata is None:
        return
    of_each = Counter((slot.stratum, slot.group) for slot in build_allocation_list(protocol))
    yield ""
    if (design := protocol.allocation.design) is not None:
        yield f"strata of {strata.question}: {', '.join(strata.names)}; {design.name} assigns groups after the answer"
        return
    yield f"strata of {strata.question}: the group is drawn after the answer, from the stratum's own list"
    for name in strata.names:
        groups = ", ".join(f"{group.name} {of_each[name, group.name]}" for group in protocol.groups)
        yield f"  {name}  of the first {protocol.study.participants}: {groups}"


def _describe_part(plan: SessionPlan, number: int, part: PlannedPart) -> Iterator[str]:
    match part.plan:
        case PlayPlan() as play:
            yield from _describe_block(plan, number, play)
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


def _describe_block(plan: SessionPlan, number: int, play: PlayPlan) -> Iterator[str]:
    episodes = plan.episodes[play.first : play.first + play.count]
    first = episodes[0]
    options = "".join(f", {name}={value!r}" for name, value in first.options.items())
    what = f"{first.block_name}, {first.world}{options}, {first.view} view, {first.palette}"
    yield f"part {number}: block {first.block + 1}, {what}"
    of_seats = play.team.seat_keys if isinstance(play, TeamPlayPlan) else ()
    for seat, its in enumerate(of_seats or (first.key_map.keys,)):
        keys = ", ".join(f"{key} {action}" for key, action in sorted(its.items()))
        yield f"  keys   {f'seat {seat}: ' if of_seats else ''}{keys}{' (shown)' if first.show_keys else ''}"
    yield f"  pace   {_describe_pace(first)}; at most {first.max_steps} steps"
    yield f"  in a browser computed by the {play.computed}"
    if play.motion_ms:
        yield f"  view   moves for {play.motion_ms:g} ms from each picture to the next"
    yield from _describe_limits(play)
    if play.design:
        yield f"  design {play.design.name} chooses each episode, or ends the block, from the episodes before"
    for episode in episodes:
        yield f"  {episode.episode + 1:3}  episode {episode.episode_in_block + 1:2} of the block  seed {episode.seed}"
    if play.rest_s:
        yield f"  rest   {play.rest_s:g} s or longer afterwards"


def _describe_pace(first: EpisodePlan) -> str:
    if first.pace == "real_time":
        onset = "the first picture" if first.onset_at_reset else "the world's info['onset'], NULL where it names none"
        held = ", as long as its key is held" if first.hold == "repeat" else ""
        rest = f"without a key {first.noop or 'none'}; response_ms from {onset}"
        return f"a step every {first.step_period_ms:g} ms{held}, {rest}"
    deadline = f", {first.noop} after {first.response_deadline_ms:g} ms" if first.response_deadline_ms else ""
    return "one press one step" + deadline + (", held keys repeat" if first.auto_repeat else "")


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

_PLAYED_KINDS = ("play", "trials")  # by a person alone
N_TRIED_SEEDS = 5  # that are laid out where a block does not say which


def check_worlds(protocol: Protocol, source: str = "protocol") -> None:
    """Make every block's world, look its actions up, and play it; ``source`` names the file in errors.

    Raises:
        ProtocolError: of every block whose world is not as it says, or at the first whose world cannot be played.
    """
    _check_actions(protocol, source)
    for number, block in enumerate(protocol.blocks):
        try:
            try_world(block)
        except Exception as error:  # whatever a lab's world may raise
            reason = str(error) if isinstance(error, WorldError) else f"{type(error).__name__}: {error}"
            raise ProtocolError(
                f"{source}: $.blocks[{number}].world: {block.world} cannot be played ({reason})"
            ) from error


N_REPLAYS, N_REPLAYED_STEPS = 3, 40


def describe_worlds(protocol: Protocol) -> Iterator[str]:
    """Yield what to know of worlds: parts of actions without a key, no replay, no copy; of ours, actions missed."""
    for made_from in dict.fromkeys((block.world, msgspec.json.encode(block.options)) for block in protocol.blocks):
        with closing(World(made_from[0], msgspec.json.decode(made_from[1]))) as world:
            yield from (f"{world.id}: {notice}" for notice in list_world_notices(world))
    for block in protocol.blocks:
        if missed := _find_missed_actions(block):
            yield (
                f"block {block.name!r}: the shortest path to success uses {', '.join(sorted(missed))}, which its "
                "actions lack; add them unless success needs none of them"
            )


def _find_missed_actions(block: BlockSpec) -> set[str]:
    """What the planner would do in a block's first layouts and participants cannot."""
    seeds = block.seeds if isinstance(block.seeds, tuple) else range(N_TRIED_SEEDS)
    with closing(World(block.world, block.options)) as world:
        return find_needed_actions(world, seeds) - set(block.actions)


def find_needed_actions(world: World, seeds: Sequence[int] = range(N_TRIED_SEEDS)) -> set[str]:
    """The actions of the shortest paths to success in a world's first layouts; none where it cannot be planned."""
    needed: set[str] = set()
    for seed in seeds[:N_TRIED_SEEDS] if isinstance(world.unwrapped, NativeWorld) else ():
        world.reset(seed)
        with suppress(WorldError):  # planning would take too long
            needed |= set(world.shortest_path() or ())
    return needed


def list_world_notices(world: World) -> Iterator[str]:
    """Yield the same of one world, which is played for it."""
    if isinstance(world.actions, VectorActions) and world.actions.unbound:
        bound, whole = len(world.actions.rest) - world.actions.unbound, len(world.actions.rest)
        yield f"keys move the first {bound} of {whole} parts of an action; the others stay at rest"
    if isinstance(world.unwrapped, NativeWorld):
        return
    replays = [_replay(world) for _ in range(N_REPLAYS)]
    step = next((n for n, steps in enumerate(zip(*replays, strict=False)) if len(set(steps)) > 1), None)
    if step is not None:
        yield (
            f"nondeterministic: {N_REPLAYS} replays of one seed differ at step {step}, so no log of it can be proven; "
            "record_observations = true keeps what was seen"
        )
    try:
        world.save()
    except WorldError:
        yield "it cannot be copied, so a browser shows each step one round trip after its key"


def _replay(world: World) -> list[tuple[int, int, float]]:
    """State, observation and reward of an episode's first steps, with every action in turn."""
    found = [(world.reset(0).observation_hash, world.state_hash(), 0.0)]
    for number in range(N_REPLAYED_STEPS):
        done = world.step(world.actions.numbers[number // 3 % len(world.actions.numbers)])
        found.append((done.observation_hash, world.state_hash(), done.reward))
        if done.terminated or done.truncated:
            break
    return found


def try_world(block: BlockSpec) -> None:
    """Do everything once that an episode of a block does with its world, with each of its layouts and actions."""
    seeds = sorted(set(block.seeds)) if isinstance(block.seeds, tuple) else range(N_TRIED_SEEDS)
    world = World(block.world, block.options)
    try:
        world.name_actions(block.actions)
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
        world = World(block.world, list_world_options(block))
    except WorldError as error:
        yield "world", f"is {block.world!r}: {_explain_world_error(block, error)}"
        return
    world.name_actions(block.actions)
    known, limit = world.action_names, world.step_limit
    if block.kind not in _PLAYED_KINDS and not world.actions.is_discrete:
        yield (
            "kind",
            f"is {block.kind!r}, but {block.world} has {world.action_space}; its agents choose Discrete actions",
        )
    if block.computed == "page" and not world.is_compiled:
        what = "but its rules or pictures are Python, or it lacks options.trig = 1; leave it out, or use 'server'"
        yield "computed", f"is 'page' for {block.world}, {what}"
    if block.team is not None and block.team.ping:
        world.reset(0)
        if block.view != "full" or (plan := world.map()) is None or plan.unit != "cell":
            yield "team.ping", "marks a cell of the whole picture; use it in a grid with view = 'full', or leave it out"
    if block.axes or block.spot:
        try:
            check_bindings(world, Bindings(block.axes, block.spot))
        except WorldError as error:
            yield "spot" if block.spot else "axes", f"cannot act: {error}"
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
                    f"names {name!r}, which {block.world} does not have; its actions are {', '.join(known)}{meant}",
                )
    if limit is not None and block.max_steps > limit:
        more = f"options = {{ max_steps = {block.max_steps} }} if it has that option"
        asked = f"ask for {limit} or fewer, or give the world more with {more}"
        yield "max_steps", f"is {block.max_steps}, but {block.world} ends an episode after {limit} steps; {asked}"


def _explain_world_error(block: BlockSpec, error: WorldError) -> str:
    """Why there is no such world, and which may have been meant."""
    reason = str(error).removeprefix(f"{block.world}: ")
    name = block.world.rpartition("/")[2].rpartition(":")[2]
    ours = [entry.id for entry in (*WORLDS, *TEAM_WORLDS)]
    if block.world in ours:
        return reason
    if f"{_OURS}{name}" in ours:
        upstream = "miniworld" if name.startswith("MiniWorld") else "minigrid"
        return f"there is none of that name alone; write {_OURS + name!r}, or {f'{upstream}:{name}'!r} for the original"
    close = difflib.get_close_matches(block.world, ours, n=1) or difflib.get_close_matches(f"{_OURS}{name}", ours, n=1)
    meant = f"; did you mean {close[0]!r}? `minihuman worlds` lists ours" if close else ""
    return f"{reason}{meant}"
