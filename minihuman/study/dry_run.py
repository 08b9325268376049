"""A session's plan as lines to read: the experimenter's dry run."""

from collections import Counter
from collections.abc import Iterator

from minihuman.study.activities.pages import PagePlan
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.activities.questions import QuestionsPlan
from minihuman.study.allocation import allocation
from minihuman.study.plan import EpisodePlan, Part, SessionPlan
from minihuman.study.protocol import Protocol
from minihuman.study.strata import strata_of


def lines(plan: SessionPlan) -> Iterator[str]:
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
        yield from _part(plan, number, part)


def strata_lines(protocol: Protocol) -> Iterator[str]:
    """How many slots of each group each stratum has, where groups are drawn after an answer."""
    strata = strata_of(protocol)
    if strata is None:
        return
    of_each = Counter((slot.stratum, slot.group) for slot in allocation(protocol))
    yield ""
    yield f"strata of {strata.question}: the group is drawn after the answer, from the stratum's own list"
    for name in strata.names:
        groups = ", ".join(f"{group.name} {of_each[name, group.name]}" for group in protocol.groups)
        yield f"  {name}  of the first {protocol.study.participants}: {groups}"


def _part(plan: SessionPlan, number: int, part: Part) -> Iterator[str]:
    match part.plan:
        case PlayPlan() as play:
            yield from _block(plan, number, play)
        case PagePlan() as page:
            what = "consent" if page.agree else "last words" if page.closing else "page"
            pictures = f", {len(page.pictures)} pictures" if page.pictures else ""
            example = ", an example of the world" if page.example else ""
            yield f"part {number}: {part.name}, {what} of {_count(len(page.pages), 'page')}{pictures}{example}"
        case QuestionsPlan() as asked:
            yield f"part {number}: {part.name}, {_count(len(asked.items), 'question')}"
            for item in asked.items:
                right = "" if item.right is None else f", right: {item.right}"
                yield f"  {item.name}  {item.kind}{right}"
            if any(item.right is not None for item in asked.items):
                back = "" if asked.back_to is None else f", wrong answers lead back to part {asked.back_to + 1}"
                then = "the session ends" if asked.failed == "end" else "the session goes on"
                yield f"  tries  {asked.tries}{back}, then {then}"
        case _:
            yield f"part {number}: {part.name}, {part.kind}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _block(plan: SessionPlan, number: int, play: PlayPlan) -> Iterator[str]:
    episodes = plan.episodes[play.first : play.first + play.count]
    first = episodes[0]
    options = "".join(f", {name}={value!r}" for name, value in first.options.items())
    what = f"{first.block_name}, {first.world}{options}, {first.view} view, {first.palette}"
    yield f"part {number}: block {first.block + 1}, {what}"
    keys = ", ".join(f"{key} {action}" for key, action in sorted(first.key_map.keys.items()))
    yield f"  keys   {keys}{' (shown)' if first.show_keys else ''}"
    yield f"  pace   {_pace(first)}; at most {first.max_steps} steps"
    yield from _limits(play)
    for episode in episodes:
        yield f"  {episode.episode + 1:3}  episode {episode.episode_in_block + 1:2} of the block  seed {episode.seed}"
    if play.rest_s:
        yield f"  rest   {play.rest_s:g} s or longer afterwards"


def _pace(first: EpisodePlan) -> str:
    if first.pace == "real_time":
        return f"a step every {first.step_period_ms:g} ms, without a key {first.noop or 'none'}"
    return "one press one step" + (", held keys repeat" if first.auto_repeat else "")


def _limits(play: PlayPlan) -> Iterator[str]:
    if play.until:
        yield f"  until  {play.until.successes} of the last {play.until.of} reach the goal, then {play.until.otherwise}"
    limits = [f"{name} {value:g} s" for name, value in (("episode", play.max_s), ("block", play.block_max_s)) if value]
    if limits:
        yield f"  time   at most {', '.join(limits)}"
    if play.points:
        each = {"goal": play.points.goal, "timeout": play.points.timeout, "failure": play.points.failure}
        each |= {"a step": play.points.per_step, "a reward of 1": play.points.per_reward}
        yield f"  points {', '.join(f'{name} {value:+g}' for name, value in each.items() if value)}"
