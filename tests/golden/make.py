"""How the frozen logs were made: ``python -m tests.golden.make FOLDER`` plays them all again into a new folder,
``python -m tests.golden.make FOLDER NAME`` those that one of `MAKERS` plays.

Each version of the log's format has a folder of its own (``v1``), made by the software of that time and never made
again: what is to be shown is that logs lying on a laboratory's disk for years are still read, proved and exported.

``tests.golden.every`` made those of every world and of every kind of part.
"""

import io
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType

import msgspec
import numpy as np
from PIL import Image

from minihuman.activities.agent_blocks.activity import AGENT_RULES
from minihuman.activities.questions.number.draft import NUMBER_RULES
from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.activity import RequestHandler
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, Stop
from minihuman.experiment.machine.session import CONSENT_RULES, SessionMachine
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import KeyPress, SimulatedTeacher, make_participant
from minihuman.worlds.adapters.world import World
from tests.golden.guests import again
from tests.golden.sounds import build_sounds
from tests.golden.talk import make_chat
from tests.golden.typed import make_fields, make_typed
from tests.seats.test_failing_agents import AGENTS, STUDY

STARTED_NS = 1_790_000_000_123_456_789  # the first session's wall clock; an hour later the next segment
HOUR_NS = 3_600_000_000_000
SECOND_NS = 1_000_000_000
AT_ONCE = -1  # before anything is played

_STUDY = """
[study]
name = "{name}"
version = "1"
seed = 11
participants = 4
consent = "I take part of my own free will."
closing = "Thank you."
[keys]
pool = ["1", "2", "3", "4", "q"]
[[groups]]
name = "all"
blocks = {blocks}
"""
_GRID = """
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-FourRooms-v0"
actions = ["left", "right", "forward"]
max_steps = 50
episodes = 2
feedback = "{outcome}"
"""
_SMALL = """
[[blocks]]
name = "small"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 30
episodes = 3
"""
_ROOM = """
[[blocks]]
name = "first-person"
world = "minihuman/MiniWorld-OneRoom-v0"
actions = ["turn_left", "turn_right", "move_forward"]
max_steps = 40
episodes = 2
"""
_TAUGHT = """
[[blocks]]
name = "takeover"
kind = "takeover"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 12
episodes = 3
agent = { policy = "optimal:0.5", step_ms = 400 }
[[blocks]]
name = "rating"
kind = "rating"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 8
episodes = 1
agent = { step_ms = 400 }
[[activities]]
name = "compare"
kind = "preferences"
plan = { source = "takeover", pairs = 2, steps = 3 }
"""
_SEEN = """
[[questions]]
name = "about"
[[questions.items]]
name = "age"
kind = "number"
ask = "How old are you?"
[[blocks]]
name = "seen"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 20
episodes = 2
pace = "real_time"
step_period_ms = 400.0
noop_action = "done"
stimulus_onset = "reset"
"""
BLOCKS = {
    "plain": _GRID,
    "resumed": _SMALL,
    "cut-off": _SMALL,
    "recovered": _SMALL,
    "real-time": _SMALL + 'pace = "real_time"\nstep_period_ms = 400.0\nnoop = "done"\n',
    "observations": _SMALL.replace("episodes = 3", "episodes = 2") + "record_observations = true\n",
    "first-person": _ROOM,
    "guest": _SMALL,
    "mixed": _SMALL.replace("episodes = 3", "episodes = 1") + _ROOM.replace("episodes = 2", "episodes = 1"),
    "foreign": _SMALL.replace("minihuman/", "minigrid:"),
    "no-step": _SMALL,
    "no-episode": _SMALL,
    "marked": _SMALL,
    "taught": _TAUGHT,
}


class Teaching(SimulatedTeacher):
    """Takes over at an episode's third step, hands back two steps later, rates every state, likes the left."""

    def __init__(self) -> None:
        self._player = make_participant("optimal", np.random.default_rng(5))

    def begin(self, plan, pool, world) -> None:
        self._player.begin(plan, pool, world)

    def press(self, world) -> KeyPress:
        return self._player.press(world)

    def watch(self, world, watched) -> KeyPress | None:
        if watched.good:
            return KeyPress(watched.good if watched.step % 3 else watched.bad, 150.0)
        if watched.who == "agent":
            return self._press(world) if watched.step == 2 else None
        return KeyPress(watched.hand_back, 300.0) if watched.step == 4 else self._press(world)

    def _press(self, world) -> KeyPress:
        self._player._way = []  # an agent has played meanwhile
        return self._player.press(world)

    def prefer(self, left, right) -> tuple[str, float]:
        return "left", 700.0


class Hand(SimulatedWindow):
    """A simulated participant who, after so many steps of the session, presses one more key, or is killed.

    After Escape the question is answered by holding it: the session is quit. After F8 Enter goes on.
    """

    def __init__(self, *args, after_steps: int | None = None, key: str = "", kill=lambda: None) -> None:
        super().__init__(*args)
        self._session_seen, self._clock_seen = args[1], args[2]
        self._after_steps, self._key, self._kill = after_steps, key, kill
        self._steps, self._last = 0, 0

    def wait(self, until_ns: int | None) -> list[Input]:
        play = self._session_seen.play or getattr(self._session_seen.part, "running_trial", None)
        if play is not None:
            self._steps += play.steps > self._last
            self._last = play.steps
        if self._after_steps is not None and (self._steps >= self._after_steps and play is not None):
            self._after_steps = None
            self._kill()
            if self._key:
                self._clock_seen.advance_to(self._clock_seen() + SECOND_NS)
                now_ns = self._clock_seen()
                tap = [KeyDown(now_ns, self._key, self._key), KeyUp(now_ns, self._key, self._key)]
                if self._key != "escape":
                    return tap
                self._clock_seen.advance_to(now_ns + 3 * SECOND_NS)
                return [*tap, KeyDown(now_ns, "escape", "escape"), KeyUp(self._clock_seen(), "escape", "escape")]
        elif self._after_steps == AT_ONCE:
            return [Stop(self._clock_seen(), "window_closed")]
        return super().wait(until_ns)


def study(name: str) -> Protocol:
    """The protocol of one frozen study."""
    blocks = BLOCKS[name]
    names = [line.split('"')[1] for line in blocks.splitlines() if line.startswith("name = ")]
    toml = _STUDY.replace("{name}", name).replace("{blocks}", str(names).replace("'", '"')) + blocks
    if "[[activities]]" in toml:
        toml = toml.replace("blocks = [", "parts = [")
    return decode_protocol(toml.encode())


def everything_new(name: str) -> Protocol:
    """A study whose log holds what the first version's earlier logs lack, under the name of its version."""
    toml = _STUDY.replace("{name}", name).replace("blocks = {blocks}", 'parts = ["about", "seen"]') + _SEEN
    return decode_protocol(toml.encode())


def make_everything_new(data: Path, name: str) -> None:
    """Play it, with an enrolment log and annotations as they are written now."""
    facts = {"number_rules": NUMBER_RULES, "consent_rules": CONSENT_RULES, "utc_offset_min": "60"}
    log = segment(data, everything_new(name), facts=facts)
    record_log_end(log)
    add_annotation(read_log(log), Annotation("doubt", "2026-11-23T09:00:00Z", episode=2, note="looked away"))


def segment(
    data: Path,
    protocol: Protocol,
    player: str = "optimal",
    participant: str = "sub-01",
    session: int = 1,
    facts: Mapping[str, str] = MappingProxyType({}),
    seat: Callable[[SessionPlan, Path], RequestHandler] | None = None,
    **hand,
) -> Path:
    """Play the participant's session, or the rest of it, and give its log; an agent may have another seat."""
    plan = plan_next_session(protocol, data, participant=participant, session=session)
    clock = VirtualClock()
    station = {"player": player, "platform": "golden", "refresh_hz": "60.0", **facts}
    session = SessionMachine(plan, World, station, picture_px=None)
    recorder = McapRecorder(data, plan, started_ns=STARTED_NS + HOUR_NS * (plan.segment - 1))
    if "part" in hand:
        hand["kill"] = partial(_keep, recorder, hand.pop("part"))
    somebody = Teaching() if player == "teaching" else make_participant(player, np.random.default_rng(5))
    window = Hand(somebody, session, clock, **hand)
    agent = seat(plan, data) if seat else make_agent_host(protocol, plan, data, patient=True)
    log = run_session(session, window, recorder, clock, agent=agent)
    assert log is not None
    return log


def _keep(recorder: McapRecorder, part: Path) -> None:
    """What lies on the disk at this moment, as it would after a power cut."""
    recorder.drain()
    part.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(recorder.segment_path.part, part)


def make(data: Path) -> None:
    """Play every frozen study."""
    segment(data, study("plain"), after_steps=7, key="f8")
    segment(data, study("plain"), "random", participant="sub-02")
    segment(data, study("resumed"), after_steps=6, key="escape")
    segment(data, study("resumed"))
    for name in ("cut-off", "recovered"):
        log = segment(data, study(name), after_steps=8, part=data / "as-killed")
        log.unlink()
        part = log.with_name(log.name + ".part")
        shutil.move(data / "as-killed", part)
    part.write_bytes(part.read_bytes()[:-300])  # the last bytes never reached the disk
    recover_log(part)
    for found in part.parent.glob("*.as-found-*"):  # as large again, and never read
        found.unlink()
    segment(data, study("real-time"))
    segment(data, study("observations"))
    segment(data, study("first-person"))
    alone = segment(data, study("guest"))  # the frozen one is of the study "resumed"
    again(alone, alone.with_suffix(".with"), lambda ours: ours % 7).replace(alone)
    segment(data, study("mixed"))
    segment(data, study("foreign"), "random")
    segment(data, study("no-step"), after_steps=0, key="escape")
    segment(data, study("no-episode"), after_steps=AT_ONCE)
    segment(data, study("taught"), "teaching")
    marked = read_log(segment(data, study("marked")))
    add_annotation(marked, Annotation("exclude", "2026-11-22T09:00:00Z", episode=2, note="the phone rang"))
    add_annotation(marked, Annotation("slow", "2026-11-22T09:01:00Z", note="all of it"))
    add_annotation(marked, Annotation("doubt", "2026-11-22T09:02:00Z", episode=1))
    add_annotation(marked, Annotation("doubt", "2026-11-22T09:03:00Z", episode=1, taken_back=True))


def make_failed_agent(data: Path) -> None:
    """Play beside an agent of a lab's package that crashes: in a takeover block, and in a rating block."""
    with TemporaryDirectory() as place:
        info = Path(place, "lab-1.0.dist-info")
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[minihuman.agents]\nlab = a_lab:Agent\n")
        Path(place, "a_lab.py").write_text(AGENTS)
        sys.path.insert(0, place)
        toml = STUDY.replace("POLICY", "lab:crash").replace('"fails"', '"failed-agent"')
        segment(data, decode_protocol(toml.encode()), "random", facts={"agent_rules": AGENT_RULES})
        sys.path.remove(place)


TEAM = """
[study]
name = "team"
version = "1"
seed = 11
participants = 4
[keys]
pool = ["1", "2", "3"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["together"]
[[blocks]]
name = "together"
kind = "team"
world = "minihuman/Team-FourRooms-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
[blocks.team]
seats = ["person", "scripted:random"]
roles = ["first", "second"]
partner_disclosure = "debrief"
"""


def make_team(data: Path) -> None:
    """Play two episodes together with an agent, and be told so at the end."""
    segment(data, decode_protocol(TEAM.encode()), "random")


ADAPTIVE = """
[study]
name = "adaptive"
version = "1"
seed = 11
participants = 4
[keys]
pool = ["f", "j"]
keyboard_check = false
[allocation.design]
name = "thompson"
[[groups]]
name = "bright"
blocks = ["discs"]
[[groups]]
name = "dim"
blocks = ["discs"]
[[blocks]]
name = "discs"
kind = "trials"
world = "minihuman/Stimulus-v0"
options = { shape = "circle", correct = "left" }
episodes = 8
actions = ["left", "right"]
max_steps = 1
[blocks.design]
name = "questplus"
settings = { option = "size", values = [0.01, 0.02, 0.04, 0.08] }
"""


def make_adaptive(data: Path) -> None:
    """Respond to trials that QUEST+ chooses, in a group that Thompson sampling assigned."""
    segment(data, decode_protocol(ADAPTIVE.encode()), "observer:threshold=0.02")


IMAGES = (
    ADAPTIVE.partition("[allocation.design]")[0].replace("adaptive", "images")
    + """
[[groups]]
name = "all"
blocks = ["faces"]
[[blocks]]
name = "faces"
kind = "trials"
world = "minihuman/Stimulus-v0"
stimuli.file = "faces.csv"
episodes = 6
actions = ["left", "right"]
max_steps = 1
ready = "first"
"""
)


def make_images(data: Path) -> None:
    """Respond to trials whose table names two images: before 27 November 2026 each trial's options had its image."""
    files = {"faces.csv": b"image,correct\nred.png,left\nblue.png,right\n"}
    for colour in ("red", "blue"):
        Image.new("RGB", (8, 8), colour).save(picture := io.BytesIO(), "PNG")
        files[f"{colour}.png"] = picture.getvalue()
    protocol = decode_protocol(IMAGES.encode())
    segment(data, msgspec.structs.replace(protocol, files=files), "random")


OUTCOMES = """
[study]
name = "{name}"
version = "1"
seed = 11
participants = 4
[keys]
pool = ["1", "2", "3", "4"]
keyboard_check = false
[[groups]]
name = "all"
blocks = {blocks}
"""
_LAKE = """
[[blocks]]
name = "{name}"
world = "FrozenLake-v1"
options = {{ desc = ["SFG", "HFF"], is_slippery = false, reward_schedule = {rewards} }}
episodes = 2
actions = ["left", "down", "right", "up"]
max_steps = {max_steps}
{more}
"""
_COST, _USUAL = "[-1, -1, -1]", "[1, 0, 0]"  # a step's reward at the goal, in a hole, on the ice


def _lakes(name: str, lakes: Mapping[str, tuple[str, int, str]]) -> Protocol:
    blocks = [
        _LAKE.format(name=lake, rewards=rewards, max_steps=n, more=more) for lake, (rewards, n, more) in lakes.items()
    ]
    head = OUTCOMES.replace("{name}", name).replace("{blocks}", str([*lakes]).replace("'", '"'))
    return decode_protocol((head + "".join(blocks)).encode())


def make_unruled(data: Path) -> None:
    """Arrive at the goal of a world that costs, before 28 November 2026: a failure, as its last reward says."""
    segment(data, _lakes("unruled", {"paid": (_USUAL, 100, ""), "costs": (_COST, 100, "")}), "random")


def make_outcomes(data: Path) -> None:
    """End in every way that a rule of one's own can say, with what the world says of it."""
    lakes = {
        "paid": (_USUAL, 100, ""),
        "costs": (_COST, 100, 'success = "return > -12"'),
        "unknown": (_USUAL, 100, 'success = "none"'),
        "says": (_USUAL, 2, 'success = "info:prob"\nrecord_info = ["prob"]'),
        "silent": (_USUAL, 2, 'success = "info:arrived"'),
        "short": (_COST, 1, 'success = "terminated"\nsuccess_at = "any"'),
    }
    segment(data, _lakes("outcomes", lakes), "random")


TIMELINES = (
    ADAPTIVE.partition("[allocation.design]")[0].replace("adaptive", "timelines")
    + """
[[groups]]
name = "all"
blocks = ["primes", "letters"]
[[blocks]]
name = "primes"
kind = "trials"
world = "minihuman/Stimulus-v0"
stimuli = { file = "primes.csv", balanced_by = ["congruent"] }
timeline.stimuli = [
  { name = "fixation", text = "+", size = 0.08, duration_ms = [400, 700] },
  { name = "prime", text = "{prime}", colour = "#e8503c", x = "{prime_side}", duration_ms = 33 },
  { name = "mask", image = "mask.png", layer = 1, since = "prime", onset_ms = "{soa}", duration_ms = 67 },
  { name = "target", shape = "{target}", until = "response" },
]
episodes = 8
actions = ["left", "right"]
noop_action = "none"
response_deadline_ms = 1500
max_steps = 1
ready = "first"
inter_trial_interval_ms = [300, 500]
[[blocks]]
name = "letters"
kind = "trials"
world = "minihuman/Stimulus-v0"
stimuli = { rows = [{ letters = "K T X", correct = "left" }, { letters = "M P", correct = "none" }], order = "fixed" }
timeline.ends = "time"
timeline.soa_ms = 2000
timeline.target = "letters"
timeline.opens_ms = 100
timeline.responses = 2
timeline.stimuli = [
  { name = "ring", text = "+ + + +", layout = "ring", size = 0.06, onset_ms = 0, until = "end" },
  { name = "letters", text = "{letters}", each_ms = 100, onset_ms = 200 },
]
episodes = 4
actions = ["left", "right"]
noop_action = "none"
response_deadline_ms = 1200
max_steps = 1
ready = "none"
"""
)


def make_timelines(data: Path) -> None:
    """Respond to trials with a time course, the first of which a pause voids; then to streams at a rhythm."""
    Image.new("RGB", (8, 8), "white").save(picture := io.BytesIO(), "PNG")
    table = (
        b"prime,prime_side,soa,target,correct,congruent\n"
        b"<<,left,50,circle,left,yes\n>>,right,50,circle,left,no\n"
        b">>,right,100,square,right,yes\n,left,100,square,right,no\n"
    )
    protocol = decode_protocol(TIMELINES.encode())
    protocol = msgspec.structs.replace(protocol, files={"primes.csv": table, "mask.png": picture.getvalue()})
    record_log_end(segment(data, protocol, "human-like", after_steps=0, key="f8"))


def make_sounds(data: Path) -> None:
    """Respond to words that are heard, the first of which a pause voids; then to tones at a rhythm."""
    record_log_end(segment(data, build_sounds(), "human-like", after_steps=0, key="f8"))


MAKERS: Mapping[str, Callable[[Path], None]] = MappingProxyType(
    {
        "every": make,
        "last-of-v1": partial(make_everything_new, name="last-of-v1"),
        "failed-agent": make_failed_agent,
        "team": make_team,
        "adaptive": make_adaptive,
        "images": make_images,
        "outcomes": make_outcomes,
        "typed": make_typed,
        "fields": make_fields,
        "timelines": make_timelines,
        "chat": make_chat,
        "sounds": make_sounds,
    }
)


def make_named(data: Path, names: Sequence[str]) -> None:
    """Play the studies of some names, or of all if none is given."""
    unknown = [name for name in names if name not in MAKERS]
    if unknown:
        sys.exit(f"{unknown[0]!r} makes no study; use one of {', '.join(MAKERS)}")
    for name in names or MAKERS:
        MAKERS[name](data)


if __name__ == "__main__":
    make_named(Path(sys.argv[1]), sys.argv[2:])
