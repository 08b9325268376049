"""Key maps of a session's blocks: fixed, drawn or carried over, with the actions of spare keys."""

from itertools import cycle

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.allocation import AllocationSlot
from minihuman.experiment.plan.random_streams import draw_permutation
from minihuman.experiment.plan.session_plan import KeyMap, Participant
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol


class KeyMapPlanner:
    """A planner of the key maps of one participant's session, block by block.

    Args:
        protocol: the study's protocol.
        participant: the participant, whose index selects the random streams.
        session: the session's number.
        slot: the participant's allocation slot, with the key positions drawn for first sessions.
    """

    def __init__(self, protocol: Protocol, participant: Participant, session: int, slot: AllocationSlot) -> None:
        self._protocol = protocol
        self._participant = participant
        self._session = session
        self._slot = slot
        self._pool = protocol.keys.pool
        self._latest: tuple[BlockSpec, KeyMap] | None = None  # the previous block and its key map

    def plan(self, block: BlockSpec, draw: int) -> KeyMap:
        """Return the key map of the session's next block; ``draw`` is the index of the block's draw of keys.

        Raises:
            ProtocolError: if the block would carry over a map for a different number of actions.
        """
        match block.key_map:
            case "fixed":
                key_map = self._deal_spare_keys(block, draw, dict(block.fixed_keys))
            case "constant":
                key_map = self._map_row(block, draw, self._slot.kept)
            case "carry_over" if self._latest is not None:
                key_map = self._carry_over(block, draw, *self._latest)
            case _:
                key_map = self._draw(block, draw)
        self._latest = (block, key_map)
        return key_map

    def _draw(self, block: BlockSpec, draw: int) -> KeyMap:
        """Return a key map with drawn keys; the first session's are from the allocation list, which balances them."""
        if self._session == 1:
            return self._map_row(block, draw, self._slot.positions[draw])
        return self._map_row(block, draw, self._permute(len(self._pool), f"key-map-{draw}"))

    def _map_row(self, block: BlockSpec, draw: int, row: tuple[int, ...]) -> KeyMap:
        """Return the key map in which a block's i-th action has the pool's key of index ``row[i]``."""
        keys = {self._pool[key_index]: action for key_index, action in zip(row, block.actions, strict=False)}
        return self._deal_spare_keys(block, draw, keys)

    def _carry_over(self, block: BlockSpec, draw: int, previous_block: BlockSpec, key_map: KeyMap) -> KeyMap:
        """Return the previous block's key map with each action replaced by the action at its position in the new block.

        Raises:
            ProtocolError: if the blocks differ in their number of actions.
        """
        previous_actions = previous_block.actions
        if len(previous_actions) != len(block.actions):  # only in an earlier log, as the protocol is refused now
            counts = f"{len(block.actions)} actions for a key map with {len(previous_actions)}"
            raise ProtocolError(f"block {block.name!r} has {counts}; give the block its own key map")
        new_actions = dict(zip(previous_actions, block.actions, strict=True))
        keys = {key: new_actions[action] for key, action in key_map.keys.items() if action in new_actions}
        return self._deal_spare_keys(block, draw, keys)

    def _deal_spare_keys(self, block: BlockSpec, draw: int, keys: dict[str, str]) -> KeyMap:
        """Return a key map from ``keys``, the action of each key, with a block's distractors dealt to the spare keys.

        The distractors are dealt in turn to the spare keys in random order; without distractors the keys stay spare.
        """
        spare_keys = tuple(key for key in self._pool if key not in keys)
        if block.distractors:
            order = self._permute(len(spare_keys), f"distractors-{draw}")
            shuffled_keys = [spare_keys[index] for index in order]
            keys = {**keys, **dict(zip(shuffled_keys, cycle(block.distractors), strict=False))}
            spare_keys = ()
        seed = self._protocol.study.seed
        return KeyMap(keys=keys, spare_keys=spare_keys, spare=self._protocol.keys.spare_keys, seed=seed)

    def _permute(self, count: int, purpose: str) -> tuple[int, ...]:
        """Return a random permutation of 0 to count - 1 that depends on a purpose and the participant's session."""
        purpose = f"{purpose}-session-{self._session}"
        return draw_permutation(count, seed=self._protocol.study.seed, purpose=purpose, index=self._participant.index)
