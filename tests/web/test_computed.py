"""Episodes that the page computes: keys show what the world is, and the session's steps decide, whatever it says."""

import asyncio
import base64
import json
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import FrameShown, KeyPressed, Noted, SessionEnded, Stepped
from minihuman.experiment.machine.inputs import Stop
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import BROWSER_NOTE, compare_replay
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.web import messages
from minihuman.web.computed import MOST_UNKNOWN, ComputedEpisode, PageWorld
from minihuman.web.outbox import PageSettings
from minihuman.web.session_host import SessionHost
from minihuman.worlds.adapters.world import World
from minihuman.worlds.source_digest import kernels_digest
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.page_model import PageModel
from tests.web.page_steps import PageSteps
from tests.web.protocols import FIRST_PERSON as FIRST_PERSON_WORLD, GRID, study
from tests.web.served import served
from tests.web.serving import line, serving
from tests.web.typed_page import TypedPage

MS = 1_000_000
WRONG = "0123456789abcdef"


def playing(
    folder: Path,
    *,
    world: tuple[str, tuple[str, ...]] = GRID,
    block: str = "",
    computes: bool = True,
    max_steps: int = 9,
) -> tuple[SessionHost, MemoryRecorder, PageModel]:
    """A host in its first episode, and a page before it that computes."""
    protocol = decode_protocol(study(folder, world, max_steps=max_steps, block=block).read_bytes())
    plan, recorder = expand_protocol(protocol, enrol_participant(protocol, 0)), MemoryRecorder()
    session = SessionMachine(plan, PageWorld, {"window": "web"}, picture_px=(84, 84), renders_steps=False)
    host = SessionHost(session, recorder, PageWorld, PageSettings(picture_px=(84, 84)))
    host.restart(computes=computes)
    page = PageModel(host, [(300 * MS, "enter", True)], frame_ns=16 * MS)
    page.run()
    assert host.session.play is not None
    return host, recorder, page


def notes(recorder: MemoryRecorder) -> list[str]:
    return [event.text for event in recorder.events if isinstance(event, Noted) and event.kind == BROWSER_NOTE]


def press(page: PageModel, key: str, digest: str | None = None) -> str:
    """Press a key, with the digest of its step or another; what the digest should be."""
    assert page.steps is not None
    right = page.steps.press(key)
    t_ns = page.sent[-1].at + 100 * MS
    page.say(messages.KeyMessage(key, True, t_ns, digest=right if digest is None else digest))
    return right


def corrections(page: PageModel) -> list[messages.StateCorrection]:
    return [told for told in page.told if isinstance(told, messages.StateCorrection)]


def test_a_step_that_the_page_computed_right_is_answered_with_nothing(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path)
    told = len(page.told)
    for key in ("1", "2", "3", "1"):
        press(page, key)
    assert page.told[told:] == []
    assert host.session.play is not None
    assert host.session.play.steps == 4
    assert notes(recorder) == []
    host.close()


def test_a_key_and_its_picture_that_came_together_are_one_write_and_acknowledged_with_it(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path)
    assert page.steps is not None
    last, writes, safe = page.sent[-1], recorder.durable_writes, host.safe()
    t_ns = last.at + 100 * MS
    key = messages.KeyMessage("1", True, t_ns, digest=page.steps.press("1"))
    together = [key, messages.DisplayedMessage(t_ns, t_ns, step=1, episode=0), messages.KeyMessage("1", False, t_ns)]
    for more, what in enumerate(together, 1):
        assert (recorder.durable_writes, host.safe()) == (writes, safe), "the last of them is yet to come"
        host.receive(last.n + more, t_ns + more, what, more=more < len(together))
    assert (recorder.durable_writes, host.safe()) == (writes + 1, last.n + 3)
    assert [type(event) for event in recorder.events[-4:]] == [KeyPressed, Stepped, FrameShown, KeyPressed]
    assert notes(recorder) == []
    host.close()


def test_where_the_server_computes_a_key_is_written_at_once_and_its_picture_with_its_release(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path, computes=False)
    last, writes = page.sent[-1], recorder.durable_writes
    t_ns = last.at + 100 * MS
    together = [
        messages.KeyMessage("1", True, t_ns),
        messages.DisplayedMessage(t_ns, t_ns, step=1, episode=0),
        messages.KeyMessage("1", False, t_ns),
    ]
    durable = []
    for more, what in enumerate(together, 1):
        host.receive(last.n + more, t_ns + more, what, more=more < len(together))
        durable.append((recorder.durable_writes - writes, host.safe() - last.n))
    assert durable == [(1, 1), (1, 1), (2, 3)], "the picture waits for its release, and neither is acknowledged before"
    assert [type(event) for event in recorder.events[-4:]] == [KeyPressed, Stepped, FrameShown, KeyPressed]
    assert notes(recorder) == []
    host.close()


def test_what_came_with_a_message_that_never_came_is_written_before_the_sessions_end(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path)
    assert page.steps is not None
    t_ns = page.sent[-1].at + 100 * MS
    key = messages.KeyMessage("1", True, t_ns, digest=page.steps.press("1"))
    host.receive(page.sent[-1].n + 1, t_ns, key, more=True)
    host.stop(Stop(t_ns + MS, "connection_lost", ""))
    assert [event.step for event in recorder.events if isinstance(event, Stepped)] == [1]
    assert isinstance(recorder.events[-1], SessionEnded)
    assert list(compare_replay(recorder.events, World)) == []
    host.close()


def test_a_page_that_computes_otherwise_is_named_once_and_told_where_it_is_each_time(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path)
    right = press(page, "1", WRONG)
    press(page, "2", WRONG)
    press(page, "3")
    assert notes(recorder) == [
        f"step 1 of episode 1 was computed otherwise in the page: its digest is {WRONG}, here it is {right}"
    ]
    assert [told.state.step for told in corrections(page)] == [1, 2]
    press(page, "1", WRONG)
    assert len(notes(recorder)) == 2, "it was right in between"
    play = host.session.play
    assert play is not None
    world = World(play.plan.world, play.plan.options)
    world.reset(play.plan.seed)
    for action in play.actions:
        world.step(action)
    assert world.state_hash() == play.world.state_hash(), "what the page says changes nothing"
    assert list(compare_replay(recorder.events, World)) == []
    host.close()


def test_a_step_through_a_wall_that_the_page_claims_and_the_session_does_not_make_is_named(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path)
    page.say(messages.KeyMessage("x", True, 900 * MS, digest=WRONG))
    assert notes(recorder) == ["key x made a step of episode 1 in the page, and none here"]
    assert [told.state.step for told in corrections(page)] == [0]
    host.close()


WORLDS = pytest.mark.parametrize("world", [GRID, FIRST_PERSON_WORLD], ids=["grid", "first person"])


def of_another_seed(steps: PageSteps, world_id: str) -> str:
    """The digest of the first step of an episode that nobody gave the page."""
    other = PageWorld(world_id, {"trig": 1} if "MiniWorld" in world_id else {})
    other.keep_steps()
    other.reset(123_456)
    made = other.step(steps.rules.actions["1"])
    return other.digest(made.reward, terminated=made.terminated, truncated=made.truncated)


def with_a_reward(steps: PageSteps, world_id: str) -> str:
    """The digest of the right step and a reward that nobody earned."""
    inside = steps._inside
    reward, terminated, truncated = inside.step(steps.rules.actions["1"])
    return inside.digest(reward + 1.0, terminated, truncated)


@WORLDS
@pytest.mark.parametrize("lie", [of_another_seed, with_a_reward])
def test_a_page_that_claims_rewards_or_another_seed_is_named_and_told_the_truth(
    tmp_path: Path, world: tuple[str, tuple[str, ...]], lie: Callable[[PageSteps, str], str]
) -> None:
    host, recorder, page = playing(tmp_path, world=world)
    assert page.steps is not None
    t_ns, claimed = page.sent[-1].at + 100 * MS, lie(page.steps, world[0])
    page.say(messages.KeyMessage("1", True, t_ns, digest=claimed))
    [note] = notes(recorder)
    assert note.startswith(f"step 1 of episode 1 was computed otherwise in the page: its digest is {claimed}, here ")
    [told] = corrections(page)
    assert [event.reward for event in recorder.events if isinstance(event, Stepped)] == [0.0]
    press(page, "2")
    assert (len(notes(recorder)), told.state.step) == (1, 1), "the page is right again from where it was told"
    assert list(compare_replay(recorder.events, World)) == []
    host.close()


@WORLDS
def test_a_page_that_lies_of_real_time_is_named_once_and_told_where_it_is_at_each_tick(
    tmp_path: Path, world: tuple[str, tuple[str, ...]]
) -> None:
    noop = 'noop_action = "done"' if world is GRID else ""
    block = f'pace = "real_time"\nstep_period_ms = 33.3\n{noop}\n'
    host, recorder, page = playing(tmp_path, world=world, block=block, max_steps=30)
    for number in range(12):
        page.say(messages.KeyMessage("1", True, page.sent[-1].at + 5 * MS))
        page._now_ns += 40 * MS
        page.say(messages.TickMessage(WRONG))
        assert host.session.play is not None
        assert host.session.play.steps == len(corrections(page)) > number / 2
    assert len(notes(recorder)) == 1
    assert WRONG in notes(recorder)[0]
    assert list(compare_replay(recorder.events, World)) == []
    host.close()


def test_to_correct_a_page_costs_little_beside_what_describing_its_scene_costs(tmp_path: Path) -> None:
    host, _, page = playing(tmp_path, world=FIRST_PERSON_WORLD, max_steps=400)
    play, told = host.session.play, len(page.told)
    assert play is not None
    ComputedEpisode(play, (84, 84))
    began_s = time.process_time()
    for _ in range(5):
        ComputedEpisode(play, (84, 84))
    described_s = (time.process_time() - began_s) / 5
    began_s = time.process_time()
    for _ in range(60):
        press(page, "1", WRONG)
    assert (time.process_time() - began_s) / 60 < described_s / 3
    assert len(corrections(page)) == 60
    assert not any(isinstance(message, messages.ArraysMessage) for message in page.told[told:])
    assert all(type(told.state) is messages.FirstPersonPosition for told in corrections(page))
    host.close()


def test_a_page_that_never_says_what_it_computed_is_named_when_it_should_know(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path, max_steps=400)
    for _ in range(MOST_UNKNOWN - 1):
        press(page, "1", "")
    assert notes(recorder) == []
    press(page, "1")  # it knows again
    for _ in range(MOST_UNKNOWN - 1):
        press(page, "1", "")
    assert notes(recorder) == []
    for _ in range(MOST_UNKNOWN):
        press(page, "1", "")
    assert notes(recorder) == [f"the page said nothing of {MOST_UNKNOWN} steps in a row that it was to compute"]
    host.close()


def test_a_page_that_could_not_know_is_told_where_it_is_and_not_blamed(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path)
    press(page, "1", "")
    assert (notes(recorder), [told.state.step for told in corrections(page)]) == ([], [1])
    press(page, "2")
    assert len(corrections(page)) == 1
    host.close()


def test_after_a_pause_the_page_is_told_where_the_episode_stands(tmp_path: Path) -> None:
    host, _, page = playing(tmp_path)
    press(page, "1")
    press(page, "2")
    for key in ("f8", "enter"):
        page.say(messages.KeyMessage(key, True, page.sent[-1].at + 100 * MS))
    assert host.session.play is not None
    assert [told.state.step for told in corrections(page)] == [2]
    host.close()


def test_a_page_that_is_loaded_again_gets_the_state_and_the_tiles_again(tmp_path: Path) -> None:
    host, recorder, page = playing(tmp_path)
    for key in ("1", "2", "3"):
        press(page, key)
    host.restart(computes=True)
    told = [message for _, message in host.outgoing.after(0)]
    [rules] = [message for message in told if isinstance(message, messages.EpisodeRules)]
    assert [type(message) for message in told[:2]] == [messages.ArraysMessage, messages.EpisodeRules]
    assert rules.computed is not None
    assert rules.computed.step == 3
    assert host.session.play is not None
    steps = PageSteps(host.session.play.plan.world, rules)
    number, at_ns = page.sent[-1].n + 1, page.sent[-1].at + 100 * MS
    host.receive(number, at_ns, messages.KeyMessage("1", True, at_ns, digest=steps.press("1")))
    assert notes(recorder) == []
    host.close()


@pytest.mark.parametrize("why", ["protocol", "page"])
def test_a_block_that_the_page_does_not_compute_is_looked_ahead_in(tmp_path: Path, why: str) -> None:
    block = 'computed = "server"' if why == "protocol" else ""
    host, _, page = playing(tmp_path, block=block, computes=why == "protocol")
    assert page.steps is None
    assert any(isinstance(told, messages.LookAheadUpdate) for told in page.told)
    host.close()


PALETTES = """
[study]
name = "tried"
version = "1.0"
seed = 7
[keys]
pool = ["1", "2", "3", "4", "5"]
keyboard_check = false
[web]
image_size_px = [400, 300]
[[groups]]
name = "everyone"
blocks = {blocks}
"""
BLOCK = """
[[blocks]]
name = "{name}"
world = "minihuman/{world}"
episodes = 1
max_steps = 12
final_frame_ms = 300
actions = {actions}
{more}
"""
TURNS = ["left", "right", "forward"]
WALKS = ["turn_left", "turn_right", "move_forward"]
FIRST_PERSON = [
    ("four", "MiniWorld-FourRooms-v0", WALKS, ""),
    ("objects", "MiniWorld-PickupObjects-v0", [*WALKS, "pickup"], 'palette = "colour-safe"'),
    ("sign", "MiniWorld-Sign-v0", [*WALKS, "done"], ""),
    ("health", "MiniWorld-CollectHealth-v0", [*WALKS, "pickup"], "options = { domain_rand = true, size = 5 }"),
    ("maze", "MiniWorld-MazeS3-v0", WALKS, "options = { contact_shadows = true }"),
]
BLOCKS = [
    ("rooms", "MiniGrid-FourRooms-v0", TURNS, 'palette = "colour-safe"'),
    ("key", "MiniGrid-DoorKey-8x8-v0", [*TURNS, "pickup", "toggle"], 'view = "full"'),
    ("obstacles", "MiniGrid-Dynamic-Obstacles-6x6-v0", TURNS, 'options = { palette = "minigrid" }'),
    ("level", "BabyAI-GoToLocal-v0", [*TURNS, "pickup"], ""),
    ("words", "BabyAI-GoToLocal-v0", [*TURNS, "pickup"], 'view = "text"'),  # which the server draws
]
PIXELS = """(selector) => {
  const canvas = document.querySelector(selector);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return [canvas.width, canvas.height, btoa(Array.from(data, (byte) => String.fromCharCode(byte)).join(""))];
}"""


def picture_of(somebody: Somebody, selector: str = "#screen canvas") -> np.ndarray:
    """What a canvas shows, uint8[H, W, 3]."""
    width, height, pixels = somebody.page.evaluate(PIXELS, selector)
    return np.frombuffer(base64.b64decode(pixels), np.uint8).reshape(height, width, 4)[..., :3]


@pytest.mark.nightly(by_day=["first person"])
@pytest.mark.program
@pytest.mark.parametrize("blocks", [BLOCKS, FIRST_PERSON], ids=["grid", "first person"])
@needs("chromium")
def test_what_the_page_draws_is_the_worlds_picture_to_the_pixel(
    tmp_path: Path, blocks: list[tuple[str, str, list[str], str]]
) -> None:
    path = tmp_path / "tried.toml"
    study_of = PALETTES.replace("{blocks}", str([name for name, *_ in blocks]))
    path.write_text(study_of + "".join(BLOCK.format(name=n, world=w, actions=a, more=m) for n, w, a, m in blocks))
    protocol = decode_protocol(path.read_bytes())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    rng, drawn = random.Random(5), 0
    with serving(path, tmp_path) as server, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{server.port}/#t={server.tokens[0]}")
        for episode in plan.episodes:
            somebody.to_play()
            world = World(episode.world, episode.options)
            world.reset(episode.seed)
            for step in range(7):
                if episode.view == "text":  # of which the server draws every picture
                    somebody.until(f"s.step >= {step}", patience_s=20)
                right = world.frame(episode.view, (400, 300), episode.palette)
                shown = picture_of(somebody)
                by = time.monotonic() + PATIENCE_S
                while not np.array_equal(shown, right) and time.monotonic() < by:
                    time.sleep(0.05)  # the first picture waits for textures, a key for the picture that it answers
                    shown = picture_of(somebody)
                assert np.array_equal(shown, right), episode.block_name
                drawn += 1
                key = rng.choice(sorted(episode.key_map.keys))
                made = world.step(world.action_names.index(episode.key_map.keys[key]))
                ended = made.terminated or made.truncated
                somebody.press(key)
                if ended:  # the server's picture, packed with loss in first person, takes the place of the last
                    break
            while somebody.state["playing"] and not somebody.state["ended"]:
                somebody.press(rng.choice(sorted(episode.key_map.keys)))
            somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
    [log] = tmp_path.rglob("*.mcap")
    assert drawn > 20
    assert read_log(log).facts["page_kernels"] == kernels_digest()
    assert [event.text for event in read_events(log) if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    assert list(find_log_differences(log, World)) == []


SENDS = """() => {
  const send = WebSocket.prototype.send;
  globalThis.writes = [];
  WebSocket.prototype.send = function (text) { writes.push(text); send.call(this, text); };
}"""  # collects what goes up


@pytest.mark.program
@needs("chromium")
def test_keys_of_a_second_go_up_in_one_write_and_the_last_of_an_episode_at_once(tmp_path: Path) -> None:
    with serving(study(tmp_path, max_steps=5), tmp_path) as server, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{server.port}/#t={server.tokens[0]}")
        somebody.to_play()
        somebody.page.evaluate(SENDS)
        somebody.press(*"1231")
        somebody.until("s.step === 4 && s.unsafe === 0")
        writes = [text for text in somebody.page.evaluate("writes") if '["k"' in text]  # a ping may lead
        lines = [json.loads(line) for text in writes for line in text.split("\n") if line.startswith("[")]
        keys = [values for values in lines if values[0] == "k"]
        assert [key for _, _, _, _, key, down, *_ in keys if down] == list("1231")
        assert len(writes) < 4, "each went by itself"
        before = len(somebody.page.evaluate("writes"))
        somebody.page.keyboard.down("1")  # the page waits for what follows the episode
        assert '["k"' in "".join(somebody.page.evaluate("writes")[before:])
        somebody.until("!s.playing")
        assert somebody.errors == []
        server.stop()


@pytest.mark.program
@needs("chromium")
def test_a_page_plays_on_without_a_network_and_is_right_about_it(tmp_path: Path) -> None:
    with (
        serving(study(tmp_path, max_steps=60), tmp_path) as server,
        line(server.port, rtt_ms=300) as wire,
        browsing() as sit_down,
    ):
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={server.tokens[0]}")
        somebody.to_play()
        wire.cut()
        for number in range(30):
            somebody.press("123"[number % 3])
        somebody.until("s.step === 30")
        somebody.page.wait_for_timeout(100)
        assert somebody.state["confirmed"] == 0
        wire.mend()
        somebody.until("s.unsafe === 0 && s.confirmed === 30 && s.step === 30")
        assert somebody.errors == []
        server.stop()
    [log] = tmp_path.rglob("*.mcap.part")
    events = list(read_events(log))
    assert sum(isinstance(event, Stepped) for event in events) == 30
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    assert list(find_log_differences(log, World)) == []


def list_received(somebody: Somebody) -> list[bytes]:
    """What the page's sockets receive from now on."""
    told = list[bytes]()

    def listen(socket: Any) -> None:
        socket.on("framereceived", lambda data: told.append(data if isinstance(data, bytes) else data.encode()))

    somebody.page.on("websocket", listen)
    return told


@pytest.mark.nightly
@pytest.mark.program
@pytest.mark.parametrize(
    ("world", "noop"), [(GRID, 'noop_action = "done"'), (FIRST_PERSON_WORLD, "")], ids=["grid", "3d"]
)
@needs("chromium")
def test_real_time_at_thirty_steps_a_second_is_stepped_in_the_page_over_a_long_line(
    tmp_path: Path, world: tuple[str, tuple[str, ...]], noop: str
) -> None:
    block = f'pace = "real_time"\nstep_period_ms = 33.3\n{noop}\n'
    rng, rtt_ms = random.Random(9), 1_200.0  # half of it is more than a step takes, on a busy machine too
    with (
        serving(study(tmp_path, world, max_steps=90, episodes=1, block=block), tmp_path) as server,
        line(server.port, rtt_ms=rtt_ms) as wire,
        browsing() as sit_down,
    ):
        somebody = sit_down("about:blank")
        told = list_received(somebody)
        somebody.page.goto(f"http://127.0.0.1:{wire.port}/#t={server.tokens[0]}")
        somebody.to_play()
        began_s, held = time.monotonic(), ""
        while somebody.state["playing"] and not somebody.state["ended"]:
            key = rng.choice("123")
            if held:  # one key goes down while another is held
                somebody.page.keyboard.up(held)
            somebody.page.keyboard.down(key)
            held = key if rng.random() < 0.3 else ""
            if not held:
                somebody.page.keyboard.up(key)
            somebody.page.wait_for_timeout(rng.choice((5, 20, 60)))
            assert time.monotonic() - began_s < PATIENCE_S
        somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
    assert b'"t":"arrays"' in b"".join(told)
    assert b'"t":"state"' not in b"".join(told), "the page had to be told where it was"
    [log] = tmp_path.rglob("*.mcap")
    events = list(read_events(log))
    steps = [event for event in events if isinstance(event, Stepped)]
    assert len(steps) == 90 or steps[-1].terminated
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    flips = {event.step: event.flip_ns for event in reversed(events) if isinstance(event, FrameShown)}
    late_ms = [(flips[step.step] - step.t_ns) / MS for step in steps if step.step in flips]
    assert len(late_ms) > len(steps) / 4
    assert np.median(late_ms) < rtt_ms / 2, "as late as the server's word: nothing was stepped here"
    assert list(find_log_differences(log, World)) == []


@pytest.mark.nightly
@pytest.mark.program
@pytest.mark.parametrize(
    ("world", "noop"), [(GRID, 'noop_action = "done"'), (FIRST_PERSON_WORLD, "")], ids=["grid", "3d"]
)
@needs("chromium")
def test_keys_with_holds_and_chords_in_real_time_make_the_steps_that_they_make_at_the_desk(
    tmp_path: Path, world: tuple[str, tuple[str, ...]], noop: str
) -> None:
    """At 30 steps a second over 300 ms: 5,000 keys at night. The desk's session gets the log's inputs."""
    keys, pressed, chords = count(60, 5_000), 0, 0
    block = f'pace = "real_time"\nstep_period_ms = 33.3\noptions = {{ max_steps = 1000 }}\n{noop}\n'
    rng = random.Random(27)
    with (
        serving(study(tmp_path, world, max_steps=1000, episodes=max(4, keys // 10), block=block), tmp_path) as server,
        line(server.port, rtt_ms=300) as wire,
        browsing() as sit_down,
    ):
        somebody, held = sit_down(f"http://127.0.0.1:{wire.port}/#t={server.tokens[0]}"), set()
        while pressed < keys:
            somebody.to_play()
            while pressed < keys and somebody.state["playing"] and not somebody.state["ended"]:
                key = rng.choice("123")
                (somebody.page.keyboard.up if key in held else somebody.page.keyboard.down)(key)
                pressed += key not in held
                held ^= {key}
                chords += len(held) > 1
                somebody.page.wait_for_timeout(rng.choice((5, 20, 60, 150)))
            for key in held:
                somebody.page.keyboard.up(key)
            held.clear()
            somebody.until(f"!s.playing || s.ended || {int(pressed >= keys)}")
        # a world that goes on is never at rest
        somebody.until(f"s.unsafe === 0 || s.confirmed > {somebody.state['step'] + 1}")
        assert somebody.errors == []
        server.stop()
    [log] = tmp_path.rglob("*.mcap.part")
    events = list(read_events(log))
    steps = [event for event in events if isinstance(event, Stepped)]
    presses = [event for event in events if isinstance(event, KeyPressed) and event.down and event.key in "123"]
    assert len(presses) >= keys
    assert chords > keys / 10
    assert len(steps) > keys / 2
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    assert list(compare_replay(events, World)) == [], "the session at the desk made other steps of the same inputs"
    flips = {(event.episode, event.step): event.flip_ns for event in reversed(events) if isinstance(event, FrameShown)}
    shown = [(flips[at] - step.t_ns) / MS for step in steps if (at := (step.episode, step.step)) in flips]
    in_time = np.mean(np.array(shown) < 33.3) * len(shown) / len(steps)
    print(f"{len(presses)} keys, {chords} chords, {len(steps)} steps, {100 * in_time:.1f} % of frames in their period")


class LyingPage(TypedPage):
    """A page that presses as fast as it may, and says of all of its steps that they led elsewhere."""

    def lies(self, digest: str) -> str:
        return WRONG


@pytest.mark.nightly(by_day=["3d"])
@pytest.mark.program
@pytest.mark.parametrize("world", ["minihuman/MiniGrid-Empty-5x5-v0", FIRST_PERSON_WORLD[0]], ids=["grid", "3d"])
def test_a_page_that_lies_of_its_steps_is_named_and_its_neighbour_notices_nothing(tmp_path: Path, world: str) -> None:
    async def both(liar: TypedPage, honest: TypedPage) -> None:
        await asyncio.wait_for(asyncio.gather(liar.take_part(), honest.take_part()), PATIENCE_S)

    with served(tmp_path, links=2, episodes=2, **({} if "Grid" in world else {"world": FIRST_PERSON_WORLD})) as server:
        pages = [
            kind(server.host, token, keys_per_s=keys_hz, rng=random.Random(3), computes=world)
            for kind, token, keys_hz in zip((LyingPage, TypedPage), server.links, (25, 6), strict=True)
        ]
        asyncio.run(both(*pages))
        assert [page.counts.over for page in pages] == ["complete", "complete"]
        assert "Traceback" not in server.complaints()
        logs = sorted((tmp_path / "data").rglob("*.mcap"))
    named = [
        [event.text for event in read_events(log) if isinstance(event, Noted) and event.kind == BROWSER_NOTE]
        for log in logs
    ]
    assert sorted(map(bool, named)) == [False, True]
    for log in logs:
        assert list(find_log_differences(log, World)) == []


WATCHES = """(ms) => {
  const pictures = globalThis.pictures = [], end = performance.now() + ms;
  const look = () => {
    const canvas = document.querySelector("#screen canvas");
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const sum = data.reduce((sum, byte, at) => (sum * 31 + byte * (at % 7 + 1)) % 4294967291, 0);
    pictures.push([performance.now(), sum]);
    if (performance.now() < end) requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}"""


@pytest.mark.nightly
@pytest.mark.program
@needs("chromium")
def test_a_view_moves_to_the_next_picture_and_a_step_counts_as_seen_from_the_beginning_of_it(tmp_path: Path) -> None:
    path = tmp_path / "moving.toml"
    block = BLOCK.format(name="four", world="MiniWorld-FourRooms-v0", actions=WALKS, more="motion_ms = 1000")
    path.write_text(PALETTES.replace("{blocks}", "['four']") + block)
    protocol = decode_protocol(path.read_bytes())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    (episode,) = plan.episodes
    world = World(episode.world, episode.options)
    world.reset(episode.seed)
    before = world.frame(episode.view, (400, 300))
    with serving(path, tmp_path) as server, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{server.port}/#t={server.tokens[0]}")
        somebody.to_play()
        by = time.monotonic() + PATIENCE_S
        while not np.array_equal(picture_of(somebody), before) and time.monotonic() < by:
            time.sleep(0.05)
        somebody.page.evaluate(WATCHES, 3000)
        somebody.press(next(key for key, name in episode.key_map.keys.items() if name == "turn_left"))
        world.step(world.action_names.index("turn_left"))
        after = world.frame(episode.view, (400, 300))
        while not np.array_equal(picture_of(somebody), after) and time.monotonic() < by:
            time.sleep(0.05)
        np.testing.assert_array_equal(picture_of(somebody), after)
        time.sleep(1)
        seen = somebody.page.evaluate("pictures")
        page_ms, session_ns = somebody.page.evaluate("[performance.now(), minihuman.state.now]")
        there_ms = next(at_ms for at_ms, picture in seen if picture == seen[-1][1])
        there_ns = session_ns - round((page_ms - there_ms) * 1e6)
        assert len({picture for _, picture in seen}) >= 3  # before, after, and between them
        while somebody.state["playing"] and not somebody.state["ended"]:
            somebody.press(sorted(episode.key_map.keys)[0])
        somebody.to_end()
        assert somebody.errors == []
    [log] = tmp_path.rglob("*.mcap")
    events = read_events(log)
    stepped = next(event for event in events if isinstance(event, Stepped))
    shown = next(event for event in events if isinstance(event, FrameShown) and event.step == 1)
    assert stepped.key_t_ns < shown.flip_ns < there_ns  # not when the whole picture was there
    assert list(find_log_differences(log, World)) == []


SLOW_CLOCK = """
const now = performance.now.bind(performance);
performance.now = () => { const until = now() + 2; while (now() < until); return now(); };
"""  # a page that may be held up between any two looks at the clock


@pytest.mark.program
@needs("chromium")
def test_a_message_tells_of_the_step_that_is_due_by_its_very_time(tmp_path: Path) -> None:
    block = 'pace = "real_time"\nstep_period_ms = 50.0\nnoop_action = "done"\n'
    protocol = study(tmp_path, GRID, max_steps=90, episodes=1, block=block)
    with serving(protocol, tmp_path) as server, browsing() as sit_down:
        somebody = sit_down("about:blank")
        told = list_received(somebody)
        somebody.page.goto(f"http://127.0.0.1:{server.port}/#t={server.tokens[0]}")
        somebody.to_play()
        somebody.page.evaluate(SLOW_CLOCK)
        began_s = time.monotonic()
        while somebody.state["playing"] and not somebody.state["ended"]:
            somebody.page.keyboard.press("3")
            assert time.monotonic() - began_s < PATIENCE_S
        somebody.to_end()
        assert somebody.errors == []
    assert b'"t":"state"' not in b"".join(told), "the page had to be told where it was"
