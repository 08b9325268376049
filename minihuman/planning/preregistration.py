"""A preregistration's text from a protocol: what registries ask for, as far as the protocol fixes it.

The order follows the OSF's and AsPredicted's forms. What only the researchers know is left as a line to fill in.
"""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

from minihuman import __version__
from minihuman.errors import ReportError
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import BlockSpec, ExclusionSpec, Protocol, decode_protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.operating_system import write_atomically
from minihuman.reporting.results import FORMULAS, MEASURES as MEANINGS, ONLY_IF_NAMED, label_measure

_POWER = {  # what the block table calls a measure, and what power does
    "log_excess_steps_mean": "log_excess_steps", "log_steps_ratio_mean": "log_steps_ratio", "spl_mean": "spl",
    "success": "success", "reward_mean": "reward", "steps_at_limit_mean": "steps_at_limit",
}  # fmt: skip
_KEYS = {
    "new": "on keys that are drawn for each participant and have to be found out",
    "carry_over": "on the keys of the block before where one was played, else drawn; they have to be found out",
    "constant": "on keys that are drawn once for each participant and kept; they have to be found out",
    "shown": "on keys that are drawn for each participant and shown on the screen",
    "fixed": "on keys that the protocol names",
}
_FILL_IN = "_To be written by the researchers._"


def build_preregistration(protocol: Protocol, plan: SessionPlan, power: str = "") -> str:
    """Write the text in Markdown; ``plan`` is any participant's, for the hashes, ``power`` the power analysis."""
    return "\n".join(_lines(protocol, plan, power)) + "\n"


def write_preregistration(protocol: Protocol, plan: SessionPlan, path: Path, power: str = "") -> Path:
    """Write it to a new file.

    Raises:
        ReportError: if there is such a file.
        OSError: if it cannot be written.
    """
    if path.exists():
        raise ReportError(f"{path} already exists and is not overwritten; choose another file")
    write_atomically(build_preregistration(protocol, plan, power), path)
    return path


def describe_planned_power(toml: bytes, effect: str, *, people: int = 60, studies: int = 500) -> str:
    """What the study's power is at half of its places a group, and at half and twice that.

    Raises:
        ReportError: if the effect is none.
    """
    from minihuman.planning.power import Effect, compute_values, describe_power, power_curve, simulate_pool

    wanted, protocol = Effect.parse(effect), decode_protocol(toml, "protocol")
    if protocol.analysis.primary_measure and protocol.analysis.primary_measure not in _POWER:
        return f"Power of {protocol.analysis.primary_measure} cannot be simulated; it can for {', '.join(_POWER)}."
    size = max(protocol.study.participants // max(len(protocol.groups), 1), 4)
    pool = simulate_pool(toml, people=people, player="human-like", seed=1, block=protocol.analysis.block or None)
    measure = _POWER.get(protocol.analysis.primary_measure, "log_excess_steps")
    treated, untreated = (compute_values(rows, measure) for rows in (wanted.of(pool.episodes), pool.episodes))
    found = power_curve(measure, treated, untreated, (size // 2, size, 2 * size), studies=studies, seed=1)
    return describe_power(pool, wanted, found, player="human-like")


def _lines(protocol: Protocol, plan: SessionPlan, power: str) -> Iterator[str]:
    study, slots = protocol.study, build_allocation_list(protocol)
    strata = build_strata(protocol)
    yield f"# Preregistration of {study.name}, version {study.version}"
    yield f"\nProtocol SHA-256 `{plan.protocol_sha256}`, in every session's log with the protocol itself."
    yield "It holds every text that participants read; put the file beside this one. Sessions and analysis are those of"
    yield f"minihuman {__version__}: `minihuman report` makes all that is named below from the logs and the protocol."
    yield f"\n## Hypotheses\n\n{_hypothesis(protocol)}\n\n## Have any data been collected?\n\n{_FILL_IN}"
    yield f"\n## Participants\n\nWho may take part, how they are found and what they get: {_FILL_IN}"
    yield "\n## Design\n"
    if len(protocol.groups) > 1:
        yield f"{len(protocol.groups)} groups, compared between participants; everybody is in one.\n"
    for group in protocol.groups:
        yield f"- Group {group.name} goes through {', then '.join(group.blocks or group.parts)}."
    yield ""
    yield from (_block(block) for block in protocol.blocks)
    yield "\n## Randomisation\n"
    yield (
        f"Groups, orders and keys come from a list of {len(slots)} places that was drawn from the seed {study.seed} "
        f"before the first session. Its SHA-256 is `{plan.allocation_sha256 or allocation_sha256(slots)}`."
    )
    if strata is not None:
        yield (
            f"\nEverybody has a group only after the answer to {strata.question}: the next place of their stratum "
            f"({', '.join(strata.names)}), each of which has {study.participants} places of its own in the list."
        )
    yield f"\n## Blinding\n\n{_FILL_IN}"
    yield "\n## Sample size and stopping rule\n"
    told = ", ".join(f"{sum(slot.group == group.name for slot in slots)} in {group.name}" for group in protocol.groups)
    if strata is not None:
        told = "groups in ratio " + ":".join(str(group.allocation_ratio) for group in protocol.groups)
    yield f"{study.participants} places ({told}); no session starts when all are taken."
    yield f"\nWhy so many, and what else ends the study: {_FILL_IN}"
    yield "\n## Measures and analysis\n"
    yield from _analysis(protocol)
    yield "\n## Exclusions\n"
    yield "By these rules of the protocol, before groups are compared; the report says who was excluded and why.\n"
    yield from (_exclusion(rule) for rule in protocol.exclusions)
    yield "- Episodes that were not played to an end do not count; of several attempts at one, the last does."
    yield "\n## Power\n"
    yield f"```\n{power}\n```" if power else "Not worked out here: add --effect excess=0.7 to this command."
    yield f"\n## Anything else\n\n{_FILL_IN}"


def _block(block: BlockSpec) -> str:
    options = "".join(f", {name} = {value!r}" for name, value in sorted(block.options.items()))
    return (
        f"- Block {block.name}: {block.episodes} episodes in {block.world}{options}, {block.view} view, at most "
        f"{block.max_steps} steps each; {_layouts(block)}; actions {', '.join(block.actions)}, {_KEYS[block.key_map]}."
    )


def _layouts(block: BlockSpec) -> str:
    if isinstance(block.seeds, tuple):
        return f"layouts of the seeds {', '.join(map(str, block.seeds))}, the same for everybody"
    drawn = "one layout for all episodes" if block.seeds == "same" else "a layout for every episode"
    return f"{drawn}, drawn for each participant"


def _compared_on(protocol: Protocol) -> str:
    """The block that groups are compared on: the one that is named, or the last that all of them play."""
    common = [
        block.name
        for block in protocol.blocks
        if all(block.name in (group.blocks or group.parts) for group in protocol.groups)
    ]
    return protocol.analysis.block or (common[-1] if common else "")


def _analysis(protocol: Protocol) -> Iterator[str]:
    named = protocol.analysis
    block = _compared_on(protocol)
    where = f"block {block}" if block else "the last block that all groups play"
    yield f"Groups are compared on {where}, one value a participant: the mean over the episodes that count, unless"
    yield f"something else is said. {_direction(protocol)}"
    if named.primary_measure:
        yield f"\n- Primary: {named.primary_measure}, by itself."
        if named.equivalence_margin is not None:
            yield (
                f"- Groups count as alike where two one-sided tests (Welch's t, 5 %) show {named.primary_measure} to "
                f"differ by less than {named.equivalence_margin:g}."
            )
    else:
        yield (
            "\n- No primary measure is named: name one in the protocol's `[analysis]`. Else all are exploratory, with "
            "Holm's correction over all of them."
        )
    if named.secondary_measures:
        yield f"- Secondary: {', '.join(named.secondary_measures)}; Holm's correction over them."
    if named.primary_measure or named.secondary_measures:
        yield "- Everything else is exploratory; Holm's correction over it."
    if named.conditions:
        yield (
            f"- Within participants: blocks {', '.join(named.conditions)}, paired permutation, Holm's correction "
            "within each kind of measure; effects of position and carry-over by F tests."
        )
    if named.covariates:
        yield f"- The primary measure once more adjusted for {', '.join(named.covariates)} (analysis of covariance)."
    yield (
        "- Test: two-sided permutation of |Welch's t| over participants, 5 %; interval of the difference: those that "
        "the same permutation does not reject, 95 %; times on their logarithms. A participant "
        "without a value of a measure is not in its row; every row says how many are."
    )
    yield (
        "- A reward that is 0 where time ran out is compared in two parts too, exploratory: the odds of any, and how "
        "much there was (generalised estimating equations, bias-reduced covariance), and a permutation test of both."
    )
    yield (
        "- Change over the episodes: a line for each participant, slopes and levels compared by Welch's t. Time until "
        "every key was found: restricted means from five events a group on, and the log-rank test, with those who "
        "never found them in it."
    )
    yield (
        "- Left out unless named here: steps over the best way of successes alone, where an episode had none, and time "
        "until every key was found, where somebody never did; either would make those who fail more look better. Nor "
        "`log_steps_ratio_mean`, which asks what `log_excess_steps_mean` does."
    )
    named_too = [name for name in (named.primary_measure, *named.secondary_measures) if name]
    yield f"\nThe measures{' that are named' if named_too else ''}:\n"
    yield from (
        f"- `{name}`: {label_measure(name)}{f'; {FORMULAS[name]}' if name in FORMULAS else ''}."
        for name in named_too or (one for one in MEANINGS if one not in ONLY_IF_NAMED)
    )


def _hypothesis(protocol: Protocol) -> str:
    """The hypothesis to fill in: how the groups differ on the primary measure."""
    if len(protocol.groups) < 2:
        return _FILL_IN
    primary = protocol.analysis.primary_measure or "the primary measure"
    names = " and ".join(group.name for group in protocol.groups)
    return f"How {names} differ on {primary} of block {_compared_on(protocol) or '...'}, and why: {_FILL_IN}"


def _direction(protocol: Protocol) -> str:
    """Which group is taken from which, as the report does it."""
    if len(protocol.groups) < 2:
        return "There is one group, so nothing is compared."
    blocks = {block.name for block in protocol.blocks}
    played = {group.name: len(blocks & set(group.blocks or group.parts)) for group in protocol.groups}
    most_first = sorted(protocol.groups, key=lambda group: (-played[group.name], group.name))
    pairs = (f"{one.name} minus {other.name}" for one, other in combinations(most_first, 2))
    return f"Differences are {', '.join(pairs)}."


def _exclusion(rule: ExclusionSpec) -> str:
    bounds = [f"below {rule.below:g}"] if rule.below is not None else []
    bounds += [f"above {rule.above:g}"] if rule.above is not None else []
    return f"- A {rule.level} whose {rule.measure} is {' or '.join(bounds)}: {rule.reason}."
