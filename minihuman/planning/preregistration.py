"""The text of a preregistration from a protocol: what registries ask for, as far as the protocol determines it.

The order follows the OSF's and AsPredicted's forms. What only the researchers know is left as a line to fill in.
"""

from collections import Counter
from itertools import combinations
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from minihuman import __version__
from minihuman.errors import ReportError
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.answer_exclusions import describe_answer_exclusion
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.experiment.protocol.study_design import derive_design
from minihuman.reporting.block_measures import FORMULAS, MEASURES as MEANINGS, ONLY_IF_NAMED, label_measure
from minihuman.storage.durable_files import write_atomically

_POWER = {  # a measure's name in the table of blocks -> its name in a power analysis
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


def build_preregistration(protocol: Protocol, plan: SessionPlan, power: str = "") -> str:
    """Return the text of a preregistration in Markdown.

    Args:
        protocol: the protocol of the study.
        plan: the plan of any participant, for the hashes.
        power: the text of the power analysis; "" for none.
    """
    slots = build_allocation_list(protocol)
    analysis = protocol.analysis
    environment = Environment(
        loader=PackageLoader("minihuman.planning", "templates"), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {"repr": repr, "label": label_measure, "answers": describe_answer_exclusion}
    return environment.get_template("preregistration.md.j2").render(
        protocol=protocol,
        groups=protocol.groups,
        plan=plan,
        version=__version__,
        keys=_KEYS,
        n_slots=len(slots),
        slots_of=Counter(slot.group for slot in slots),
        strata=build_strata(protocol),
        allocation_sha256=plan.allocation_sha256 or allocation_sha256(slots),
        target=_find_target_block(protocol),
        direction=_describe_direction(protocol),
        named=analysis,
        design=derive_design(protocol),
        named_measures=[name for name in (analysis.primary_measure, *analysis.secondary_measures) if name],
        default_measures=[name for name in MEANINGS if name not in ONLY_IF_NAMED],
        formulas=FORMULAS,
        power=power,
        fill_in="_To be written by the researchers._",
    )


def write_preregistration(protocol: Protocol, plan: SessionPlan, path: Path, power: str = "") -> Path:
    """Write the preregistration of a study to a new file and return its path; arguments as for `build_preregistration`.

    Raises:
        ReportError: if the file exists.
        OSError: if the file cannot be written.
    """
    if path.exists():
        raise ReportError(f"{path} already exists and is not overwritten; choose another file")
    write_atomically(build_preregistration(protocol, plan, power), path)
    return path


def describe_planned_power(toml: bytes, effect: str, *, people: int = 60, studies: int = 500) -> str:
    """Return the text of a power analysis at the planned number of participants per group, and at half and twice that.

    For a primary measure whose power cannot be simulated, return a sentence that says so.

    Args:
        toml: the protocol.
        effect: the effect, as the command line has it: "none", or such as "excess=0.7".
        people: the number of simulated participants.
        studies: the number of simulated studies per group size.

    Raises:
        ReportError: if the effect is not valid, or too few simulated participants have a value of the measure.
    """
    from minihuman.planning.power import Effect, compute_values, describe_power, power_curve, simulate_pool

    planned_effect = Effect.parse(effect)
    protocol = decode_protocol(toml, "protocol")
    if protocol.analysis.primary_measure and protocol.analysis.primary_measure not in _POWER:
        return f"Power of {protocol.analysis.primary_measure} cannot be simulated; it can for {', '.join(_POWER)}."
    size = max(protocol.study.participants // max(len(protocol.groups), 1), 4)
    pool = simulate_pool(toml, people=people, player="human-like", seed=1, block=protocol.analysis.block or None)
    measure = _POWER.get(protocol.analysis.primary_measure, "log_excess_steps")
    treated, untreated = (compute_values(rows, measure) for rows in (planned_effect.of(pool.episodes), pool.episodes))
    estimates = power_curve(measure, treated, untreated, (size // 2, size, 2 * size), studies=studies, seed=1)
    return describe_power(pool, planned_effect, estimates, player="human-like")


def _find_target_block(protocol: Protocol) -> str:
    """Return the block in which groups are compared: the one that the analysis names, or the last that all groups play.

    "" means that no block is played by all groups.
    """
    if protocol.analysis.block:
        return protocol.analysis.block
    shared_blocks = [
        block.name
        for block in protocol.blocks
        if all(block.name in (group.blocks or group.parts) for group in protocol.groups)
    ]
    if not shared_blocks:
        return ""
    return shared_blocks[-1]


def _describe_direction(protocol: Protocol) -> str:
    """Return a sentence that says which group is subtracted from which in the report's differences.

    Groups that play more blocks come first, and otherwise groups are in the order of their names.
    """
    if len(protocol.groups) < 2:
        return "There is one group, so nothing is compared."
    blocks = {block.name for block in protocol.blocks}
    n_blocks = {group.name: len(blocks & set(group.blocks or group.parts)) for group in protocol.groups}
    most_first = sorted(protocol.groups, key=lambda group: (-n_blocks[group.name], group.name))
    pairs = (f"{first.name} minus {second.name}" for first, second in combinations(most_first, 2))
    return f"Differences are {', '.join(pairs)}."
