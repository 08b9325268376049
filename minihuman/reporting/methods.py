"""The methods section: participants, blocks, measures and software in sentences to copy, with versions and hashes."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from importlib.metadata import version

import minihuman
from minihuman.admin.enrolment_flow import ParticipantFlow
from minihuman.dataset.recording_quality import PlanOutline, RecordingQuality
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.plan.stated_outcomes import describe_rule, find_outcome_rule, is_of_catalogue
from minihuman.experiment.protocol.answer_exclusions import describe_answer_exclusion
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.reporting.attrition import Attrition
from minihuman.reporting.block_measures import FORMULAS, MEASURES, TRIAL_BLOCK_MEASURES, TRIAL_FORMULAS
from minihuman.reporting.design_methods import (
    describe_adaptive_designs,
    describe_group_parts,
    describe_orders,
    describe_team,
    name_allocated,
)
from minihuman.reporting.known_keys import DRAWN_ANEW, BlockSpecs, Cell, find_known_cells
from minihuman.reporting.study_measures import find_measure
from minihuman.reporting.trial_methods import (
    describe_stimuli,
    describe_trials,
    is_of_trials,
    list_shared_options,
)
from minihuman.worlds.outcomes import LAST_REWARD

_STATISTICS = ("pandas", "scipy")
_TO_FIND = "the actions of the keys had to be discovered"
_WHO_KEPT = "who kept the keys that they had before"
_KEPT = "the keys were those of an earlier block"
_SHOWN = "the keys and their actions were shown on the screen"
_LABELS: dict[str, Callable[[PlanOutline], str]] = {
    "group": lambda plan: f"group {plan.group}",
    "session": lambda plan: f"in session {plan.session}",
    "version": lambda plan: f"by version {plan.version} ({plan.protocol_sha256[:8]})",
    "participant": lambda plan: f"participant {plan.participant}",
}
_DIVISIONS = (  # the fewest that tell apart how a block was played are named
    (), ("group",), ("session",), ("version",), ("group", "session"), ("group", "version"), ("session", "version"),
    ("group", "session", "version"), ("participant", "session"),
)  # fmt: skip


def build_methods(
    plans: Sequence[PlanOutline],
    qualities: Sequence[RecordingQuality],
    simulated: int = 0,
    *,
    protocols: Sequence[Protocol] = (),
    flow: ParticipantFlow | None = None,
    n_excluded: Mapping[str, int] | None = None,
    block_order: Sequence[str] = (),
    measures: Collection[str] = (),
) -> list[str]:
    """Return the paragraphs of the methods section.

    Args:
        plans: the outlines of the sessions' plans.
        qualities: the recording quality of the sessions.
        simulated: the number of sessions that no person played.
        protocols: the protocols under which the sessions were played; without them, facts that only a protocol contains
            are omitted.
        flow: the flow of the study's participants; None if there is no enrolment log.
        n_excluded: the number of excluded participants by reason; None if it is not known.
        block_order: the blocks that the page shows, in its order; further blocks follow in the order in which the
            participants with the most blocks played them.
        measures: the measures to define, which the page shows; all measures if empty.
    """
    specs = BlockSpecs(protocols)
    return [
        _describe_people(plans, simulated, specs, protocols, flow),
        *describe_group_parts(protocols),
        *describe_orders(protocols),
        *_describe_answer_exclusions(protocols, n_excluded or {}),
        *describe_adaptive_designs(protocols),
        *_describe_blocks(plans, specs, block_order),
        _describe_measures(plans, specs, measures),
        _describe_software(plans, qualities),
        f"This report: minihuman {minihuman.__version__}, {_name_statistics()}.",
    ]


def _name_statistics() -> str:
    return ", ".join(f"{name} {version(name)}" for name in _STATISTICS)


def _describe_people(
    plans: Sequence[PlanOutline],
    simulated: int,
    specs: BlockSpecs,
    protocols: Sequence[Protocol] = (),
    flow: ParticipantFlow | None = None,
) -> str:
    """State who took part, who was lost, and how groups and keys were allocated."""
    attrition = Attrition.of(plans, flow)
    groups = attrition.groups
    parts = ", ".join(f"{count} in group {group}" for group, count in sorted(groups.items()))
    by_hand = sum(plan.by_hand for plan in plans)
    by_design = any(protocol.allocation.design for protocol in protocols)
    allocated = name_allocated(protocols, has_groups=len(groups) > 1, has_keys=_are_keys_drawn(plans, specs))
    by_hand_note = ""
    if by_hand:
        by_hand_note = f"; in {by_hand} sessions the participant or group was chosen by hand"
    return (
        f"{sum(groups.values())} participants took part{_describe_sessions(attrition.sessions)} "
        f"({parts}{_describe_simulated(plans, simulated, attrition)}). {attrition.describe()}"
        f"{allocated} came from an allocation list "
        f"drawn before the first session from the study's seed, {plans[0].seed}{_describe_later_keys(plans, specs)}"
        f"{by_hand_note}.{_describe_strata(plans, by_design=by_design)}"
    )


def _describe_sessions(sessions: Mapping[int, int]) -> str:
    """State in how many sessions participants took part; "" for a single session."""
    by_session = sorted(sessions.items())
    counts = ", ".join(f"{count} in session {session}" for session, count in by_session)
    if len({count for _, count in by_session}) > 1:
        return f" in {len(by_session)} sessions ({counts})"
    if len(by_session) > 1:
        return f" in {len(by_session)} sessions"
    return ""


def _describe_answer_exclusions(protocols: Sequence[Protocol], n_excluded: Mapping[str, int]) -> list[str]:
    """Return a paragraph on the rules that exclude by answers and their counts; [] if there are no such rules."""
    rules = {
        rule.reason: describe_answer_exclusion(rule)
        for protocol in protocols
        for rule in protocol.exclusions
        if rule.question
    }
    if not rules:
        return []
    described = "; ".join(
        f"{description} ({reason}: {n_excluded.get(reason, 0)} excluded)" for reason, description in rules.items()
    )
    return [f"By rules that the protocol states, blind to the results, participants are excluded {described}."]


def _describe_later_keys(plans: Sequence[PlanOutline], specs: BlockSpecs) -> str:
    """State where keys that later sessions drew anew came from; "" if none did.

    The allocation list has only the keys of the first session.
    """
    for plan in plans:
        if plan.session <= 1:
            continue
        for block_plan in plan.blocks:
            spec = specs.find(plan, block_plan.block_name)
            if spec is not None and spec.key_map in DRAWN_ANEW:
                return "; keys that later sessions drew anew came from that seed alone"
    return ""


def _are_keys_drawn(plans: Sequence[PlanOutline], specs: BlockSpecs) -> bool:
    """Return whether keys were drawn at random.

    For a session without a protocol, this is assumed unless several participants of a group had equal keys in a block.
    """
    key_maps_by_block: dict[tuple[str, str], list[dict[str, str]]] = {}  # by group and block
    for plan in plans:
        for index, block_plan in enumerate(plan.blocks):
            spec = specs.find(plan, block_plan.block_name)
            if spec is None:
                key_maps = key_maps_by_block.setdefault((plan.group, block_plan.block_name), [])
                key_maps.append(block_plan.key_map.keys)
            elif spec.key_map in (*DRAWN_ANEW, "constant") or (spec.key_map == "carry_over" and index == 0):
                return True
    return any(
        len(key_maps) == 1 or key_maps.count(key_maps[0]) < len(key_maps) for key_maps in key_maps_by_block.values()
    )


def _describe_strata(plans: Sequence[PlanOutline], *, by_design: bool = False) -> str:
    """State within which strata groups were drawn, and the number of participants by stratum and group; "" without any.

    ``by_design`` says whether an adaptive design assigned the groups.
    """
    allocations = {plan.participant: (plan.stratum, plan.group) for plan in plans if plan.stratum}
    if not allocations:
        return ""
    counts = Counter(allocations.values())
    groups = sorted({group for _, group in counts})
    stratum_texts = []
    for stratum in sorted({stratum for stratum, _ in counts}):
        group_counts = ", ".join(f"{group} {counts[stratum, group]}" for group in groups)
        stratum_texts.append(f"{stratum}: {group_counts}")
    strata = "; ".join(stratum_texts)
    question = next(plan.stratified_by for plan in plans if plan.stratified_by)
    if by_design:
        lists = "the design knew the stratum"
    else:
        lists = "with one allocation list per stratum"
    return f" Groups were stratified by the answer to {question}, {lists} ({strata})."


def _describe_simulated(plans: Sequence[PlanOutline], simulated: int, attrition: Attrition) -> str:
    """State how many sessions were simulated; "" if none was.

    If all were, "on record" is added where participants withdrew: erased sessions may not have been simulated.
    """
    if not simulated:
        return ""
    if simulated == len(plans):
        return "; all simulated" if not attrition.withdrew else "; all sessions on record simulated"
    return f"; {simulated} of the sessions simulated"


def _describe_blocks(plans: Sequence[PlanOutline], specs: BlockSpecs, block_order: Sequence[str] = ()) -> list[str]:
    """Return a paragraph per block, with a sentence for each variant between groups, sessions or versions."""
    known_cells = find_known_cells(plans, specs)
    descriptions: dict[str, list[tuple[PlanOutline, str]]] = {}
    for plan in sorted(plans, key=lambda plan: -len(plan.blocks)):  # in the order of those who played most
        for block_plan in plan.blocks:
            description = _describe_episode(block_plan, specs.find(plan, block_plan.block_name))
            descriptions.setdefault(block_plan.block_name, []).append((plan, description))
    names = [*(name for name in block_order if name in descriptions), *descriptions]
    return [_describe_block(name, descriptions[name], known_cells[name]) for name in dict.fromkeys(names)]


def _describe_block(name: str, described: Sequence[tuple[PlanOutline, str]], known_cells: Mapping[Cell, bool]) -> str:
    """Return a block's sentences: one per description, each with who played it if there are several.

    Args:
        name: the block's name.
        described: the outline of each plan with the block, and the block's description in it.
        known_cells: by group, session and preceding block, whether the participants knew the keys before.
    """
    sentences = []
    for description, labels in _label_descriptions(described).items():
        text = description
        qualifier = ""
        if any(labels):
            qualifier = f", {' and '.join(labels)}"
        if _TO_FIND in description:
            sessions = {(plan.group, plan.session) for plan, plan_text in described if plan_text == description}
            cells = {cell: is_known for cell, is_known in known_cells.items() if cell[:2] in sessions}
            keys = _KEPT if all(cells.values()) else f"{_TO_FIND}{_describe_known_keys(cells)}"
            text = description.replace(_TO_FIND, keys)
        sentences.append(f"Block {name}{qualifier}: {text}.")
    return " ".join(sentences)


def _label_descriptions(described: Sequence[tuple[PlanOutline, str]]) -> dict[str, list[str]]:
    """Return, by description, the labels of those who played it, with the fewest parts that tell descriptions apart."""
    for parts in _DIVISIONS:  # the last one always tells them apart
        descriptions: dict[tuple[str, ...], set[str]] = {}  # by label
        for plan, description in described:
            descriptions.setdefault(tuple(_LABELS[part](plan) for part in parts), set()).add(description)
        if all(len(same_label) == 1 for same_label in descriptions.values()):
            break
    labels: dict[str, list[str]] = {}
    for label, (description,) in sorted(descriptions.items()):
        labels.setdefault(description, []).append(" ".join(label))
    return labels


def _describe_known_keys(known_cells: Mapping[Cell, bool]) -> str:
    """State who already knew the keys; "" if no one did.

    ``known_cells`` states for each group, session and preceding block whether all participants knew the keys.
    """
    exceptions: list[str] = []
    is_divided = False  # whether in some group only a part of the participants knew them
    for group in sorted({group for group, _, _ in known_cells}):
        cells = {
            (session, before): is_known for (name, session, before), is_known in known_cells.items() if name == group
        }
        is_divided |= len(set(cells.values())) > 1
        exceptions += _list_with_known_keys(group, cells)
    if is_divided and all(is_known == bool(before) for (_, _, before), is_known in known_cells.items()):
        exceptions = ["those who had played another block"]
    if not exceptions:
        return ""
    return f" (except by {', '.join(exceptions)}, {_WHO_KEPT})"


def _list_with_known_keys(group: str, cells: Mapping[tuple[int, str], bool]) -> Iterator[str]:
    """Yield which part of a group already knew the keys: the whole group, whole sessions, or those after some blocks.

    Args:
        group: the group's name.
        cells: whether the keys were known, by session and preceding block.
    """
    if all(cells.values()):
        yield group
        return
    for session in sorted({session for session, _ in cells}):
        blocks_before = {before: is_known for (number, before), is_known in cells.items() if number == session}
        if all(blocks_before.values()):
            yield f"{group} in session {session}"
            continue
        for before, is_known in sorted(blocks_before.items()):
            if is_known:
                yield f"{group} in session {session} after block {before}"


def _describe_episode(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """Describe a block by the plan of one of its episodes, as one participant played it."""
    practice = ""
    if spec is not None and not spec.analysed:
        practice = "practice, not analysed: "
    keys = _describe_keys(block_plan)
    if is_of_trials(block_plan, spec):
        return f"{practice}{describe_trials(block_plan, spec)}; {keys}"
    world = _name_world(block_plan, spec)
    options = ""
    table = describe_stimuli(spec)
    if table:
        options = f", further options from {table}"
    limit = f"at most {block_plan.max_steps} steps"
    if spec is not None and spec.max_episode_s:
        limit += f" or {spec.max_episode_s:g} s"
    count = _describe_count(block_plan, spec)
    pace = _describe_pace(block_plan, spec)
    motion = _describe_motion(spec)
    outcome = _describe_outcome(block_plan, spec)
    return (
        f"{practice}{count} in {world}{options}, {block_plan.view} view, {limit} each; {pace}; "
        f"{keys}{motion}{outcome}{describe_team(spec)}"
    )


def _name_world(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """Return a world's id with the options that all episodes of a block share."""
    shared_options = sorted(list_shared_options(block_plan, spec).items())
    return ", ".join([block_plan.world, *(f"{option} = {value!r}" for option, value in shared_options)])


def name_worlds(plans: Sequence[PlanOutline], protocols: Sequence[Protocol] = ()) -> dict[str, list[str]]:
    """Return the worlds of each block with the options that all its episodes share; for trials, only the worlds' ids.

    The options of trials are in the methods section.
    """
    specs = BlockSpecs(protocols)
    names: dict[str, dict[str, None]] = {}
    for plan in plans:
        for block_plan in plan.blocks:
            spec = specs.find(plan, block_plan.block_name)
            name = block_plan.world
            if not is_of_trials(block_plan, spec):
                name = _name_world(block_plan, spec)
            names.setdefault(block_plan.block_name, {})[name] = None
    return {block: list(block_names) for block, block_names in names.items()}


def _describe_keys(block_plan: EpisodePlan) -> str:
    """State which actions were on how many keys, and whether the keys were shown."""
    key_map = block_plan.key_map
    offered = sum(action in block_plan.actions for action in key_map.keys.values())
    pool = len(key_map.keys) + len(key_map.spare_keys)
    distractor_actions = sorted({action for action in key_map.keys.values() if action not in block_plan.actions})
    distractors = ""
    if distractor_actions:
        distractors = f", {', '.join(distractor_actions)} on the other {len(key_map.keys) - offered}"
    discovery = _SHOWN if block_plan.show_keys else _TO_FIND
    return f"actions {', '.join(block_plan.actions)} on {offered} keys of {pool}{distractors}; {discovery}"


def _describe_outcome(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """State the rule that decides an episode's outcome; "" if it is the default rule in a shipped world."""
    if is_of_catalogue(block_plan.world) and block_plan.outcome_rule == LAST_REWARD:
        return ""
    rule = describe_rule(block_plan.outcome_rule)
    has_last_reward_rule = block_plan.outcome_rule == LAST_REWARD
    if has_last_reward_rule and spec is not None and find_outcome_rule(spec).rule != LAST_REWARD:
        return f"; {rule}, as for every world when the study began"
    return f"; {rule}"


def _describe_motion(spec: BlockSpec | None) -> str:
    """State how long the view took to move from one picture to the next; "" if it changed at once."""
    moved = "; in windows, and in browsers whose page drew the world, the view moved to each new picture for"
    if spec and spec.motion_ms:
        return f"{moved} {spec.motion_ms:g} ms, from the beginning of which times count"
    return ""


def _describe_count(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """State the number of episodes and what could end the block early."""
    ends = []
    if spec is not None and spec.stop_criterion is not None:
        ends.append(f"until {spec.stop_criterion.successes} of the last {spec.stop_criterion.of} reached the goal")
    if spec is not None and spec.max_block_s:
        ends.append(f"for at most {spec.max_block_s:g} s in all")
    if ends:
        return f"up to {block_plan.episodes_in_block} episodes ({', '.join(ends)})"
    return f"{block_plan.episodes_in_block} episodes"


def _describe_pace(block_plan: EpisodePlan, spec: BlockSpec | None) -> str:
    """State whether keys or a clock triggered steps; for a clock, also its period and the action without a key."""
    if block_plan.pace == "on_key":
        step = "each press of a key made one step"
        if block_plan.auto_repeat:
            step += ", a held key more of them"
        return step
    idle = "no step"
    if spec is not None and spec.team is not None:
        idle = "a body standing still"
    if block_plan.noop is not None:
        idle = f"action {block_plan.noop}"
    onset = "the onsets that the world names"
    if block_plan.onset_at_reset:
        onset = "the first picture"
    period = f"one step every {block_plan.step_period_ms:g} ms"
    return f"{period}, {idle} without a key, reaction times from {onset}"


def _describe_measures(plans: Sequence[PlanOutline], specs: BlockSpecs, measures: Collection[str] = ()) -> str:
    """State how the measures are computed; all of them if ``measures`` is empty."""
    blocks = [(block, specs.find(plan, block.block_name)) for plan in plans for block in plan.blocks]
    are_trials = bool(blocks) and all(is_of_trials(block, spec) for block, spec in blocks)
    defined = measures or FORMULAS
    names = [name for name in FORMULAS if name in defined and (name in TRIAL_BLOCK_MEASURES or not are_trials)]
    formulas = FORMULAS | (TRIAL_FORMULAS if are_trials else {})
    definitions = [f"{MEASURES[name]} = {formulas[name]}" for name in names]
    study_measures = [find_measure(name) for name in sorted(measures) if ":" in name]  # KIND:ARGUMENT
    definitions += [f"{measure.label} = {measure.formula}" for measure in study_measures if measure.formula]
    session_note = ""
    if len({plan.session for plan in plans}) > 1:
        session_note = "; of several sessions it is the mean of theirs"
    included = "trials" if are_trials else "episodes"
    start = f"Unless stated otherwise, a participant's value is the mean over the included {included}"
    if not definitions:
        return f"{start}{session_note}."
    return f"{start}{session_note}. The measures: {'; '.join(definitions)}."


_SOFTWARE = {  # what a log says of its software, and how the methods call it
    "version_minihuman": "minihuman", "git_commit": "commit", "rules": "rules of the worlds", "python": "Python",
    "version_numpy": "NumPy", "system": "on", "window_version": "shown by",
}  # fmt: skip


def _describe_software(plans: Sequence[PlanOutline], qualities: Sequence[RecordingQuality]) -> str:
    """State the protocols under which the study was played, and the software used."""
    protocols = sorted({(plan.version, plan.protocol_sha256) for plan in plans})
    parts = "; ".join(f"version {name}, SHA-256 {sha}" for name, sha in protocols)
    versions = []
    for name, label in _SOFTWARE.items():
        values = _list_software(qualities, name)
        if values:
            versions.append(f"{label} {' and '.join(values)}")
    run_with = f"Protocol of study {plans[0].study}: {parts}. Run with {', '.join(versions)}."
    return f"{run_with}{_describe_page_kernels(plans, qualities)}"


def _list_software(qualities: Sequence[RecordingQuality], name: str) -> list[str]:
    """Return the distinct values, sorted, that the sessions' logs record under a key of their software, as "python"."""
    recorded = sorted({run[name] for quality in qualities for run in quality.software if name in run})
    if name != "git_commit":
        return recorded
    return [re.sub(r"\+$", " with changed files", commit) for commit in recorded]  # the log marks these with a "+"


def _describe_page_kernels(plans: Sequence[PlanOutline], qualities: Sequence[RecordingQuality]) -> str:
    """State which blocks were computed and drawn by the web page's kernels, ahead of the server; "" if none were."""
    sessions_with_kernels = {
        (quality.participant, quality.session)
        for quality in qualities
        if any("page_kernels" in run for run in quality.software)
    }
    computing_plans = [plan for plan in plans if plan.computed]
    plans_with_kernels = [plan for plan in computing_plans if (plan.participant, plan.session) in sessions_with_kernels]
    if not plans_with_kernels:
        return ""
    names = sorted({name for plan in plans_with_kernels for name in plan.computed})
    noun = "blocks" if len(names) > 1 else "block"
    blocks = f"{noun} " + " and ".join(names)
    kernels = " and ".join(_list_software(qualities, "page_kernels"))
    sessions = ""
    if len(plans_with_kernels) < len(computing_plans):
        sessions = f"in {len(plans_with_kernels)} of {len(computing_plans)} sessions "
    return (
        f" In browsers {sessions}the page stepped and drew {blocks} ahead of the server (kernels {kernels}), which "
        "compared every step with its own and recorded its own."
    )
