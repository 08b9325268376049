"""A run of sessions with a language model: its expenses, its limits, and whether it has to stop."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from minihuman.errors import MinihumanError
from minihuman.experiment.machine.events import (
    ModelCall,
)
from minihuman.experiment.protocol.specs import ModelSpec
from minihuman.log.record.disk import GroupCommit
from minihuman.simulation.chat_client import ChatClient, ModelClient
from minihuman.simulation.model_conversation import (
    SpentTotals,
)

PLAYER_PREFIX = "model:"


class RunStoppedError(MinihumanError, RuntimeError):
    """The run stopped before its sessions were complete; the same command resumes them."""


@dataclass(slots=True)
class ModelRun:
    """Counts the expenses of all sessions of a model's run, and decides whether the run has to stop."""

    name: str  # "model:NAME", or "http:NAME" of a program
    make_client: Callable[[ModelSpec], ModelClient]
    max_price: float = 0.0
    changed: Callable[[SpentTotals], object] = lambda _: None
    spent: SpentTotals = field(default_factory=SpentTotals)
    stopped: str = ""  # why the run stops; "" while it goes on
    lock: threading.Lock = field(default_factory=threading.Lock)
    # one sync for all calls in flight: none of them waits for a picture, and each takes longer than a sync
    group_commit: GroupCommit = field(default_factory=lambda: GroupCommit(max_single_syncs=1))

    @classmethod
    def of_model(cls, player: str, **settings: Any) -> "ModelRun":
        """Make the run of a language model, given as "model:NAME"; ``settings`` are further fields of the run."""
        model = player.removeprefix(PLAYER_PREFIX)

        def make_client(spec: ModelSpec) -> ChatClient:
            amounts = {"temperature": spec.temperature, "max_tokens": spec.max_tokens}
            request_settings: dict[str, float] = {  # some endpoints name the limit max_completion_tokens
                field_name: amounts[field_name.replace("_completion", "")] for field_name in spec.request_fields
            }
            return ChatClient(model, settings=request_settings, timeout_s=spec.timeout_s)

        return cls(player, make_client, **settings)

    def check(self) -> None:
        """Refuse a further request if the run has to stop.

        Raises:
            RunStoppedError: if the run has to stop.
        """
        if self.max_price and self.spent.price >= self.max_price:
            self.stop(f"the run's limit of {self.max_price:g} is reached")
        if self.stopped:
            raise RunStoppedError(f"{self.stopped}; run the same command again to resume with the next call")

    def stop(self, reason: str) -> None:
        """Prevent further requests; the first reason is kept."""
        with self.lock:
            self.stopped = self.stopped or reason

    def count(self, call: ModelCall) -> None:
        """Add a finished call to the expenses, and report the new totals."""
        with self.lock:
            self.spent = self.spent.add(call)
        self.changed(self.spent)
