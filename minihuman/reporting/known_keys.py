"""Who had to discover the actions of keys: blocks whose keys were shown, or kept from an earlier block, have none."""

from collections.abc import Mapping, Sequence

from minihuman.dataset.recording_quality import PlanOutline
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol

DRAWN_ANEW = ("new", "shown")  # key maps that a protocol draws for a block alone
Cell = tuple[str, int, str]  # group, session, and the block before (of an earlier session too; "" for none)


class BlockSpecs:
    """The blocks of the sessions' protocols, with each group's overrides."""

    def __init__(self, protocols: Sequence[Protocol]) -> None:
        self._protocols = {protocol.sha256: protocol for protocol in protocols}

    def find(self, plan: PlanOutline, block: str) -> BlockSpec | None:
        """Return a block with the overrides of a session's group; None if the session's protocol is not known."""
        protocol = self._protocols.get(plan.protocol_sha256)
        if protocol is None:
            return None
        return protocol.block_for(block, plan.group)


def find_known_keys(plans: Sequence[PlanOutline], protocols: Sequence[Protocol] = ()) -> dict[str, list[str]]:
    """Return, by block, the groups that already knew the keys from an earlier block.

    A group is named if this was true of all its participants the first time they played the block.
    """
    cells_by_block = find_known_cells(plans, BlockSpecs(protocols))
    groups_by_block = {block: _list_groups_with_known_keys(cells) for block, cells in cells_by_block.items()}
    return {block: groups for block, groups in groups_by_block.items() if groups}


def _list_groups_with_known_keys(cells: Mapping[Cell, bool]) -> list[str]:
    """Return, sorted, the groups in which all participants knew the keys in their first session with the block.

    ``cells`` states for each group, session and preceding block whether all participants knew the keys.
    """
    first_sessions: dict[str, int] = {}
    for group, session, _ in cells:
        first_sessions[group] = min(session, first_sessions.get(group, session))
    knew_keys = dict.fromkeys(first_sessions, True)
    for (group, session, _), are_known in cells.items():
        if session == first_sessions[group]:
            knew_keys[group] = knew_keys[group] and are_known
    return sorted(group for group, has_known in knew_keys.items() if has_known)


def find_known_cells(plans: Sequence[PlanOutline], specs: BlockSpecs) -> dict[str, dict[Cell, bool]]:
    """Return, by block and cell, whether all participants kept the keys of an earlier block.

    A cell is a group, a session and the preceding block. If only some participants of a cell have equal keys, that is
    due to chance. Keys that the protocol draws anew never count as those of an earlier block, even if they are equal.
    """
    known_by_block: dict[str, dict[Cell, bool]] = {}
    history: dict[str, list[EpisodePlan]] = {}
    for plan in sorted(plans, key=lambda plan: plan.session):
        earlier = history.setdefault(plan.participant, [])
        for block_plan in plan.blocks:
            cells = known_by_block.setdefault(block_plan.block_name, {})
            block_before = ""
            if earlier:
                block_before = earlier[-1].block_name
            cell = (plan.group, plan.session, block_before)
            spec = specs.find(plan, block_plan.block_name)
            may_know = spec is None or spec.key_map not in DRAWN_ANEW
            effects = _map_key_effects(block_plan)
            are_known = may_know and any(effects == _map_key_effects(before) for before in earlier)
            cells[cell] = cells.get(cell, True) and are_known
            earlier.append(block_plan)
    return known_by_block


def _map_key_effects(block_plan: EpisodePlan) -> dict[str, int]:
    """Map each key to the index of its action in the block's list, because worlds name the same actions differently."""
    return {
        key: block_plan.actions.index(action)
        for key, action in block_plan.key_map.keys.items()
        if action in block_plan.actions
    }


def find_blocks_without_discovery(plans: Sequence[PlanOutline], protocols: Sequence[Protocol] = ()) -> frozenset[str]:
    """Return the blocks in which groups cannot be compared on how they discovered the keys.

    In these blocks all keys were shown or known from before, or the participants of a group knew them in one session or
    order of blocks and not in another.
    """
    shows_keys: dict[str, bool] = {}  # whether all plans with a block show its keys
    for plan in plans:
        for block_plan in plan.blocks:
            name = block_plan.block_name
            shows_keys[name] = shows_keys.get(name, True) and block_plan.show_keys
    cells_by_block = find_known_cells(plans, BlockSpecs(protocols))
    return frozenset(
        block for block, is_shown in shows_keys.items() if is_shown or not _tells_groups_apart(cells_by_block[block])
    )


def _tells_groups_apart(cells: Mapping[Cell, bool]) -> bool:
    """Return whether groups can be compared on how they discovered the keys.

    In each group, either all participants must have known the keys or none, and in at least one group none.
    """
    states_by_group: dict[str, set[bool]] = {}
    for (group, _, _), are_known in cells.items():
        states_by_group.setdefault(group, set()).add(are_known)
    states = list(states_by_group.values())
    return all(len(group_states) == 1 for group_states in states) and {False} in states
