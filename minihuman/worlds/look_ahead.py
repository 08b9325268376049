"""Looking ahead in a world of ours: what would come of actions, without making them."""

from collections.abc import Sequence

from minihuman.errors import WorldError
from minihuman.worlds.contract import NativeWorld


def first_success(world: NativeWorld, actions: Sequence[int], *, most_scenes: int = 2_000) -> list[int] | None:
    """The shortest list of these actions that earns something, found by trying them all; None if there is none.

    Scenes that two ways lead to are looked at once. The world is left as it was. Its step limit counts.

    Raises:
        WorldError: if there are more scenes than ``most_scenes``.
    """
    before = world.save()
    seen, waiting, parents = {world.scene_hash()}, [before], [(-1, -1)]
    try:
        for at, saved in enumerate(waiting):  # which grows meanwhile
            for action in actions:
                world.restore(saved)
                reward, terminated, truncated = world.advance(action)
                if reward > 0:
                    return back_to_start(parents, at, action)
                scene = world.scene_hash()
                if terminated or truncated or scene in seen:
                    continue
                seen.add(scene)
                if len(seen) > most_scenes:
                    raise WorldError(f"no way to success in the first {most_scenes} scenes")
                parents.append((at, action))
                waiting.append(world.save())
        return None
    finally:
        world.restore(before)


def back_to_start(parents: list[tuple[int, int]], at: int, last: int) -> list[int]:
    """The actions that led to a state, and one more; ``parents`` are the state before each and the action between."""
    actions = [last]
    while at > 0:
        at, action = parents[at]
        actions.append(action)
    return actions[::-1]
