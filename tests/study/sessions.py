"""Small sessions for tests: a protocol in a few lines, and inputs by name."""

from types import MappingProxyType

from minihuman.experiment.machine.events import EpisodeStarted, KeyPressed
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, ScreenShown, Tick
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.worlds.adapters.world import World

MS = 1_000_000

_TOML = """
[study]
name = "corridor"
version = "1"
seed = 11
consent = {consent!r}
closing = {closing!r}
min_rest_s = {break_s}
[keys]
pool = ["1", "2", "3", "4", "5", "6"]
check = {check}
spare_keys = {spare!r}
[[groups]]
name = "all"
blocks = {blocks}
"""
_BLOCK = """
[[blocks]]
name = {name!r}
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = {episodes}
max_steps = {max_steps}
actions = ["back", "forward", "dive", "crash"]
instructions = {instruction!r}
feedback = {feedback}
rest_text = {rest!r}
final_frame_ms = {hold_ms}
{more}
"""


def corridor_plan(
    *,
    blocks: int = 1,
    episodes: int = 2,
    max_steps: int = 5,
    consent: str = "",
    closing: str = "",
    instruction: str = "",
    feedback: str | dict[str, str] = "",
    rest: str = "",
    break_s: float = 0.0,
    check: bool = False,
    spare: str = "ignore",
    hold_ms: float = 0.0,
    more: str = "",
    first_episode: int = 0,
    segment: int = 1,
) -> SessionPlan:
    """A plan for the corridor; the key of an action is ``key_of(plan, action)``."""
    names = [f"block-{number}" for number in range(blocks)]
    toml = _TOML.format(
        consent=consent, closing=closing, break_s=break_s, check=str(check).lower(), spare=spare, blocks=names
    ) + "".join(
        _BLOCK.format(
            name=name,
            episodes=episodes,
            max_steps=max_steps,
            instruction=instruction,
            feedback=_toml(feedback),
            rest=rest,
            hold_ms=hold_ms,
            more=more,
        )
        for name in names
    )
    protocol = decode_protocol(toml.encode())
    return expand_protocol(protocol, enrol_participant(protocol, 0), first_episode=first_episode, segment=segment)


def _toml(feedback: str | dict[str, str]) -> str:
    if isinstance(feedback, str):
        return repr(feedback)
    return "{ " + ", ".join(f"{outcome} = {text!r}" for outcome, text in feedback.items()) + " }"


def key_of(plan: SessionPlan, action: str, episode: int = 0) -> str:
    """The key that an action lies on."""
    return next(key for key, name in plan.episodes[episode].key_map.keys.items() if name == action)


class Desk:
    """A session with a hand on its keyboard: each call is an input one millisecond after the last."""

    facts = MappingProxyType({"machine": "desk"})

    def __init__(self, plan: SessionPlan, **facts: str) -> None:
        self.plan = plan
        self.session = SessionMachine(plan, World, {**self.facts, **facts})
        self.recorder = MemoryRecorder()
        self.inputs: list[Input] = []
        self.now_ns = 0
        self.give(Tick(0))

    @property
    def events(self):
        return self.recorder.events

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]

    def verdicts(self) -> list[str]:
        """What came of each press."""
        return [event.verdict for event in self.of(KeyPressed) if event.down]

    def give(self, happened: Input):
        self.inputs.append(happened)
        self.now_ns = max(self.now_ns, happened.t_ns)
        events = self.session.receive(happened)
        self.recorder.write(events)
        return events

    def pass_ms(self, ms: float):
        self.now_ns += round(ms * MS)
        return self.give(Tick(self.now_ns))

    def press(self, *keys: str):
        """Press and release keys one after the other."""
        for key in keys:
            self.down(key)
            self.up(key)

    def act(self, *actions: str):
        """Press the keys that these actions lie on in the running episode, or in the first before any."""
        for action in actions:
            started = self.of(EpisodeStarted)
            self.press(key_of(self.plan, action, started[-1].plan.episode if started else 0))

    def down(self, key: str, *, repeat: bool = False):
        self.now_ns += MS
        return self.give(KeyDown(self.now_ns, key, key, repeat))

    def up(self, key: str):
        self.now_ns += MS
        return self.give(KeyUp(self.now_ns, key, key))

    def hold(self, key: str, ms: float):
        """Press a key, and release it after a while."""
        self.down(key)
        self.pass_ms(ms)
        self.up(key)

    def quit(self):
        """End the session as a participant does: Escape asks, Escape held answers."""
        self.press("escape")
        self.hold("escape", 2000)

    def show(self):
        """The window has shown the present screen, at once."""
        return self.give(ScreenShown(self.now_ns, self.now_ns, self.now_ns))
