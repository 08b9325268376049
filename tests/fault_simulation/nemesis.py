"""Pages that lie: of the time, of their streams, and of what they computed. No page of ours does any of it."""

from typing import Any

from tests.fault_simulation.page import Tab

S = 1_000_000_000


class PageAhead(Tab):
    """Says that all happens three seconds later than it does."""

    def now_ns(self) -> int:
        return super().now_ns() + 3 * S


class PageBehind(Tab):
    """Says that all happened a second before."""

    def now_ns(self) -> int:
        return max(0, super().now_ns() - S)


class PageJumping(Tab):
    """Says at each hello that ten hours have passed."""

    def _say(self, message: dict[str, Any]) -> None:
        if message["t"] == "hello" and message["segment"]:
            message = {**message, "last": message["last"] + 36_000 * S}
        super()._say(message)


class PageOfOldStreams(Tab):
    """Says under the name of its first stream that nothing was acknowledged."""

    def _say(self, message: dict[str, Any]) -> None:
        if message["t"] == "hello":
            message = {**message, "stream": "first", "life": "stale", "heard": 9}
        super()._say(message)


class PageOfOtherRewards(Tab):
    """Says that its own steps led elsewhere."""

    def _say(self, message: dict[str, Any]) -> None:
        if message["t"] == "n" and message["what"]["t"] == "key":
            message = {**message, "what": {**message["what"], "digest": "0123456789abcdef"}}
        super()._say(message)


NEMESES = (PageAhead, PageBehind, PageJumping, PageOfOldStreams, PageOfOtherRewards)
