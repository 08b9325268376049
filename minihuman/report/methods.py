"""The methods paragraph: what was played by whom with what, in words to copy, with versions and hashes."""

from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from itertools import pairwise

from minihuman.data.quality import Outline, Quality
from minihuman.report.results import FORMULAS, MEASURES
from minihuman.study.plan import EpisodePlan

_STATISTICS = ("pandas", "scipy")
_KEY_MAPS = {
    False: "which key did what had to be found out",
    True: "the keys and what they do were on the screen",
}


def methods(plans: Sequence[Outline], qualities: Sequence[Quality], simulated: int = 0) -> list[str]:
    """The paragraphs; ``plans`` and ``qualities`` are the sessions', ``simulated`` of which no person played."""
    return [_people(plans, simulated), *_blocks(plans), _measures(), _software(plans, qualities), _statistics()]


def knew_the_keys(plans: Sequence[Outline]) -> dict[str, list[str]]:
    """By block, the groups who came to it with the keys of the one before, which they knew by then.

    Everybody of a group did, and each key did the same: that a few draw the same keys again is chance.
    """
    knew: dict[str, dict[str, bool]] = {}
    for plan in plans:
        for before, one in pairwise(plan.blocks):
            of_block = knew.setdefault(one.block_name, {})
            of_block[plan.group] = of_block.get(plan.group, True) and _does(one) == _does(before)
    found = {block: sorted(group for group, did in groups.items() if did) for block, groups in knew.items()}
    return {block: groups for block, groups in found.items() if groups}


def _does(one: EpisodePlan) -> dict[str, int]:
    """What each key does, by the action's place in the block's list: worlds call the same actions by other names."""
    return {key: one.actions.index(action) for key, action in one.key_map.keys.items() if action in one.actions}


def _people(plans: Sequence[Outline], simulated: int) -> str:
    groups = Counter({plan.participant: plan.group for plan in plans}.values())
    told = ", ".join(f"{count} in group {group}" for group, count in sorted(groups.items()))
    sessions = len({plan.session for plan in plans})
    days = f" in {sessions} sessions" if sessions > 1 else ""
    by_hand = sum(plan.by_hand for plan in plans)
    chosen = f"; in {by_hand} sessions participant or group were chosen by hand" if by_hand else ""
    return (
        f"{sum(groups.values())} participants took part{days} ({told}{_nobody(plans, simulated)}). "
        f"{'Groups and keys' if any(plan.blocks for plan in plans) else 'Groups'} came from an allocation list "
        f"drawn before the first session from the study's seed, {plans[0].seed}{chosen}.{_strata(plans)}"
    )


def _strata(plans: Sequence[Outline]) -> str:
    """Within which strata groups were drawn, and how many of each group each has."""
    drawn = {plan.participant: (plan.stratum, plan.group) for plan in plans if plan.stratum}
    if not drawn:
        return ""
    many = Counter(drawn.values())
    groups = sorted({group for _, group in many})
    told = "; ".join(
        f"{stratum}: {', '.join(f'{group} {many[stratum, group]}' for group in groups)}"
        for stratum in sorted({stratum for stratum, _ in many})
    )
    asked = next(plan.stratified_by for plan in plans if plan.stratified_by)
    return f" Groups were drawn after the answer to {asked}, within strata that have a list each ({told})."


def _nobody(plans: Sequence[Outline], simulated: int) -> str:
    if not simulated:
        return ""
    return "; all of them simulated" if simulated == len(plans) else f"; {simulated} sessions of them simulated"


def _blocks(plans: Sequence[Outline]) -> list[str]:
    first: dict[str, EpisodePlan] = {}
    for plan in sorted(plans, key=lambda plan: -len(plan.blocks)):  # in the order of those who played most
        for episode in plan.blocks:
            first.setdefault(episode.block_name, episode)
    knew = knew_the_keys(plans)
    return [_block(name, episode, _carried(knew.get(name, []))) for name, episode in first.items()]


def _carried(knew: Sequence[str]) -> str:
    return f" (not by {', '.join(knew)}: the keys were those of the block before)" if knew else ""


def _block(name: str, one: EpisodePlan, carried: str) -> str:
    options = "".join(f", {option} = {value!r}" for option, value in sorted(one.options.items()))
    pace = (
        f"a step was made every {one.step_period_ms:g} ms"
        if one.pace == "real_time"
        else "each press of a key made one step"
    )
    return (
        f"Block {name}: {one.episodes_in_block} episodes in {one.world}{options}, {one.view} view, at most "
        f"{one.max_steps} steps each; {pace}; actions {', '.join(one.actions)} on {len(one.key_map.keys)} keys of "
        f"{len(one.key_map.keys) + len(one.key_map.spare_keys)}; {_KEY_MAPS[one.show_keys]}"
        f"{'' if one.show_keys else carried}."
    )


def _measures() -> str:
    told = "; ".join(f"{MEASURES[name]} \N{EN DASH} {formula}" for name, formula in FORMULAS.items())
    return f"A participant's value is the mean over the episodes that count, unless something else is said. {told}."


def _software(plans: Sequence[Outline], qualities: Sequence[Quality]) -> str:
    protocols = sorted({(plan.version, plan.protocol_sha256) for plan in plans})
    told = "; ".join(f"version {name}, SHA-256 {sha}" for name, sha in protocols)
    words = {
        "version_minihuman": "minihuman", "git_commit": "commit", "rules": "rules of the worlds", "python": "Python",
        "version_numpy": "NumPy", "system": "on", "window_version": "shown by",
    }  # fmt: skip
    made = []
    for name, word in words.items():
        values = sorted({run[name] for one in qualities for run in one.software if name in run})
        if values:
            made.append(f"{word} {' and '.join(values)}")
    return f"Protocol of study {plans[0].study}: {told}. Run with {', '.join(made)}."


def _statistics() -> str:
    versions = ", ".join(f"{name} {version(name)}" for name in ("minihuman", *_STATISTICS))
    return f"This report: {versions}."
