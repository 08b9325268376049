"""What a model is sent is what a person sees: read back from a window, from a browser's canvas, and from their logs."""

import base64
import hashlib
import io
import os
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pygame
import pytest
from PIL import Image

from minihuman import simulate, verify
from minihuman.display.drawing.play_screens import locate_picture, picture_size_px
from minihuman.display.drawing.screen import repaint_screen
from minihuman.display.windows.blocking_window import TITLE
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.activity import ENTER_KEYS
from minihuman.experiment.machine.events import ModelCall
from minihuman.experiment.machine.inputs import KeyDown, PointerPressed, ScreenShown, Tick
from minihuman.experiment.machine.screens import PageScreen, PlayScreen, Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.simulation.model_conversation import find_picture_size
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.lab_package import install_lab as install_lab
from tests.machine import needs
from tests.models.endpoint import KEY, Reply, play, serve_endpoint, text_of
from tests.models.studies import study
from tests.web.browser import Somebody, browsing
from tests.web.serving import serving
from tests.web.test_computed import picture_of
from tests.xserver import Typist, xvfb

LONG = bool(os.environ.get("MINIHUMAN_NIGHTLY"))
STEPS = 64 if LONG else 3  # of each kind of picture, in a window and in a browser
MODELS = 64 if LONG else 1
SIZE_PX = (640, 480)
BLOCKS = (  # without hands nobody picks up or puts, so that those episodes last to their limit
    ("partial", "MiniGrid-DoorKey-8x8-v0", ("left", "right", "forward"), 'view = "partial"'),
    ("full", "BabyAI-Pickup-v0", ("left", "right", "forward"), 'view = "full"'),
    ("text", "BabyAI-PutNextLocal-v0", ("left", "right", "forward"), 'view = "text"\nkey_map = "shown"'),
    ("safe", "MiniGrid-FourRooms-v0", ("left", "right", "forward"), 'palette = "colour-safe"'),
    ("inside", "MiniWorld-FourRooms-v0", ("turn_left", "turn_right", "move_forward"), ""),
)
KINDS = f"""
[study]
name = "kinds"
version = "1"
seed = 4
participants = 200
closing = ""
[model]
modality = "picture"
size_px = {list(SIZE_PX)}
[web]
image_size_px = {list(picture_size_px(SIZE_PX))}
[keys]
keyboard_check = false
pool = ["1", "2", "3"]
[[groups]]
name = "all"
blocks = {[name for name, *_ in BLOCKS]}
""" + "".join(
    f"""
[[blocks]]
name = "{name}"
world = "minihuman/{world}"
actions = {list(actions)}
max_steps = MAX_STEPS
episodes = 1
{more}
"""
    for name, world, actions, more in BLOCKS
)
PLAYER = """
from minihuman.ext import KeyPress, SimulatedParticipant

KEYS = {}

class Player(SimulatedParticipant):
    def __init__(self, argument, rng):
        pass

    def begin(self, plan, pool, world):
        self.left = iter(KEYS[plan.block_name, plan.seed])

    def press(self, world):
        return KeyPress(next(self.left), 300.0)
"""


def send_to_models(
    folder: Path, text: str, monkeypatch: pytest.MonkeyPatch, *, models: int = 1, reply: Reply | None = None
) -> tuple[list[list[dict[str, Any]]], list[SessionLog]]:
    """Every request that models' sessions made, and their logs."""
    (folder / "study.toml").write_text(text)
    with serve_endpoint(reply or (lambda _, number: f"Answer: {'123'[number * 7 % 11 % 3]}")) as endpoint:
        monkeypatch.setenv("OPENAI_BASE_URL", endpoint.url)
        monkeypatch.setenv("OPENAI_API_KEY", KEY)
        paths = simulate(folder / "study.toml", participants=models, data=folder / "data", player="model:x", parallel=2)
        return endpoint.requests, [read_log(path) for path in paths]


def pictures_sent(requests: list[list[dict[str, Any]]]) -> list[np.ndarray]:
    """The pictures of requests, uint8[H, W, 3]."""
    parts = [
        part for request in requests if isinstance(request[-1]["content"], list) for part in request[-1]["content"]
    ]
    urls = [part["image_url"]["url"].partition(",")[2] for part in parts if part["type"] == "image_url"]
    return [np.asarray(Image.open(io.BytesIO(base64.b64decode(url)))) for url in urls]


def keys_of(log: SessionLog) -> list[str]:
    return [key for episode in log.episodes for key in episode.step_keys]


@pytest.mark.program
@pytest.mark.nightly(sample=True)
@needs("xvfb")
def test_a_window_shows_a_person_of_the_same_slot_the_same_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A window of the protocol's size shows sub-01 each picture that model-01 was sent: five kinds of them."""
    text = KINDS.replace("MAX_STEPS", str(STEPS))
    requests, (log,) = send_to_models(tmp_path, text, monkeypatch)
    sent, protocol = pictures_sent(requests), decode_protocol(text.encode())
    from minihuman.display.windows.pygame_window import PygameWindow

    with xvfb() as display:
        monkeypatch.setenv("DISPLAY", display)
        monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
        pygame.display.quit()  # whatever was tried before in this process was on another screen
        typist = Typist(display)
        window = PygameWindow(VirtualClock(), fullscreen=False, size_px=protocol.model.size_px)
        shown = [typist.picture(TITLE) for _ in show_person(protocol, 0, keys_of(log), window.show)]
        window.close()
        typist.close()
    assert [line.text for line in verify(log.path) if not line.ok] == []
    steps = [len(episode.actions) for episode in log.episodes]
    print(f"{len(sent)} pictures in a window: {dict(zip((name for name, *_ in BLOCKS), steps, strict=True))}")
    assert len(sent) == len(shown) == sum(steps)
    assert min(steps) > 1
    assert len(sent) >= (300 if LONG else 10)
    assert all(np.array_equal(one, other) for one, other in zip(sent, shown, strict=True))


@pytest.mark.nightly
@pytest.mark.program
@needs("chromium")
def test_a_browsers_canvas_shows_a_person_of_the_same_slot_the_same_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The world's picture in each screen that model-01 was sent is what sub-01's page shows, and its log draws."""
    text = KINDS.replace("MAX_STEPS", str(STEPS))
    requests, (log,) = send_to_models(tmp_path, text, monkeypatch)
    sent, keys = iter(pictures_sent(requests)), iter(keys_of(log))
    compared = 0
    with serving(tmp_path / "study.toml", tmp_path / "page") as server, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{server.port}/#t={server.tokens[0]}")
        for episode in log.episodes:
            somebody.to_play()
            for step in range(len(episode.actions)):
                if episode.plan.view == "text":  # of which the server draws every picture
                    somebody.until(f"s.step >= {step}")
                picture, shown, by_s = next(sent), picture_of(somebody), time.monotonic() + PATIENCE_S
                left, top, width, height = locate_picture(shown, SIZE_PX)
                right = picture[top : top + height, left : left + width]
                while not np.array_equal(shown, right) and time.monotonic() < by_s:
                    time.sleep(0.02)  # the first picture waits for textures, a key for the picture that it answers
                    shown = picture_of(somebody)
                    left, top, width, height = locate_picture(shown, SIZE_PX)  # before the first it has another size
                    right = picture[top : top + height, left : left + width]
                assert np.array_equal(shown, right), f"{episode.plan.block_name}, step {step}"
                compared += 1
                somebody.press(next(keys))
            somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
    print(f"{compared} pictures in a canvas")
    assert next(sent, None) is None
    assert compared >= (300 if LONG else 10)
    [path] = (tmp_path / "page").rglob("*.mcap")
    assert keys_of(read_log(path)) == keys_of(log)
    assert draw_from_log(path) == digests_sent(log)


@pytest.mark.nightly(sample=True)
def test_every_picture_that_models_were_sent_is_drawn_again_from_the_logs_of_the_people_of_their_slots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, install_lab: Any
) -> None:
    """Each block is another kind of picture; the digests are those of the calls in the models' logs."""
    _, models = send_to_models(tmp_path, KINDS.replace("MAX_STEPS", "40" if LONG else "9"), monkeypatch, models=MODELS)
    keys = {(one.plan.block_name, one.plan.seed): list(one.step_keys) for log in models for one in log.episodes}
    install_lab("lab", PLAYER.replace("{}", repr(keys)), players=["lab = a_lab:Player"])
    people = simulate(tmp_path / "study.toml", participants=MODELS, data=tmp_path / "data", player="lab")
    by_slot = {log.plan.participant.index: log for log in models}
    compared = 0
    for path in people:
        log = by_slot.pop(read_log(path).plan.participant.index)
        drawn = draw_from_log(path)
        assert drawn == digests_sent(log)
        compared += len(drawn)
    print(f"{compared} pictures from {MODELS} people's logs")
    assert by_slot == {}
    assert compared >= (9_700 if LONG else 40)


@pytest.mark.program
@needs("chromium")
def test_a_browser_shows_the_words_of_every_page_and_question_that_a_model_was_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = study("picture").replace("[[questions.items]]", "[[questions.items]]\nrequired = false")
    requests, (log,) = send_to_models(tmp_path, text, monkeypatch, reply=play)
    asked = [text_of(request) for request in requests]
    questions = [text for text in asked if "one key of" not in text and "go_on" not in text]
    assert len(questions) == 6
    with serving(tmp_path / "study.toml", tmp_path / "page") as server, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{server.port}/#t={server.tokens[0]}")
        somebody.until("s.welcomed && s.kind === 'page'")
        somebody.page.evaluate(KEEP_WORDS)
        words = requests[0][0]["content"].splitlines()[1:]
        assert words_missing(words, somebody) == []
        for episode in log.episodes:
            somebody.to_play()
            for key in episode.step_keys:
                somebody.press(key)
            somebody.until("!s.playing")
        while somebody.state["kind"] != "question":
            before = somebody.screen()
            if somebody.state["kind"] in ("text", "page"):
                somebody.press("enter")  # once: a second one would leave the first question out
            while somebody.screen() == before and somebody.state["kind"] != "question":
                somebody.page.wait_for_timeout(20)
        for text in questions:
            *shown, _ = text.splitlines()  # the last line says how a model is to answer
            by_s = time.monotonic() + PATIENCE_S
            while missing := words_missing(shown, somebody):
                assert time.monotonic() < by_s, missing
                somebody.page.wait_for_timeout(50)
            somebody.page.locator('[data-target="go_on"]').click()  # which leaves it out
        somebody.to_end()
        assert somebody.errors == []


KEEP_WORDS = """() => {
  const screen = document.querySelector("#screen");
  globalThis.shown = [screen.innerText];
  const keep = () => globalThis.shown.push(screen.innerText);
  new MutationObserver(keep).observe(screen, { subtree: true, childList: true, characterData: true });
}"""


def words_missing(lines: list[str], somebody: Somebody) -> list[str]:
    """The parts of lines that no screen so far held; numbers of options, and a mark put into words, are the model's."""
    kept = [re.sub(r"^\d+\. ", "", line) for line in lines if not line.startswith("The episode ended")]
    parts = [" ".join(part.split()) for line in kept for part in line.split(" ... ")]
    words = " ".join(somebody.page.evaluate("shown.join(' ')").split())
    return [part for part in parts if part not in words]


def digests_sent(log: SessionLog) -> list[str]:
    return [one.picture_sha256 for one in log.part_events if isinstance(one, ModelCall) and one.state == "answered"]


def draw_from_log(path: Path) -> list[str]:
    """The digest of each picture on which a key made a step, drawn from a person's log at the size that models get."""
    events = list(read_events(path))
    protocol, drawn = decode_protocol(read_log(path).plan.protocol_toml), []
    seen: list[tuple[int, int]] = []

    def look(session: SessionMachine, _: ModelCall | None) -> str:
        screen = session.screen
        if isinstance(screen, PlayScreen) and session.play is not None:
            now = session.play.plan.episode, session.play.steps
            if now not in seen:
                seen.append(now)
                drawn.append(digest_screen(screen, protocol))
        return ""

    px = find_picture_size(protocol.model)
    assert list(compare_replay(events, World, follow=look, picture_px=px)) == []
    return drawn


def digest_screen(screen: Screen, protocol: Protocol) -> str:
    width, height = protocol.model.size_px
    canvas = np.zeros((height, width, 3), np.uint8)
    repaint_screen(canvas, None, screen)
    return hashlib.sha256(str(canvas.shape).encode() + canvas.tobytes()).hexdigest()


def show_person(
    protocol: Protocol, index: int, keys: list[str], show: Callable[[Screen], object] = lambda _: None
) -> Iterator[Screen]:
    """Play a person's slot with these keys; yield each screen that is answered with one, once it is shown."""
    clock = VirtualClock()
    plan = expand_protocol(protocol, enrol_participant(protocol, index))
    session = SessionMachine(plan, World, {}, picture_px=find_picture_size(protocol.model))
    session.receive(Tick(0))
    left = list(keys)
    while left:
        show(session.screen)
        session.receive(ScreenShown(clock(), clock(), clock()))
        clock.advance_to(clock() + 10_000_000_000)
        session.receive(Tick(clock()))
        match session.screen:
            case PlayScreen() if session.play is not None:
                yield session.screen
                session.receive(KeyDown(clock(), left.pop(0)))
            case PageScreen():
                session.receive(PointerPressed(clock(), 0.5, 0.5, "go_on"))
            case screen:
                missing = [key for key, pressed in getattr(screen, "keys", ()) if not pressed]
                session.receive(KeyDown(clock(), missing[0] if missing else ENTER_KEYS[0]))
    session.close()
