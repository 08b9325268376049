"""The agent's seat: what a session with an agent wants from outside, a policy or its advice, is answered here."""

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path

from minihuman.errors import MinihumanError
from minihuman.lab.policies import Policies
from minihuman.log.paths import SegmentPath
from minihuman.log.read.open_log import open_log
from minihuman.players.agent import POLICY, Agent, agent_kind, agent_of_file, is_agent, make_agent
from minihuman.seats.learner import Learner, Request
from minihuman.seats.slot_seat import SlotSeat
from minihuman.seats.stretches import Stretches
from minihuman.study.activities.agent_events import Advice, NewPolicy, PolicyGiven, WantsAdvice, WantsPolicy
from minihuman.study.activities.agent_plan import LATEST, AgentPlayPlan
from minihuman.study.activities.correction import CorrectionPlan
from minihuman.study.activities.correction_events import WantsEpisode
from minihuman.study.activities.pair_events import Offered, Stretch, WantsStretch
from minihuman.study.activities.port import Outside, Want
from minihuman.study.activities.preferences import PreferencesPlan
from minihuman.study.events import Event
from minihuman.study.inputs import ForPart
from minihuman.study.plan import SessionPlan
from minihuman.study.play import Play
from minihuman.study.protocol import Protocol
from minihuman.study.undrawn import is_undrawn
from minihuman.worlds.adapt.world import World

LOG = logging.getLogger("minihuman")
CANDIDATES = 10  # pairs that are looked at for one that is disagreed on


class AgentSeat(Outside):
    """Holds the agent that plays, and asks the learner for the next.

    Args:
        policies: where the study's policy files are kept.
        files: those that the protocol names beside itself, by name.
        logs: the session's logs so far, the live one among them; looked up whenever a learner is asked.
        learner: the process that learns; None where no part of the session has any.
        earlier: the policy that played last in each part of the session, where it goes on after an interruption.
        stretches: what is compared; None where no part of the session compares.
        seed: of all learning.
        patient: wait for the learner: nobody is there whose time it takes.
        unhurried: let it take as long as it likes, so that what it makes depends on nothing but what it is given.
    """

    def __init__(
        self,
        policies: Policies,
        files: Mapping[str, bytes],
        *,
        logs: Callable[[], list[Path]],
        learner: Learner | None = None,
        earlier: Mapping[int, str] | None = None,
        stretches: Stretches | None = None,
        seed: int = 0,
        patient: bool = False,
        unhurried: bool = False,
    ) -> None:
        self._policies = policies
        self._files = files
        self._logs = logs
        self._learner = learner
        self._earlier = dict(earlier or {})
        self._stretches = stretches
        self._seed = seed
        self._patient = patient
        self._unhurried = unhurried
        self._latest = max(self._earlier.items(), default=(0, ""))[1]
        self._disputed: list[tuple[Stretch, Stretch]] = []  # pairs that the learner was asked about
        self._pair: tuple[Stretch, Stretch] | None = None  # of which the first was offered
        self._agents: dict[str, Agent] = {}  # the one that plays, by the name of its policy
        self._begun: tuple[str, int] | None = None  # policy and episode that it has been told of

    def answer(self, want: Want, play: Play | None, t_ns: int) -> ForPart | None:
        """An input for the session; None where there is nothing to say yet."""
        match want:
            case WantsPolicy(learning=True):
                return self._learnt(want, t_ns)
            case WantsPolicy():
                return self._first(want, t_ns)
            case WantsAdvice() if play is not None:
                return self._advice(want, play, t_ns)
            case WantsStretch() if self._stretches is not None:
                return self._offered(self._stretches, want, t_ns)
            case WantsEpisode() if self._stretches is not None:
                return Offered(t_ns, self._stretches.episode(want))
        return None

    def close(self) -> None:
        """Let the learner go."""
        if self._learner is not None:
            self._learner.close()

    # Policies

    def _first(self, want: WantsPolicy, t_ns: int) -> NewPolicy:
        name = self._latest if want.policy == LATEST else want.policy
        if (earlier := self._earlier.get(want.part)) is not None:
            return self._adopted(earlier, t_ns)
        if not name or is_agent(name) or name == self._latest:
            return self._adopted(name, t_ns)
        try:
            return self._adopted(self._policies.keep(self._files[name]), t_ns)
        except (KeyError, OSError) as error:
            return NewPolicy(t_ns, want.policy, f"{name} is not there: {error}")

    def _adopted(self, policy: str, t_ns: int) -> NewPolicy:
        """Load a policy before it plays, so that one that cannot be loaded never does."""
        if policy and policy not in self._agents:
            try:
                self._agents, self._begun = {policy: self._load(policy)}, None
            except MinihumanError as error:
                return NewPolicy(t_ns, "", str(error))
        self._latest = policy or self._latest
        return NewPolicy(t_ns, policy)

    def _learnt(self, want: WantsPolicy, t_ns: int) -> NewPolicy | None:
        if self._learner is None:
            return NewPolicy(t_ns, want.policy, "there is no learner here")
        if not self._learner.busy:
            start = str(self._policies.checked(want.policy)) if self._policies.path(want.policy).is_file() else ""
            request = Request(
                logs=[str(path) for path in self._logs()],
                part=want.name,
                episodes=want.episode,
                learner=want.agent.learner,
                seed=self._seed + want.episode,
                start=start,
                budget_s=math.inf if self._unhurried else want.agent.budget_s,
            )
            self._learner.ask(request)
        answer = self._learner.answer(patient=self._patient)
        if answer is None:
            return None
        if answer.failure:
            LOG.warning("the learner gave no policy: %s", answer.failure)
            return NewPolicy(t_ns, want.policy, answer.failure)
        try:
            policy = self._policies.keep(Path(answer.file).read_bytes())
        except OSError as error:
            return NewPolicy(t_ns, want.policy, f"the policy cannot be kept: {error}")
        return self._adopted(policy, t_ns)

    # Pairs

    def _offered(self, stretches: Stretches, want: WantsStretch, t_ns: int) -> Offered | None:
        """One side of a pair: any, or of the pair of several that the learner's ensemble disagrees on most."""
        if want.pairing == "random" or self._learner is None:
            return Offered(t_ns, stretches.draw(want))
        if want.place:
            pair, self._pair = self._pair, None
            return Offered(t_ns, stretches.draw(want) if pair is None or pair[0] != want.again else pair[1])
        if not self._disputed:
            pairs = stretches.candidates(want, CANDIDATES)
            if len(pairs) < 2 or self._learner.busy:
                return Offered(t_ns, stretches.draw(want))
            request = Request(
                logs=[str(path) for path in self._logs()],
                part=want.source,
                episodes=0,
                learner="",
                seed=self._seed + want.pair,
                start="",
                budget_s=math.inf if self._unhurried else want.wait_s,
                pairs=pairs,
            )
            self._learner.ask(request)
            self._disputed = pairs
        answer = self._learner.answer(patient=self._patient)
        if answer is None:
            return None
        if answer.failure:
            LOG.warning("any pair comes instead of one that is disagreed on: %s", answer.failure)
        place = int(answer.file) if answer.file.isdecimal() else 0
        self._pair = self._disputed[min(place, len(self._disputed) - 1)]
        self._disputed = []
        return Offered(t_ns, self._pair[0])

    # Advice

    def _advice(self, want: WantsAdvice, play: Play, t_ns: int) -> ForPart | None:
        now = (want.policy, play.plan.episode)
        try:
            agent = self._agent(want.policy)
            if self._begun != now:
                self._begin(agent, play)
                self._begun = now
            chances = agent.advise(play.world)
        except Exception as error:  # whatever somebody's agent raises: the person can still steer
            LOG.warning("the agent gives no advice: %s: %s", type(error).__name__, error)
            return NewPolicy(t_ns, want.policy, f"no advice: {type(error).__name__}: {error}")
        return Advice(t_ns, want.step, tuple(float(chance) for chance in chances))

    def _agent(self, policy: str) -> Agent:
        """The agent of a policy; loaded again where another was there in between, or another program had it.

        Raises:
            MinihumanError: if it cannot be.
        """
        if policy not in self._agents:
            self._begun = None
            self._agents = {policy: self._load(policy)}
        return self._agents[policy]

    def _load(self, policy: str) -> Agent:
        return make_agent(policy) if is_agent(policy) else agent_of_file(self._policies.checked(policy))

    def _begin(self, agent: Agent, play: Play) -> None:
        """Let it begin an episode; in the middle of one it is shown all that came before, as it may remember."""
        if not play.actions:
            agent.begin(play.plan, play.world)
            return
        with closing(World(play.plan.world, play.plan.options)) as world:
            world.reset(play.plan.seed)
            agent.begin(play.plan, world)
            for action in play.actions:
                agent.advise(world)
                world.step(action)


def agent_seat(
    protocol: Protocol, plan: SessionPlan, data: Path, *, patient: bool = False, logged: Sequence[Event] = ()
) -> Outside | None:
    """The seat of a session's agent; None where no part of the session has one, nor is its group still to be drawn.

    Policies are kept in the study's folder. A learner's process is started at once, as it takes seconds; the policies
    of a session that goes on after an interruption are those that its log names last.

    Args:
        protocol: the study.
        plan: the session's segment.
        data: the data folder.
        patient: nobody is there whose time a learner takes.
        logged: what a segment that is gone on with has said so far.
    """
    if is_undrawn(plan):
        return SlotSeat(protocol, plan, data, lambda drawn: agent_seat(protocol, drawn, data, patient=patient))
    plans = [part.plan for part in plan.parts if isinstance(part.plan, AgentPlayPlan)]
    if not plans and not any(isinstance(part.plan, PreferencesPlan | CorrectionPlan) for part in plan.parts):
        return None
    path = SegmentPath.of_plan(data, plan)

    def logs() -> list[Path]:
        return [file for file in (path.log, path.part) if file.exists()]

    disputes = any(
        isinstance(part.plan, PreferencesPlan) and part.plan.pairing == "disagreement" for part in plan.parts
    )
    learner = Learner() if disputes or any(its.agent.learner for its in plans) else None
    if learner is not None:
        learner.start()
    if any(its.agent.learner or its.agent.policy in protocol.files for its in plans):
        with suppress(MinihumanError):  # who cannot load a policy says so when one is to play
            agent_kind(POLICY)  # seconds, for what it imports: now, and not between two episodes
    return AgentSeat(
        Policies(data / plan.study),
        protocol.files,
        logs=logs,
        learner=learner,
        earlier=(_earlier(path.log) if plan.segment > 1 else {}) | _named(logged),
        stretches=Stretches(logs, seed=plan.study_seed, index=plan.participant.index),
        seed=plan.study_seed + 1_000_003 * plan.participant.index,
        patient=patient,
        unhurried=patient,
    )


def _earlier(log: Path) -> dict[int, str]:
    """The policy that a session's log names last for each part."""
    return _named(open_log(log.parent).part_events)


def _named(events: Iterable[object]) -> dict[int, str]:
    return {event.part: event.policy for event in events if isinstance(event, PolicyGiven)}
