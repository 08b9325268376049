"""Dry run of a protocol: describe a session plan as text, and create and play the world of every block."""

import difflib
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress

import gymnasium
import msgspec

from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.team.plan import TeamPlayPlan
from minihuman.errors import ProtocolError, WorldError
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.machine.bindings import Bindings
from minihuman.experiment.machine.points import compute_bonus
from minihuman.experiment.machine.running_episode import check_bindings
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.part_plans import list_world_options
from minihuman.experiment.plan.session_plan import BonusSpec, EpisodePlan, PlannedPart, SessionPlan
from minihuman.experiment.plan.stimulus_check import check_stimuli
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import list_question_kinds
from minihuman.experiment.protocol.strata import build_strata
from minihuman.experiment.protocol.validation_errors import build_protocol_error
from minihuman.experiment.words import LANGUAGES, LATER_WORDS, flatten_words, list_missing_kind_words
from minihuman.worlds.action_names import join_action_names
from minihuman.worlds.adapters.spaces import VectorActions
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import TEAM_WORLDS, WORLDS
from minihuman.worlds.conformance import ConformanceReport, Rehearsal, examine_world
from minihuman.worlds.contract import NativeWorld
from minihuman.worlds.second_process import play_in_second_process


def describe_plan(plan: SessionPlan) -> Iterator[str]:
    """Yield lines that describe a session's settings and everything that its participant will do, part by part."""
    participant = plan.participant
    yield f"study        {plan.study} {plan.study_version}, seed {plan.study_seed}, language {plan.language}"
    yield f"protocol     SHA-256 {plan.protocol_sha256}"
    if plan.allocation_sha256:
        yield f"allocation   SHA-256 {plan.allocation_sha256}"
    stratum = f", stratum {participant.stratum}" if participant.stratum else ""
    yield f"participant  {participant.id}, group {participant.group}{stratum}, session {plan.session}"
    consent = f"SHA-256 {plan.consent_sha256}" if plan.consent_text else "not asked for"
    yield f"consent      {consent}"
    keys = " ".join(plan.key_pool)
    if plan.keyboard_check:
        keys += ", each checked first"
    yield f"keys         {keys}"
    if plan.bonus:
        most = "" if plan.bonus.most is None else f", at most {plan.bonus.most:g}"
        yield f"bonus        {plan.bonus.base:g} + {plan.bonus.per_point:g} a point{most} {plan.bonus.currency}"
        yield from _describe_pay(plan, plan.bonus)
    for number, part in enumerate(plan.parts, 1):
        yield ""
        yield from _describe_part(plan, number, part)


def _describe_pay(plan: SessionPlan, bonus: BonusSpec) -> Iterator[str]:
    """Yield a line on the pay for each way in which a session with partners can end; nothing without partners."""
    teams = [part.plan.team for part in plan.parts if isinstance(part.plan, TeamPlayPlan)]
    teams = [team for team in teams if len(team.persons) > 1]
    if not teams:
        return
    waiting = ""
    if bonus.waiting_per_min:
        lobby_min = sum(team.lobby_s for team in teams) / 60
        waiting = f", and {bonus.waiting_per_min:g} for each minute in a lobby, at most {lobby_min:g} min"
    least = f"at least {compute_bonus(bonus, 0.0, stranded=True):g}"
    pay_without_partner = {"end": least, "agent": "as if played, with a stand-in"}
    without_partner = " or ".join(dict.fromkeys(pay_without_partner[team.partner_leaves] for team in teams))
    yield f"pay          all played: the bonus{waiting}"
    yield f"pay          no partner: {without_partner}{waiting}"
    yield f"pay          partner left: {without_partner}{waiting}"
    yield f"pay          screened out: {least}{waiting}"
    yield f"pay          left early: the bonus for the points until then{waiting}"


def list_missing_words(protocol: Protocol) -> Iterator[str]:
    """Yield a line for each interface text that the study's language lacks and English replaces.

    The text is newer than the study's own language, or belongs to a kind of question without texts in the language.
    """
    language = protocol.study.language
    missing_words: list[str] = []
    if language not in LANGUAGES:
        missing_words += LATER_WORDS
    for kind in list_question_kinds(protocol.questions, [group.name for group in protocol.groups]):
        missing_words += list_missing_kind_words(kind, language)
    for word in dict.fromkeys(missing_words):
        if word not in flatten_words(protocol.words):
            table, _, name = word.rpartition(".")
            yield f"language {language!r} has no word for {word}, so English stands in; add {name} to [words.{table}]"


def describe_strata(protocol: Protocol) -> Iterator[str]:
    """Yield lines that describe a study's strata and how many slots each group has in them; nothing without strata."""
    strata = build_strata(protocol)
    if strata is None:
        return
    n_slots = Counter((slot.stratum, slot.group) for slot in build_allocation_list(protocol))
    yield ""
    if (design := protocol.allocation.design) is not None:
        yield f"strata of {strata.question}: {', '.join(strata.names)}; {design.name} assigns groups after the answer"
        return
    yield f"strata of {strata.question}: the group is drawn after the answer, from the stratum's own list"
    for name in strata.names:
        groups = ", ".join(f"{group.name} {n_slots[name, group.name]}" for group in protocol.groups)
        yield f"  {name}  of the first {protocol.study.participants}: {groups}"


def _describe_part(plan: SessionPlan, number: int, part: PlannedPart) -> Iterator[str]:
    match part.plan:
        case PlayPlan() as play:
            yield from _describe_block(plan, number, play)
        case PagePlan() as page:
            yield f"part {number}: {part.name}, {_describe_page(page)}"
        case QuestionsPlan() as questions:
            yield f"part {number}: {part.name}, {_format_count(len(questions.items), 'question')}"
            yield from _describe_questions(questions)
        case _:
            yield f"part {number}: {part.name}, {part.kind}"


def _describe_page(page: PagePlan) -> str:
    if page.agree:
        kind = "consent"
    elif page.closing:
        kind = "last words"
    else:
        kind = "page"
    description = f"{kind} of {_format_count(len(page.pages), 'page')}"
    if page.pictures:
        description += f", {len(page.pictures)} pictures"
    if page.example:
        description += ", an example of the world"
    return description


def _describe_questions(questions: QuestionsPlan) -> Iterator[str]:
    """Yield a line for each question, and one about attempts if any question has a correct answer."""
    for question in questions.items:
        correct_answer = "" if question.right is None else f", right: {question.right}"
        yield f"  {question.name}  {question.kind}{correct_answer}"
    if all(question.right is None for question in questions.items):
        return
    return_note = ""
    if questions.back_to is not None:
        return_note = f", wrong answers lead back to part {questions.back_to + 1}"
    consequence = "the session ends" if questions.failed == "end" else "the session goes on"
    yield f"  tries  {questions.tries}{return_note}, then {consequence}"


def _format_count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _describe_block(plan: SessionPlan, number: int, play: PlayPlan) -> Iterator[str]:
    """Yield lines that describe part ``number``, a block: its world, keys, pace, limits and episodes."""
    episodes = plan.episodes[play.first : play.first + play.count]
    first = episodes[0]
    options = "".join(f", {name}={option!r}" for name, option in first.options.items())
    summary = f"{first.block_name}, {first.world}{options}, {first.view} view, {first.palette}"
    yield f"part {number}: block {first.block + 1}, {summary}"
    yield from _describe_keys(play, first)
    yield f"  pace   {_describe_pace(first)}; at most {first.max_steps} steps"
    yield f"  in a browser computed by the {play.computed}"
    if play.motion_ms:
        yield f"  view   moves for {play.motion_ms:g} ms from each picture to the next"
    yield from _describe_limits(play)
    yield from (f"  trial  {line}" for line in play.describe_trials(first.response_deadline_ms))
    if play.design:
        yield f"  design {play.design.name} chooses each episode, or ends the block, from the episodes before"
    for episode in episodes:
        yield f"  {episode.episode + 1:3}  episode {episode.episode_in_block + 1:2} of the block  seed {episode.seed}"
    if play.rest_s:
        yield f"  rest   {play.rest_s:g} s or longer afterwards"


def _describe_keys(play: PlayPlan, episode: EpisodePlan) -> Iterator[str]:
    """Yield a line with the keys of a block, or one for each seat of a team; ``episode`` is the block's first."""
    visibility = " (shown)" if episode.show_keys else ""
    if isinstance(play, TeamPlayPlan) and play.team.seat_keys:
        for seat, actions_by_key in enumerate(play.team.seat_keys):
            yield f"  keys   seat {seat}: {_format_keys(actions_by_key)}{visibility}"
    else:
        yield f"  keys   {_format_keys(episode.key_map.keys)}{visibility}"


def _format_keys(actions_by_key: Mapping[str, str]) -> str:
    return ", ".join(f"{key} {action}" for key, action in sorted(actions_by_key.items()))


def _describe_pace(episode: EpisodePlan) -> str:
    if episode.pace == "real_time":
        return _describe_real_time(episode)
    pace = "one press one step"
    if episode.response_deadline_ms:
        pace += f", {episode.noop} after {episode.response_deadline_ms:g} ms"
    if episode.auto_repeat:
        pace += ", held keys repeat"
    return pace


def _describe_real_time(episode: EpisodePlan) -> str:
    pace = f"a step every {episode.step_period_ms:g} ms"
    if episode.hold == "repeat":
        pace += ", as long as its key is held"
    onset = "the first picture" if episode.onset_at_reset else "the world's info['onset'], NULL where it names none"
    return f"{pace}, without a key {episode.noop or 'none'}; response_ms from {onset}"


def _describe_limits(play: PlayPlan) -> Iterator[str]:
    """Yield a line each about a block's stop criterion, time limits and points, as far as it has them."""
    if play.until:
        yield f"  until  {play.until.successes} of the last {play.until.of} reach the goal, then {play.until.otherwise}"
    limits_s = {"episode": play.max_s, "block": play.block_max_s}
    limits = [f"{name} {limit_s:g} s" for name, limit_s in limits_s.items() if limit_s]
    if limits:
        yield f"  time   at most {', '.join(limits)}"
    if play.points:
        point_rules = {"goal": play.points.goal, "timeout": play.points.timeout, "failure": play.points.failure}
        point_rules |= {"a step": play.points.per_step, "a reward of 1": play.points.per_reward}
        points = [f"{name} {number:+g}" for name, number in point_rules.items() if number]
        yield f"  points {', '.join(points)}"


_OWN_NAMESPACE = "minihuman/"

N_TRIED_SEEDS = 5  # layouts that are tried for a block without seeds of its own
N_CHECKED_STEPS = 300  # of a foreign world that `check` plays, over several episodes
N_STARTED_STEPS = 60  # of a foreign world that are played before sessions begin
MOVING_FPS = 15  # frames per second of a world that moves: 15 to 50 in Gymnasium, where its puzzles have 4


def check_worlds(protocol: Protocol, source: str = "protocol", *, provable: bool = False) -> list[str]:
    """Create every block's world, check its actions, and play it; ``source`` names the protocol's file in errors.

    If ``provable`` is true, a foreign world whose logs could not be proven is refused too. Callers set it before a
    study begins; a study that is running is not stopped by it.

    Returns:
        Notices about foreign worlds, one per line.

    Raises:
        ProtocolError: if worlds contradict the protocol, naming every such block, or if a world cannot be played.
    """
    _check_actions(protocol, source)
    notices: dict[str, None] = {}  # in order, each once
    examined: dict[bytes, ConformanceReport] = {}
    for number, block in enumerate(protocol.blocks):
        path = f"{source}: $.blocks[{number}].world: {block.world}"
        try:
            try_world(block)
        except Exception as error:  # a bug of ours, as foreign worlds' errors are WorldErrors
            reason = str(error) if isinstance(error, WorldError) else f"{type(error).__name__}: {error}"
            raise ProtocolError(f"{path} cannot be played ({reason.removeprefix(f'{block.world}: ')})") from error
        report = _examine_block(block, examined, provable=provable)
        world_notices = _judge_report(report, block, path, provable=provable)
        notices |= dict.fromkeys(f"{block.world}: {notice}" for notice in world_notices)
        notices |= dict.fromkeys(_list_block_notices(block))
    notices |= dict.fromkeys(check_stimuli(protocol, source))
    return list(notices)


def _judge_report(report: ConformanceReport, block: BlockSpec, path: str, *, provable: bool) -> list[str]:
    """Return the notices in the report on a block's world; raise ProtocolError, at ``path``, if it must be refused."""
    if report.broken:
        raise ProtocolError(f"{path} cannot be played ({report.broken[0]})")
    faults = list(report.unsound)
    notices = list(report.notices)
    if block.record_observations:  # recorded observations replace the proof of a world that cannot be replayed
        notices += report.unprovable
    else:
        faults += report.unprovable
    if provable and faults:
        raise ProtocolError(f"{path}: {faults[0]}")
    return notices


def _examine_block(block: BlockSpec, examined: dict[bytes, ConformanceReport], *, provable: bool) -> ConformanceReport:
    """Return the report on a block's world, played as participants will; ``examined`` keeps all reports."""
    rehearsal = _build_rehearsal(block, N_CHECKED_STEPS if provable else N_STARTED_STEPS)
    key = msgspec.json.encode(rehearsal)
    if key not in examined:
        examined[key] = examine_world(rehearsal, play_in_second_process if provable else None)
    return examined[key]


def _build_rehearsal(block: BlockSpec, steps: int) -> Rehearsal:
    """Return the settings with which a conformance check plays ``steps`` steps of a block as participants will."""
    seeds = tuple(dict.fromkeys(_list_tried_seeds(block)))
    options = list_world_options(block)
    with closing(World(block.world, options)) as world:
        world.name_actions(block.actions)
        names = dict.fromkeys((*block.actions, *block.distractors, *filter(None, (block.noop_action,))))
        numbers = tuple(world.action_names.index(name) for name in names)
    return Rehearsal(
        block.world,
        options,
        seeds[:N_TRIED_SEEDS],
        numbers,
        view=block.view,
        palette=block.palette,
        max_steps=block.max_steps,
        steps=steps,
    )


def _list_tried_seeds(block: BlockSpec) -> Sequence[int]:
    if isinstance(block.seeds, tuple):
        return block.seeds
    return range(N_TRIED_SEEDS)


def _list_block_notices(block: BlockSpec) -> Iterator[str]:
    """Yield notices about the way in which a block plays a foreign world."""
    with closing(World(block.world, list_world_options(block))) as world:
        if world.is_built_in or isinstance(world.unwrapped, NativeWorld):
            return
        world.name_actions(block.actions)
        unused = []
        if world.actions.is_discrete:
            used = {*block.actions, *block.distractors, block.noop_action}
            unused = [name for name in world.action_names if name not in used]
        fps = world.unwrapped.metadata.get("render_fps")
    if unused:
        yield f"block {block.name!r}: no key does {join_action_names(unused)}"
    if not isinstance(fps, int | float) or not fps:
        if block.pace == "real_time":
            period = f"{block.step_period_ms:g} ms a step"
            yield f"block {block.name!r}: {block.world} states no frame rate for its {period}"
        return
    waits_for_keys = block.pace == "on_key" and not block.response_deadline_ms and block.noop_action is None
    if waits_for_keys and fps >= MOVING_FPS:
        yield (
            f"block {block.name!r}: {block.world} states {fps} frames a second and steps only when a key is pressed; "
            "if it is to move by itself, set pace = 'real_time', and noop_action if one of its actions does nothing"
        )


def describe_worlds(protocol: Protocol, notices: Sequence[str] | None = None) -> Iterator[str]:
    """Yield the ``notices`` of `check_worlds` (computed here if None), actions that blocks lack, and compiled rules."""
    yield from check_worlds(protocol) if notices is None else notices
    for block in protocol.blocks:
        missing_actions = sorted(_find_missing_actions(block))
        if missing_actions:
            yield (
                f"block {block.name!r}: the shortest path to success uses {', '.join(missing_actions)}, which its "
                "actions lack; add them unless success needs none of them"
            )
    for block in protocol.blocks:
        yield from _describe_rules(block)


def _describe_rules(block: BlockSpec) -> Iterator[str]:
    """Yield a line on whether the rules of a block's world are compiled, if they were written in Python for a grid."""
    with closing(World(block.world, block.options)) as world:
        env = world.unwrapped
        if world.is_built_in or not hasattr(env, "own_fields"):
            return
        # imported here, since only a world with rules of its own needs the translation
        from minihuman.worlds.grid.own.programs import describe_rules

        yield f"block {block.name!r}: layout and rules of {type(env).__name__}: {describe_rules(env)}"


def _find_missing_actions(block: BlockSpec) -> set[str]:
    """Return the actions on the shortest paths of a block's first layouts that are not among the block's actions."""
    seeds = _list_tried_seeds(block)
    with closing(World(block.world, block.options)) as world:
        return find_needed_actions(world, seeds) - set(block.actions)


def find_needed_actions(world: World, seeds: Sequence[int] = range(N_TRIED_SEEDS)) -> set[str]:
    """Return the actions on shortest paths to success from the first `N_TRIED_SEEDS` seeds; empty without a planner."""
    needed: set[str] = set()
    if not isinstance(world.unwrapped, NativeWorld):
        return needed
    for seed in seeds[:N_TRIED_SEEDS]:
        world.reset(seed)
        with suppress(WorldError):  # planning would take too long
            needed |= set(world.shortest_path() or ())
    return needed


def list_world_notices(world: World) -> list[str]:
    """Return notices about a world, created anew and played; none for built-in worlds with numbered actions."""
    if world.is_built_in and not isinstance(world.actions, VectorActions):
        return []
    rehearsal = Rehearsal(world.id, world.options, (0,), tuple(world.actions.numbers), steps=N_STARTED_STEPS)
    report = examine_world(rehearsal)
    return [*report.broken, *report.unsound, *report.unprovable, *report.notices]


def try_world(block: BlockSpec) -> None:
    """Use a block's world as its episodes do, with each layout and action; raise WorldError if it cannot be used."""
    seeds = sorted(set(_list_tried_seeds(block)))
    world = World(block.world, block.options)
    try:
        world.name_actions(block.actions)
        for seed in seeds:
            world.reset(seed)
        for action in (*block.actions, *block.distractors):
            world.reset(seeds[0])
            world.map()
            world.pose()
            world.state_hash()
            world.step(world.action_names.index(action))
        world.frame(block.view, palette=block.palette)
    finally:
        world.close()


def _check_actions(protocol: Protocol, source: str) -> None:
    """Raise a ProtocolError that names every field of a block that contradicts the block's world."""
    text = protocol.toml.decode("utf-8-sig")
    errors = []
    for number, block in enumerate(protocol.blocks):
        errors += [(f"$.blocks[{number}].{field}", message) for field, message in _find_world_errors(block)]
    error = build_protocol_error(errors, source=source, text=text, tree=tomllib.loads(text))
    if error:
        raise error


def _find_world_errors(block: BlockSpec) -> Iterator[tuple[str, str]]:
    """Yield a (field, message) for each field of a block that contradicts the block's world."""
    try:
        world = World(block.world, list_world_options(block))
        limit = world.step_limit
    except WorldError as error:
        yield "world", f"is {block.world!r}: {_explain_world_error(block, error)}"
        return
    with closing(world):
        world.name_actions(block.actions)
        action_names = world.action_names
        yield from _find_misused_fields(block, world)
    yield from _find_unknown_actions(block, action_names)
    if limit is not None and block.max_steps > limit:
        more = f"options = {{ max_steps = {block.max_steps} }} if it has that option"
        advice = f"ask for {limit} or fewer, or give the world more with {more}"
        yield "max_steps", f"is {block.max_steps}, but {block.world} ends an episode after {limit} steps; {advice}"


def _find_misused_fields(block: BlockSpec, world: World) -> Iterator[tuple[str, str]]:
    """Yield a (field, message) for each field of a block that requires something its world cannot do."""
    if not find_kind(block.kind).is_played_alone and not world.actions.is_discrete:
        reason = f"but {block.world} has {world.action_space}; its agents choose Discrete actions"
        yield "kind", f"is {block.kind!r}, {reason}"
    if block.computed == "page" and not world.is_compiled:
        reason = "but its rules or pictures are Python, or it lacks options.trig = 1; leave it out, or use 'server'"
        yield "computed", f"is 'page' for {block.world}, {reason}"
    if block.team is not None and block.team.ping:
        world.reset(0)
        plan = world.map()
        if block.view != "full" or plan is None or plan.unit != "cell":
            yield "team.ping", "marks a cell of the whole picture; use it in a grid with view = 'full', or leave it out"
    if block.axes or block.spot:
        try:
            check_bindings(world, Bindings(block.axes, block.spot))
        except WorldError as error:
            yield "spot" if block.spot else "axes", f"cannot act: {error}"


def _find_unknown_actions(block: BlockSpec, action_names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield a (field, message) for each action of a block that is not among its world's actions."""
    fields_and_names = [("actions", name) for name in block.actions]
    fields_and_names += [("distractors", name) for name in block.distractors]
    if block.noop_action:
        fields_and_names.append(("noop_action", block.noop_action))
    for field, name in fields_and_names:
        if name in action_names:
            continue
        message = f"names {name!r}, which {block.world} does not have; its actions are {', '.join(action_names)}"
        for similar in difflib.get_close_matches(name, action_names, n=1):
            message += f"; did you mean {similar!r}?"
        yield field, message


def _explain_world_error(block: BlockSpec, error: WorldError) -> str:
    """Return why a block's world could not be made; for an unknown id, with a similar one."""
    reason = str(error).removeprefix(f"{block.world}: ")
    own_ids = [entry.id for entry in (*WORLDS, *TEAM_WORLDS)]
    if block.world in own_ids or not isinstance(error.__cause__, gymnasium.error.UnregisteredEnv):
        return reason
    name = re.split("[/:]", block.world)[-1]
    own_id = f"{_OWN_NAMESPACE}{name}"
    if own_id in own_ids:
        upstream = "miniworld" if name.startswith("MiniWorld") else "minigrid"
        original_id = f"{upstream}:{name}"
        return f"there is none of that name alone; write {own_id!r}, or {original_id!r} for the original"
    similar = difflib.get_close_matches(block.world, own_ids, n=1) or difflib.get_close_matches(own_id, own_ids, n=1)
    if similar:
        return f"{reason}; did you mean {similar[0]!r}? `minihuman worlds` lists ours"
    return reason
