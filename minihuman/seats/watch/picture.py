"""What a participant sees now, drawn again from the world, its seed and the actions in the live log."""

import io
from contextlib import suppress
from typing import Any

from PIL import Image

from minihuman.seats.watch.live import Live
from minihuman.worlds.adapt.world import World

SIZE_PX = (480, 360)


class Picture:
    """Keeps a world beside a live session and steps it as far as the log has come."""

    def __init__(self) -> None:
        self._world: tuple[tuple[str, dict[str, Any]], World] | None = None
        self._at: tuple[int, int] = (-1, 0)  # episode, steps taken
        self._png = b""

    def png(self, live: Live) -> bytes:
        """The present picture as PNG; b"" where no episode has begun or the world cannot be run here."""
        if live.episode is None:
            return b""
        try:
            return self._drawn(live, live.episode.plan.episode)
        except Exception:  # whatever somebody's world may raise: the session itself says so, in its log
            self.close()
            return b""

    def close(self) -> None:
        """Let go of the world."""
        if self._world is not None:
            with suppress(Exception):
                self._world[1].close()
        self._world, self._at, self._png = None, (-1, 0), b""

    def _drawn(self, live: Live, episode: int) -> bytes:
        assert live.episode is not None
        plan, wanted = live.episode.plan, (episode, len(live.actions))
        if wanted == self._at:
            return self._png
        key = (plan.world, plan.options)
        if self._world is None or self._world[0] != key:
            self.close()
            self._world = (key, World(plan.world, plan.options))
        world = self._world[1]
        if self._at[0] != episode or self._at[1] > wanted[1]:
            world.reset(plan.seed)
            self._at = (episode, 0)
        for action in live.actions[self._at[1] :]:
            world.step(action)
        file = io.BytesIO()
        Image.fromarray(world.frame(plan.view, SIZE_PX, plan.palette)).save(file, "png", compress_level=1)
        self._at, self._png = wanted, file.getvalue()
        return self._png
