"""The agent host: answers a session's requests to agents, such as for a policy, its advice, a clip or a group.

If a group is still to be drawn, the draw comes first, and the drawn plan's host answers from then on.
"""

import logging
import math
import typing
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path

from minihuman.activities.agent_blocks.events import PolicyGiven
from minihuman.activities.agent_blocks.plan import AGENT_HOST, LATEST_POLICY
from minihuman.activities.agent_blocks.requests import Advice, AdviceRequest, NewPolicy, PolicyRequest
from minihuman.activities.clip_requests import ClipRequest, EpisodeRequest
from minihuman.activities.episode_clips import ClipOffered, EpisodeClip
from minihuman.admin.policies import PolicyStore
from minihuman.agents.agent import (
    POLICY_AGENT,
    BaseAgent,
    is_registered_agent,
    load_agent_class,
    make_agent,
    make_policy_agent,
)
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler
from minihuman.experiment.machine.events import Event
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.life_signs import LifeSigns
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.pending_session import is_allocation_pending
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.paths import SegmentPath
from minihuman.log.read.session_reader import read_log
from minihuman.plugins import describe_failure, limit_answer_time, locate_error
from minihuman.runtime.clip_sampler import ClipSampler
from minihuman.runtime.group_draw import GroupDrawHost
from minihuman.runtime.learner_process import LearnerProcess, LearnerRequest
from minihuman.runtime.session_hosts import HostContext, make_session_host
from minihuman.runtime.team_host import TeamTable
from minihuman.worlds.adapters.world import World

LOG = logging.getLogger("minihuman")
_SEED_STRIDE = 1_000_003  # between the seeds of two participants
N_CANDIDATE_PAIRS = 10  # pairs among which the learner chooses the one that its ensemble disagrees on most


class AgentHost(RequestHandler):
    """Answers requests for policies, advice, clips and episodes; holds the agent that plays, and asks the learner.

    Args:
        policies: the store of the study's policy files.
        files: the files that come with the protocol, by name.
        logs: returns the session's logs so far, including the live one; it is called whenever a learner is asked.
        learner: the process that learns; None if no part of the session has a learner.
        earlier: the policy that played last in each part of the session, after an interruption.
        clips: the sampler of clips to compare; None if no part of the session compares clips.
        seed: the seed of all learning.
        patient: whether to wait for the learner, because no participant is waiting.
        unhurried: whether to give the learner no time limit, so that its policy depends on its data alone.
    """

    def __init__(
        self,
        policies: PolicyStore,
        files: Mapping[str, bytes],
        *,
        logs: Callable[[], list[Path]],
        learner: LearnerProcess | None = None,
        earlier: Mapping[int, str] | None = None,
        clips: ClipSampler | None = None,
        seed: int = 0,
        patient: bool = False,
        unhurried: bool = False,
    ) -> None:
        self._policies = policies
        self._files = files
        self._logs = logs
        self._learner = learner
        self._earlier = dict(earlier or {})
        self._clips = clips
        self._seed = seed
        self._patient = patient
        self._unhurried = unhurried
        self._latest = max(self._earlier.items(), default=(0, ""))[1]
        self._candidates: list[tuple[EpisodeClip, EpisodeClip]] = []  # pairs that the learner is choosing from
        self._pair: tuple[EpisodeClip, EpisodeClip] | None = None  # the pair whose first clip was offered
        self._agents: dict[str, BaseAgent] = {}  # the agent that plays, by its policy
        self._last_begun: tuple[str, int] | None = None  # policy and episode that an agent began last

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """Return the input that answers a request of the session; None if there is no answer yet, or none from here.

        Args:
            want: the request.
            play: the running episode; None if no episode is running.
            t_ns: the session's time, which the input gets.
        """
        match want:
            case PolicyRequest(learning=True):
                return self._learn_policy(want, t_ns)
            case PolicyRequest():
                return self._adopt_first_policy(want, t_ns)
            case AdviceRequest() if play is not None:
                return self._ask_advice(want, play, t_ns)
            case ClipRequest() if self._clips is not None:
                return self._offer_clip(self._clips, want, t_ns)
            case EpisodeRequest() if self._clips is not None:
                return ClipOffered(t_ns, self._clips.episode(want))
        return None

    def close(self) -> None:
        """End the learner's process, if there is one."""
        if self._learner is not None:
            self._learner.close()

    # Policies

    def _adopt_first_policy(self, want: PolicyRequest, t_ns: int) -> NewPolicy:
        """Adopt the policy with which a part begins: the requested one or, after an interruption, the one played last.

        Return the session's input, with the reason if the policy cannot be used.
        """
        earlier = self._earlier.get(want.part)
        if earlier is not None:
            return self._adopt_policy(earlier, t_ns)
        name = want.policy
        if name == LATEST_POLICY:
            name = self._latest
        is_loadable = not name or is_registered_agent(name) or name == self._latest
        if is_loadable:
            return self._adopt_policy(name, t_ns)
        try:
            return self._adopt_policy(self._policies.keep(self._files[name]), t_ns)
        except (KeyError, OSError) as error:
            LOG.warning("the policy %s is not there: %s", name, error)
            return NewPolicy(t_ns, want.policy, f"{name} is not there: {describe_failure(error)}")

    def _adopt_policy(self, policy: str, t_ns: int) -> NewPolicy:
        """Load a policy before it plays, so that one that cannot be loaded never plays; return the session's input."""
        if policy and policy not in self._agents:
            try:
                self._agents = {policy: self._load_agent(policy)}
                self._last_begun = None
            except Exception as error:  # any error of a laboratory's own agent
                LOG.warning("the policy %s cannot be loaded: %s", policy, error)
                return NewPolicy(t_ns, "", f"the agent failed: {describe_failure(error)}")
        self._latest = policy or self._latest
        return NewPolicy(t_ns, policy)

    def _learn_policy(self, want: PolicyRequest, t_ns: int) -> NewPolicy | None:
        """Ask the learner for the next policy and adopt it; return the session's input, or None while no answer came.

        If there is no policy, the input has the reason.
        """
        if self._learner is None:
            return NewPolicy(t_ns, want.policy, "there is no learner here")
        if not self._learner.busy:
            self._learner.ask(self._build_policy_request(want))
        answer = self._learner.answer(patient=self._patient)
        if answer is None:
            return None
        if answer.failure:
            LOG.warning("the learner gave no policy: %s", answer.failure)
            return NewPolicy(t_ns, want.policy, answer.failure)
        try:
            policy = self._policies.keep(Path(answer.file).read_bytes())
        except OSError as error:
            LOG.warning("the policy cannot be kept: %s", error)
            return NewPolicy(t_ns, want.policy, f"the policy cannot be kept: {describe_failure(error)}")
        return self._adopt_policy(policy, t_ns)

    def _build_policy_request(self, want: PolicyRequest) -> LearnerRequest:
        """Return the request for a policy that continues from the present one if that is a policy file."""
        start = ""
        if self._policies.path(want.policy).is_file():
            start = str(self._policies.checked(want.policy))
        return LearnerRequest(
            logs=[str(path) for path in self._logs()],
            part=want.name,
            episodes=want.episode,
            learner=want.agent.learner,
            seed=self._seed + want.episode,
            start=start,
            budget_s=self._limit_learning_s(want.agent.budget_s),
        )

    def _limit_learning_s(self, budget_s: float) -> float:
        """Return the learner's time limit in seconds: the given one, or infinity if the learner is unhurried."""
        if self._unhurried:
            return math.inf
        return budget_s

    # Pairs

    def _offer_clip(self, clips: ClipSampler, want: ClipRequest, t_ns: int) -> ClipOffered | None:
        """Return clip ``want.place`` (0 or 1) of a random pair, or of one on which the learner's ensemble differs most.

        Return None while the learner chooses that pair.
        """
        if want.pairing == "random" or self._learner is None:
            return ClipOffered(t_ns, clips.draw(want))
        if want.place:  # the second clip of a pair
            pair = self._pair
            self._pair = None
            if pair is None or pair[0] != want.again:
                return ClipOffered(t_ns, clips.draw(want))
            return ClipOffered(t_ns, pair[1])
        if not self._candidates:
            pairs = clips.draw_pairs(want, N_CANDIDATE_PAIRS)
            if len(pairs) < 2 or self._learner.busy:
                return ClipOffered(t_ns, clips.draw(want))
            self._learner.ask(self._build_pair_request(want, pairs))
            self._candidates = pairs
        answer = self._learner.answer(patient=self._patient)
        if answer is None:
            return None
        if answer.failure:
            LOG.warning("the first candidate pair is shown, as the learner chose none: %s", answer.failure)
        index = 0
        if answer.file.isdecimal():
            index = min(int(answer.file), len(self._candidates) - 1)
        self._pair = self._candidates[index]
        self._candidates = []
        return ClipOffered(t_ns, self._pair[0])

    def _build_pair_request(
        self, want: ClipRequest, pairs: Sequence[tuple[EpisodeClip, EpisodeClip]]
    ) -> LearnerRequest:
        """Return the request that the learner chooses one of these pairs."""
        return LearnerRequest(
            logs=[str(path) for path in self._logs()],
            part=want.source,
            episodes=0,
            learner="",
            seed=self._seed + want.pair,
            start="",
            budget_s=self._limit_learning_s(want.wait_s),
            pairs=pairs,
        )

    # Advice

    def _ask_advice(self, want: AdviceRequest, play: RunningEpisode, t_ns: int) -> ActivityInput | None:
        """Return the agent's probability of each action in the running episode, or a `NewPolicy` with its failure."""
        policy_and_episode = (want.policy, play.plan.episode)
        try:
            with limit_answer_time():
                agent = self._get_agent(want.policy)
                if self._last_begun != policy_and_episode:
                    self._begin_episode(agent, play)
                    self._last_begun = policy_and_episode
                probabilities = tuple(float(probability) for probability in agent.action_probabilities(play.world))
        except Exception as error:  # any error of a laboratory's own agent; the person can still play
            LOG.warning("the agent failed: %s at %s: %s", type(error).__name__, locate_error(error), error)
            return NewPolicy(t_ns, want.policy, f"the agent failed: {describe_failure(error)}")
        return Advice(t_ns, want.step, probabilities)

    def _get_agent(self, policy: str) -> BaseAgent:
        """Return the agent of a policy, after loading it again if another policy has taken its place.

        Raises:
            MinihumanError: if it cannot be loaded.
        """
        if policy not in self._agents:
            self._last_begun = None
            self._agents = {policy: self._load_agent(policy)}
        return self._agents[policy]

    def _load_agent(self, policy: str) -> BaseAgent:
        """Make the agent of a policy: a registered agent by its name, or the agent of a policy file.

        Raises:
            MinihumanError: if it cannot be loaded.
        """
        if is_registered_agent(policy):
            return make_agent(policy)
        return make_policy_agent(self._policies.checked(policy))

    def _begin_episode(self, agent: BaseAgent, play: RunningEpisode) -> None:
        """Let the agent begin an episode; after a resumption, show it all earlier steps, since it may have a memory."""
        if not play.actions:
            agent.begin(play.plan, play.world)
            return
        with closing(World(play.plan.world, play.plan.options)) as world:
            world.reset(play.plan.seed)
            agent.begin(play.plan, world)
            for action in play.actions:
                agent.action_probabilities(world)
                world.step(action)


def make_agent_host(
    protocol: Protocol,
    plan: SessionPlan,
    data: Path,
    *,
    patient: bool = False,
    logged: Sequence[Event] = (),
    teams: TeamTable | None = None,
    changed: Callable[[], None] = lambda: None,
    signs: LifeSigns | None = None,
) -> RequestHandler | None:
    """Make the handler of a session's requests; return None if no part makes requests and the group is drawn.

    Policies are kept in the study's folder. A learner's process is started at once, since that takes seconds. A resumed
    session uses the policies that its log names last.

    Args:
        protocol: the study.
        plan: the plan of the session's segment.
        data: the data folder.
        patient: whether to wait for the learner, because no participant is waiting.
        logged: the events so far of a segment that is resumed.
        teams: the teams of this process; None to use the session's own, in which all partners are agents.
        changed: called when a member of the session's team did something that may answer one of its requests.
        signs: the signs of life of the session's page; None if the session is not in a page.
    """
    if is_allocation_pending(plan):

        def make_next(drawn_plan: SessionPlan) -> RequestHandler | None:
            return make_agent_host(
                protocol, drawn_plan, data, patient=patient, teams=teams, changed=changed, signs=signs
            )

        return GroupDrawHost(protocol, plan, data, make_next)
    context = HostContext(
        protocol, plan, data, patient=patient, logged=logged, teams=teams, changed=changed, signs=signs
    )
    return make_session_host(context)


class AgentHostedPlan(typing.Protocol):
    """The plan of a part whose requests the agent host answers."""

    @property
    def needs_learner(self) -> bool:
        """Return whether a learner makes policies for the part, or chooses pairs of clips."""

    def plays_policy_file(self, files: Container[str]) -> bool:
        """Return whether the part plays a policy that a learner makes or that is one of the protocol's files."""


def make_policy_host(context: HostContext) -> AgentHost:
    """Make the host that answers a session's requests for agents, clips and episodes, and start its learner if any."""
    plan = context.plan
    plans: list[AgentHostedPlan] = [part.plan for part in plan.parts if getattr(part.plan, "host", "") == AGENT_HOST]
    learner = None
    if any(hosted.needs_learner for hosted in plans):
        learner = LearnerProcess()
        learner.start()
    if any(hosted.plays_policy_file(context.protocol.files) for hosted in plans):
        with suppress(MinihumanError):  # reported when a policy is to play
            load_agent_class(POLICY_AGENT)  # seconds, for what it imports: now, and not between two episodes
    earlier = _find_latest_policies(context.logged)
    if plan.segment > 1:
        session_folder = SegmentPath.of_plan(context.data, plan).log.parent
        earlier = _find_latest_policies(read_log(session_folder).part_events) | earlier
    return AgentHost(
        PolicyStore(context.data / plan.study),
        context.protocol.files,
        logs=context.list_logs,
        learner=learner,
        earlier=earlier,
        clips=ClipSampler(context.list_logs, seed=plan.study_seed, index=plan.participant.index),
        seed=plan.study_seed + _SEED_STRIDE * plan.participant.index,
        patient=context.patient,
        unhurried=context.patient,
    )


def _find_latest_policies(events: Iterable[object]) -> dict[int, str]:
    """Return the last policy that the events name for each part, by the part's number."""
    return {event.part: event.policy for event in events if isinstance(event, PolicyGiven)}
