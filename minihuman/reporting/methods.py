"""The methods paragraphs: what was played by whom with what, in words to copy, with versions and hashes."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version

import minihuman
from minihuman.dataset.recording_quality import PlanOutline, RecordingQuality
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.plan.stated_outcomes import describe_rule, find_outcome_rule, is_of_catalogue
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.reporting.results import FORMULAS, MEASURES, TRIAL_BLOCK_MEASURES
from minihuman.reporting.trial_methods import (
    describe_stimuli,
    describe_trials,
    is_of_trials,
    list_shared_options,
)
from minihuman.worlds.outcomes import LAST_REWARD

_STATISTICS = ("pandas", "scipy")
_TO_FIND = "the actions of the keys had to be discovered"
_SHOWN = "the keys and their actions were shown on the screen"
_DRAWN_ANEW = ("new", "shown")
_LABELS: dict[str, Callable[[PlanOutline], str]] = {
    "group": lambda plan: f"group {plan.group}",
    "session": lambda plan: f"in session {plan.session}",
    "version": lambda plan: f"by version {plan.version} ({plan.protocol_sha256[:8]})",
    "participant": lambda plan: f"participant {plan.participant}",
}
_DIVISIONS = (  # the fewest that tell how a block was had are named
    (), ("group",), ("session",), ("version",), ("group", "session"), ("group", "version"), ("session", "version"),
    ("group", "session", "version"), ("participant", "session"),
)  # fmt: skip
Cell = tuple[str, int, str]  # group, session, and the block before (of an earlier session too; "" for none)


class BlockSpecs:
    """The blocks of the sessions' protocols, as each group has them."""

    def __init__(self, protocols: Sequence[Protocol]) -> None:
        self._protocols = {protocol.sha256: protocol for protocol in protocols}

    def find(self, plan: PlanOutline, block: str) -> BlockSpec | None:
        """A block as a session's group has it; None if its protocol is not known."""
        protocol = self._protocols.get(plan.protocol_sha256)
        if protocol is None:
            return None
        return protocol.block_for(block, plan.group)


def build_methods(
    plans: Sequence[PlanOutline],
    qualities: Sequence[RecordingQuality],
    simulated: int = 0,
    *,
    protocols: Sequence[Protocol] = (),
) -> list[str]:
    """The paragraphs; ``plans`` and ``qualities`` are the sessions', ``simulated`` of which no person played.

    ``protocols`` are those the sessions were played by; without them what no plan says is not told.
    """
    specs = BlockSpecs(protocols)
    return [
        _people(plans, simulated, specs, protocols),
        *_designs(protocols),
        *_blocks(plans, specs),
        _measures(plans, specs),
        _software(plans, qualities),
        f"This report: minihuman {minihuman.__version__}, {_name_statistics()}.",
    ]


def _name_statistics() -> str:
    return ", ".join(f"{name} {version(name)}" for name in _STATISTICS)


def find_known_keys(plans: Sequence[PlanOutline], protocols: Sequence[Protocol] = ()) -> dict[str, list[str]]:
    """By block, the groups who came to it with the keys of an earlier one, which they knew by then.

    All participants of a group did, the first time that they played it.
    """
    known_keys: dict[str, dict[str, bool]] = {}
    for block, cells in _find_known_cells(plans, BlockSpecs(protocols)).items():
        of_group = known_keys.setdefault(block, {})
        first = {
            group: min(session for cell_group, session, _ in cells if cell_group == group) for group, _, _ in cells
        }
        for (group, session, _), known in cells.items():
            if session == first[group]:
                of_group[group] = of_group.get(group, True) and known
    groups_by_block = {
        block: sorted(group for group, known in groups.items() if known) for block, groups in known_keys.items()
    }
    return {block: groups for block, groups in groups_by_block.items() if groups}


def _find_known_cells(plans: Sequence[PlanOutline], specs: BlockSpecs) -> dict[str, dict[Cell, bool]]:
    """By block and cell, whether all participants had the keys of an earlier block: of a few alone it is chance.

    Keys that the protocol draws anew are never an earlier block's, whatever was drawn.
    """
    known_by_block: dict[str, dict[Cell, bool]] = {}
    history: dict[str, list[EpisodePlan]] = {}
    for plan in sorted(plans, key=lambda plan: plan.session):
        earlier = history.setdefault(plan.participant, [])
        for block_plan in plan.blocks:
            cells = known_by_block.setdefault(block_plan.block_name, {})
            cell = plan.group, plan.session, earlier[-1].block_name if earlier else ""
            spec = specs.find(plan, block_plan.block_name)
            may_know = spec is None or spec.key_map not in _DRAWN_ANEW
            known = may_know and any(_does(block_plan) == _does(before) for before in earlier)
            cells[cell] = cells.get(cell, True) and known
            earlier.append(block_plan)
    return known_by_block


def _does(block_plan: EpisodePlan) -> dict[str, int]:
    """What each key does, by the action's place in the block's list: worlds call the same actions by other names."""
    return {
        key: block_plan.actions.index(action)
        for key, action in block_plan.key_map.keys.items()
        if action in block_plan.actions
    }


def _people(plans: Sequence[PlanOutline], simulated: int, specs: BlockSpecs, protocols: Sequence[Protocol] = ()) -> str:
    groups = Counter({plan.participant: plan.group for plan in plans}.values())
    parts = ", ".join(f"{count} in group {group}" for group, count in sorted(groups.items()))
    by_session = Counter(plan.session for plan in plans)
    days = f" in {len(by_session)} sessions" if len(by_session) > 1 else ""
    if len(set(by_session.values())) > 1:
        days += f" ({', '.join(f'{count} in session {session}' for session, count in sorted(by_session.items()))})"
    by_hand = sum(plan.by_hand for plan in plans)
    by_design = any(protocol.allocation.design for protocol in protocols)
    keys = _are_keys_drawn(plans, specs)
    if by_design:
        allocated = "Keys" if keys else "Orders"
    else:
        allocated = f"Groups{' and keys' if keys else ''}"
    if by_hand:
        chosen = f"; in {by_hand} sessions the participant or group was chosen by hand"
    else:
        chosen = ""
    return (
        f"{sum(groups.values())} participants took part{days} ({parts}{_nobody(plans, simulated)}). "
        f"{allocated} came from an allocation list "
        f"drawn before the first session from the study's seed, {plans[0].seed}{_later_keys(plans, specs)}{chosen}."
        f"{_strata(plans, by_design=by_design)}"
    )


def _designs(protocols: Sequence[Protocol]) -> list[str]:
    """A paragraph on what was adaptive, by the protocols; none where nothing was."""
    sentences: dict[str, None] = {}
    for protocol in protocols:
        for opening, spec in (
            ("Groups were assigned by", protocol.allocation.design),
            ("Enrolment could be stopped by", protocol.allocation.stopping),
            *((f"Episodes of block {block.name} were chosen by", block.design) for block in protocol.blocks),
        ):
            if spec is not None:
                settings = ", ".join(f"{name} = {value!r}" for name, value in spec.settings.items())
                sentences[f"{opening} the adaptive design {spec.name}{f' ({settings})' if settings else ''}."] = None
    proof = "Each decision is recorded with what it followed from, and verification asks the design again."
    return [" ".join([*sentences, proof])] if sentences else []


def _later_keys(plans: Sequence[PlanOutline], specs: BlockSpecs) -> str:
    """Where the keys of later sessions came from, if any were drawn anew: the list has the first session's."""
    policies = {
        spec.key_map
        for plan in plans
        if plan.session > 1
        for block_plan in plan.blocks
        if (spec := specs.find(plan, block_plan.block_name)) is not None
    }
    if policies & {*_DRAWN_ANEW}:
        return "; keys that later sessions drew anew came from that seed alone"
    return ""


def _are_keys_drawn(plans: Sequence[PlanOutline], specs: BlockSpecs) -> bool:
    """Whether keys were drawn; as far as only the plans tell, whether participants had different ones."""
    keys: dict[tuple[str, str], list[dict[str, str]]] = {}
    for plan in plans:
        for number, block_plan in enumerate(plan.blocks):
            spec = specs.find(plan, block_plan.block_name)
            if spec is None:
                keys.setdefault((plan.group, block_plan.block_name), []).append(block_plan.key_map.keys)
            elif spec.key_map in (*_DRAWN_ANEW, "constant") or (spec.key_map == "carry_over" and not number):
                return True
    return any(len(key_maps) == 1 or key_maps.count(key_maps[0]) < len(key_maps) for key_maps in keys.values())


def _strata(plans: Sequence[PlanOutline], *, by_design: bool = False) -> str:
    """Within which strata groups were drawn, and how many of each group each has."""
    allocations = {plan.participant: (plan.stratum, plan.group) for plan in plans if plan.stratum}
    if not allocations:
        return ""
    counts = Counter(allocations.values())
    groups = sorted({group for _, group in counts})
    strata = "; ".join(
        f"{stratum}: {', '.join(f'{group} {counts[stratum, group]}' for group in groups)}"
        for stratum in sorted({stratum for stratum, _ in counts})
    )
    question = next(plan.stratified_by for plan in plans if plan.stratified_by)
    if by_design:
        lists = "the design knew the stratum"
    else:
        lists = "with one allocation list per stratum"
    return f" Groups were stratified by the answer to {question}, {lists} ({strata})."


def _nobody(plans: Sequence[PlanOutline], simulated: int) -> str:
    if not simulated:
        return ""
    if simulated == len(plans):
        return "; all simulated"
    return f"; {simulated} of the sessions simulated"


def _blocks(plans: Sequence[PlanOutline], specs: BlockSpecs) -> list[str]:
    """A paragraph per block; where groups, sessions or versions had it otherwise, a sentence for each."""
    known = _find_known_cells(plans, specs)
    descriptions: dict[str, list[tuple[PlanOutline, str]]] = {}
    for plan in sorted(plans, key=lambda plan: -len(plan.blocks)):  # in the order of those who played most
        for block_plan in plan.blocks:
            description = _describe(block_plan, specs.find(plan, block_plan.block_name))
            descriptions.setdefault(block_plan.block_name, []).append((plan, description))
    return [_block(name, described, known[name]) for name, described in descriptions.items()]


def _block(name: str, described: Sequence[tuple[PlanOutline, str]], known: Mapping[Cell, bool]) -> str:
    """A block's sentences: one where all had it alike, else one for each of the fewest kinds that tell them apart."""
    for parts in _DIVISIONS:
        kinds: dict[tuple[str, ...], set[str]] = {}
        for plan, description in described:
            kinds.setdefault(tuple(_LABELS[part](plan) for part in parts), set()).add(description)
        if all(len(kind) == 1 for kind in kinds.values()):
            break
    labels_by_description: dict[str, list[str]] = {}
    for kind, (description,) in sorted(kinds.items()):
        labels_by_description.setdefault(description, []).append(" ".join(kind))
    sentences = []
    for description, labels in labels_by_description.items():
        qualifier = f", {' and '.join(labels)}" if any(labels) else ""
        described_cells = {
            cell: known[cell]
            for cell in known
            if any((plan.group, plan.session) == cell[:2] and had == description for plan, had in described)
        }
        sentences.append(
            f"Block {name}{qualifier}: {description}{_carried(described_cells) if _TO_FIND in description else ''}."
        )
    return " ".join(sentences)


def _carried(known: Mapping[Cell, bool]) -> str:
    """Who had no keys to find: whole groups, or what tells those of a group who came with keys from others."""
    groups_with_keys = []
    for group in sorted({group for group, _, _ in known}):
        cells = {cell: is_known for cell, is_known in known.items() if cell[0] == group}
        if all(cells.values()):
            groups_with_keys.append(group)
            continue
        for session in sorted({session for _, session, _ in cells}):
            session_cells = {
                before: is_known for (_, cell_session, before), is_known in cells.items() if cell_session == session
            }
            if all(session_cells.values()):
                groups_with_keys.append(f"{group} in session {session}")
            else:
                groups_with_keys += [
                    f"{group} in session {session} after block {before}"
                    for before, is_known in sorted(session_cells.items())
                    if is_known
                ]
    if groups_with_keys:
        return f" (except by {', '.join(groups_with_keys)}, who kept the keys of an earlier block)"
    return ""


def _describe(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """A block as one participant had it."""
    offered = sum(action in block_plan.actions for action in block_plan.key_map.keys.values())
    pool = len(block_plan.key_map.keys) + len(block_plan.key_map.spare_keys)
    distractor_actions = sorted(
        {action for action in block_plan.key_map.keys.values() if action not in block_plan.actions}
    )
    if distractor_actions:
        distractors = f", {', '.join(distractor_actions)} on the other {len(block_plan.key_map.keys) - offered}"
    else:
        distractors = ""
    keys = (
        f"actions {', '.join(block_plan.actions)} on {offered} keys of {pool}{distractors}; "
        f"{_SHOWN if block_plan.show_keys else _TO_FIND}"
    )
    practice = "" if spec is None or spec.analysed else "practice, not analysed: "
    if is_of_trials(block_plan, spec):
        return f"{practice}{describe_trials(block_plan, spec)}; {keys}"
    shared = sorted(list_shared_options(block_plan, spec).items())
    options = "".join(f", {option} = {value!r}" for option, value in shared)
    table = describe_stimuli(spec)
    return (
        f"{practice}{_episodes(block_plan, spec)} in {block_plan.world}"
        f"{options}{f', further options from {table}' if table else ''}, {block_plan.view} view, at most {block_plan.max_steps} steps"
        f"{f' or {spec.max_episode_s:g} s' if spec is not None and spec.max_episode_s else ''} each; {_pace(block_plan)}; "
        f"{keys}{_moved(spec)}{_outcome(block_plan, spec)}"
    )


def _outcome(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """What an end meant, where that does not go without saying."""
    if is_of_catalogue(block_plan.world) and block_plan.outcome_rule == LAST_REWARD:
        return ""
    is_older = spec is not None and block_plan.outcome_rule == LAST_REWARD != find_outcome_rule(spec).rule
    since = ", as for every world when the study began" if is_older else ""
    return f"; {describe_rule(block_plan.outcome_rule)}{since}"


def _moved(spec: BlockSpec | None) -> str:
    """How the view got from one picture to the next, where it did not change at once."""
    moved = "; in windows, and in browsers whose page drew the world, the view moved to each new picture for"
    if spec and spec.motion_ms:
        return f"{moved} {spec.motion_ms:g} ms, from the beginning of which times count"
    return ""


def _episodes(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """How many episodes there were, and what ended the block before."""
    ends = []
    if spec is not None and spec.stop_criterion is not None:
        ends.append(f"until {spec.stop_criterion.successes} of the last {spec.stop_criterion.of} reached the goal")
    if spec is not None and spec.max_block_s:
        ends.append(f"for at most {spec.max_block_s:g} s in all")
    if ends:
        return f"up to {block_plan.episodes_in_block} episodes ({', '.join(ends)})"
    return f"{block_plan.episodes_in_block} episodes"


def _pace(block_plan: EpisodePlan) -> str:
    """What made a step."""
    if block_plan.pace == "on_key":
        return "each press of a key made one step" + (", a held key more of them" if block_plan.auto_repeat else "")
    without = "none without a key" if block_plan.noop is None else f"{block_plan.noop} without a key"
    if block_plan.onset_at_reset:
        onset = "the first picture"
    else:
        onset = "the onsets that the world names"
    return f"one step every {block_plan.step_period_ms:g} ms, {without}, reaction times from {onset}"


def _measures(plans: Sequence[PlanOutline], specs: BlockSpecs) -> str:
    blocks = [(block, specs.find(plan, block.block_name)) for plan in plans for block in plan.blocks]
    are_trials = bool(blocks) and all(is_of_trials(block, spec) for block, spec in blocks)
    names = [name for name in FORMULAS if name in TRIAL_BLOCK_MEASURES or not are_trials]
    parts = "; ".join(f"{MEASURES[name]} \N{EN DASH} {FORMULAS[name]}" for name in names)
    if len({plan.session for plan in plans}) > 1:
        session_note = "; of several sessions it is the mean of theirs"
    else:
        session_note = ""
    return (
        f"Unless stated otherwise, a participant's value is the mean over the included episodes{session_note}. {parts}."
    )


def _software(plans: Sequence[PlanOutline], qualities: Sequence[RecordingQuality]) -> str:
    protocols = sorted({(plan.version, plan.protocol_sha256) for plan in plans})
    parts = "; ".join(f"version {name}, SHA-256 {sha}" for name, sha in protocols)
    words = {
        "version_minihuman": "minihuman", "git_commit": "commit", "rules": "rules of the worlds", "python": "Python",
        "version_numpy": "NumPy", "system": "on", "window_version": "shown by",
    }  # fmt: skip
    versions = []
    for name, word in words.items():
        values = sorted({run[name] for quality in qualities for run in quality.software if name in run})
        if values:
            versions.append(f"{word} {' and '.join(values)}")
    run_with = f"Protocol of study {plans[0].study}: {parts}. Run with {', '.join(versions)}."
    ran = {(quality.participant, quality.session): quality.software for quality in qualities}
    computes = [plan for plan in plans if plan.computed]
    with_kernels = [
        p for p in computes if any("page_kernels" in run for run in ran.get((p.participant, p.session), ()))
    ]
    if not with_kernels:
        return run_with
    blocks = sorted({name for plan in with_kernels for name in plan.computed})
    kernels = sorted(
        {run["page_kernels"] for quality in qualities for run in quality.software if "page_kernels" in run}
    )
    if len(with_kernels) < len(computes):
        session_share = f"in {len(with_kernels)} of {len(computes)} sessions "
    else:
        session_share = ""
    return (
        f"{run_with} In browsers {session_share}the page stepped and drew {'blocks' if len(blocks) > 1 else 'block'} "
        f"{' and '.join(blocks)} ahead of the server (kernels {' and '.join(kernels)}), which compared every step with "
        "its own and recorded its own."
    )
