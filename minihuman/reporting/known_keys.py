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


def _list_groups_with_known_keys(cells: Mapping[tuple[str, int, str], bool]) -> list[str]:
    """Return, sorted, the groups in which all participants knew the keys in their first session with the block."""
    first_sessions: dict[str, int] = {}
    for group, session, _ in cells:
        first_sessions[group] = min(session, first_sessions.get(group, session))
    known_in_first = dict.fromkeys(first_sessions, True)
    for (group, session, _), known in cells.items():
        if session == first_sessions[group]:
            known_in_first[group] = known_in_first[group] and known
    return sorted(group for group, known in known_in_first.items() if known)


def find_known_cells(plans: Sequence[PlanOutline], specs: BlockSpecs) -> dict[str, dict[Cell, bool]]:
    """Return, by block and cell, whether all participants kept the keys of an earlier block.

    If only some participants have equal keys, that is due to chance. Keys that the protocol draws anew never count as
    an earlier block's, whatever was drawn.
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
            known = may_know and any(effects == _map_key_effects(before) for before in earlier)
            cells[cell] = cells.get(cell, True) and known
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
    """Return the blocks in which the discovery of keys tells nothing of the groups.

    All keys were shown or known from before, or a group's participants knew them in one session or order of blocks and
    not in another.
    """
    shown: dict[str, bool] = {}
    for plan in plans:
        for block_plan in plan.blocks:
            shown[block_plan.block_name] = shown.get(block_plan.block_name, True) and block_plan.show_keys
    cells_by_block = find_known_cells(plans, BlockSpecs(protocols))
    return frozenset(block for block in shown if shown[block] or not _tells_groups_apart(cells_by_block[block]))


def _tells_groups_apart(cells: Mapping[Cell, bool]) -> bool:
    """Return whether each group either knew all keys or had to discover them, and one had to."""
    by_group: dict[str, set[bool]] = {}
    for (group, _, _), is_known in cells.items():
        by_group.setdefault(group, set()).add(is_known)
    return all(len(known) == 1 for known in by_group.values()) and {False} in by_group.values()
