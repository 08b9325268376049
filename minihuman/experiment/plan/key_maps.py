"""Key maps of a session's blocks: fixed, drawn, or carried over, with what spare keys do."""

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.random_streams import draw_permutation
from minihuman.experiment.plan.session_plan import KeyMap, Participant
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol


def draw_key_map(
    protocol: Protocol, block: BlockSpec, row: tuple[int, ...], participant: Participant, session: int, number: int
) -> KeyMap:
    """Draw a block's keys: in the first session those of the allocation list's row."""
    pool = protocol.keys.pool
    if session > 1:  # the balanced list is for first sessions; later ones draw on their own
        row = draw_permutation(
            len(pool), seed=protocol.study.seed, purpose=f"key-map-{number}-session-{session}", index=participant.index
        )
    return map_row_to_keys(protocol, block, row, participant, session, number)


def map_row_to_keys(
    protocol: Protocol, block: BlockSpec, row: tuple[int, ...], participant: Participant, session: int, number: int
) -> KeyMap:
    """Give a block's actions the keys whose places in the pool a row lists."""
    pool = protocol.keys.pool
    keys = {pool[place]: action for place, action in zip(row, block.actions, strict=False)}
    return deal_spare_keys(protocol, block, keys, participant, session, number)


def carry_key_map(
    protocol: Protocol,
    before: BlockSpec,
    block: BlockSpec,
    key_map: KeyMap,
    participant: Participant,
    session: int,
    number: int,
) -> KeyMap:
    """The same keys, action for action by position in the two blocks' lists."""
    if len(before.actions) != len(block.actions):  # only in a log: a new protocol is refused
        counts = f"{len(block.actions)} actions for a key map with {len(before.actions)}"
        raise ProtocolError(f"block {block.name!r} has {counts}; give the block its own key map")
    renamed = dict(zip(before.actions, block.actions, strict=True))
    keys = {key: renamed[action] for key, action in key_map.keys.items() if action in renamed}
    return deal_spare_keys(protocol, block, keys, participant, session, number)


def deal_spare_keys(
    protocol: Protocol, block: BlockSpec, keys: dict[str, str], participant: Participant, session: int, number: int
) -> KeyMap:
    """Add what spare keys do: distractors in turn over the spare keys, in random order."""
    seed = protocol.study.seed
    spare = tuple(key for key in protocol.keys.pool if key not in keys)
    purpose = f"distractors-{number}-session-{session}"
    if block.distractors:
        order = draw_permutation(len(spare), seed=seed, purpose=purpose, index=participant.index)
        dealt = {spare[place]: block.distractors[turn % len(block.distractors)] for turn, place in enumerate(order)}
        keys = {**keys, **dealt}
        spare = ()
    return KeyMap(keys=keys, spare_keys=spare, spare=protocol.keys.spare_keys, seed=seed)
