"""The methods paragraph: what was played by whom with what, in words to copy, with versions and hashes."""

from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version

from minihuman.data.quality import Outline, Quality
from minihuman.study.plan import EpisodePlan

_STATISTICS = ("pandas", "scipy")
_KEY_MAPS = {
    False: "which key did what had to be found out",
    True: "the keys and what they do were on the screen",
}


def methods(plans: Sequence[Outline], qualities: Sequence[Quality]) -> list[str]:
    """The paragraphs; ``plans`` and ``qualities`` are the sessions'."""
    return [_people(plans), *_blocks(plans), _software(plans, qualities), _statistics()]


def _people(plans: Sequence[Outline]) -> str:
    groups = Counter({plan.participant: plan.group for plan in plans}.values())
    told = ", ".join(f"{count} in group {group}" for group, count in sorted(groups.items()))
    sessions = len({plan.session for plan in plans})
    days = f" in {sessions} sessions" if sessions > 1 else ""
    by_hand = sum(plan.by_hand for plan in plans)
    chosen = f"; in {by_hand} sessions participant or group were chosen by hand" if by_hand else ""
    return (
        f"{sum(groups.values())} participants took part{days} ({told}). Groups and keys came from an allocation list "
        f"drawn before the first session from the study's seed, {plans[0].seed}{chosen}."
    )


def _blocks(plans: Sequence[Outline]) -> list[str]:
    first: dict[str, EpisodePlan] = {}
    for plan in plans:
        for episode in plan.blocks:
            first.setdefault(episode.block_name, episode)
    return [_block(name, episode) for name, episode in first.items()]


def _block(name: str, one: EpisodePlan) -> str:
    options = "".join(f", {option} = {value!r}" for option, value in sorted(one.options.items()))
    pace = (
        f"a step was made every {one.step_period_ms:g} ms"
        if one.pace == "real_time"
        else "each press of a key made one step"
    )
    return (
        f"Block {name}: {one.episodes_in_block} episodes in {one.world}{options}, {one.view} view, at most "
        f"{one.max_steps} steps each; {pace}; actions {', '.join(one.actions)} on {len(one.key_map.keys)} keys of "
        f"{len(one.key_map.keys) + len(one.key_map.spare_keys)}; {_KEY_MAPS[one.show_keys]}."
    )


def _software(plans: Sequence[Outline], qualities: Sequence[Quality]) -> str:
    protocols = sorted({(plan.version, plan.protocol_sha256) for plan in plans})
    told = "; ".join(f"version {name}, SHA-256 {sha}" for name, sha in protocols)
    words = {
        "version_minihuman": "minihuman", "git_commit": "commit", "rules": "rules of the worlds", "python": "Python",
        "version_numpy": "NumPy", "system": "on", "window_version": "shown by",
    }  # fmt: skip
    made = []
    for name, word in words.items():
        values = sorted({one.software[name] for one in qualities if name in one.software})
        if values:
            made.append(f"{word} {' and '.join(values)}")
    return f"Protocol of study {plans[0].study}: {told}. Run with {', '.join(made)}."


def _statistics() -> str:
    versions = ", ".join(f"{name} {version(name)}" for name in ("minihuman", *_STATISTICS))
    return f"This report: {versions}."
