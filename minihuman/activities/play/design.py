"""The adaptive design of a block, which decides before each episode."""

from typing import Any

import msgspec

from minihuman.experiment.machine.activity import SessionContext
from minihuman.experiment.machine.events import DesignDecided
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.designs import DesignSpec, PlayedEpisode, make_design
from minihuman.experiment.plan.random_streams import make_draw
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.worlds.hashing import hash64


class BlockDesign:
    """The adaptive design of a block, which decides before each episode and once when the block is over.

    Args:
        spec: the design's settings.
        number: the part's index in the plan.
        name: the part's name.
        context: the session, which receives the events.
    """

    def __init__(self, spec: DesignSpec, number: int, name: str, context: SessionContext) -> None:
        self._spec = spec
        self._number = number
        self._name = name
        self._context = context
        self._design = make_design(spec)
        self._decided: DesignDecided | None = None
        self.history: list[PlayedEpisode] = []

    def add_episode(self, play: RunningEpisode) -> None:
        """Add a finished episode to the design's history."""
        plan = play.plan
        outcome = play.outcome
        assert outcome is not None
        self.history.append(PlayedEpisode(plan.options, plan.seed, outcome, play.steps, play.return_))

    def decide(self, *, goes_on: bool) -> bool:
        """Ask the design about the next episode, log its decision, and return whether the design ends the block now.

        If the block is over anyway (``goes_on`` is false), only the design's last estimates count, and False is
        returned.
        """
        context = self._context
        plan = self._context.plan
        purpose = f"design-{self._name}-session-{plan.session}-episode-{context.next_episode}"
        decision = self._design.decide(self.history, make_draw(plan.study_seed, purpose, plan.participant.index))
        options: dict[str, Any] = {}
        seed: int | None = None
        if goes_on and not decision.stop:
            options = dict(decision.options)
            seed = decision.seed
        self._decided = DesignDecided(
            t_ns=context.now_ns,
            part=self._number,
            episode=context.next_episode,
            design=self._spec.name,
            version=self._design.version,
            options=options,
            seed=seed,
            stop=decision.stop or not goes_on,
            estimates=dict(decision.estimates),
            posterior=hash64(decision.posterior),
        )
        context.emit(self._decided)
        return decision.stop and goes_on

    def resolve(self, plan: EpisodePlan) -> EpisodePlan:
        """Return an episode's plan with the options and the seed that the design decided on."""
        assert self._decided is not None, "a design decides before each episode"
        resolved = msgspec.structs.replace(plan, options=plan.options | self._decided.options)
        if self._decided.seed is None:
            return resolved
        return msgspec.structs.replace(resolved, seed=self._decided.seed)
