"""What a model is sent is what a person sees: the same screens, read back from a window's surface."""

import base64
import hashlib
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pygame
import pytest
from PIL import Image

from minihuman import simulate, verify
from minihuman.display.drawing.screen import repaint_screen
from minihuman.display.windows.blocking_window import TITLE
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.activities.activity import ENTER_KEYS
from minihuman.experiment.machine.events import ModelCall
from minihuman.experiment.machine.inputs import KeyDown, PointerPressed, ScreenShown, Tick
from minihuman.experiment.machine.screens import PageScreen, PlayScreen, Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.simulation.model_conversation import find_picture_size
from minihuman.worlds.adapters.world import World
from tests.models.endpoint import KEY, play, serve_endpoint
from tests.models.studies import study
from tests.xserver import Typist, xvfb

LONG = bool(os.environ.get("MINIHUMAN_LONG"))
STEPS = 75 if LONG else 4
MODELS = 64 if LONG else 1
BLOCKS = (
    ("partial", "MiniGrid-DoorKey-8x8-v0", ("left", "right", "forward"), 'view = "partial"'),
    ("full", "BabyAI-GoTo-v0", ("left", "right", "forward"), 'view = "full"'),
    ("text", "BabyAI-GoToLocal-v0", ("left", "right", "forward"), 'view = "text"\nkey_map = "shown"'),
    ("safe", "MiniGrid-FourRooms-v0", ("left", "right", "forward"), 'palette = "colour-safe"'),
    ("inside", "MiniWorld-FourRooms-v0", ("turn_left", "turn_right", "move_forward"), ""),
)
KINDS = (
    """
[study]
name = "kinds"
version = "1"
seed = 4
participants = 200
closing = ""
[model]
modality = "picture"
[keys]
keyboard_check = false
pool = ["1", "2", "3"]
[[groups]]
name = "all"
blocks = %s
"""
    % [name for name, *_ in BLOCKS]
    + "".join(
        f"""
[[blocks]]
name = "{name}"
world = "minihuman/{world}"
actions = {list(actions)}
max_steps = {40 if LONG else 9}
episodes = 1
{more}
"""
        for name, world, actions, more in BLOCKS
    )
)


def pictures_sent(requests: list[list[dict[str, Any]]]) -> list[np.ndarray]:
    """The pictures of requests, uint8[H, W, 3]."""
    parts = [
        part for request in requests if isinstance(request[-1]["content"], list) for part in request[-1]["content"]
    ]
    urls = [part["image_url"]["url"].partition(",")[2] for part in parts if part["type"] == "image_url"]
    return [np.asarray(Image.open(io.BytesIO(base64.b64decode(url)))) for url in urls]


@pytest.mark.program
@pytest.mark.parametrize("view", ["partial", "text"])
def test_a_person_of_the_same_slot_is_shown_the_same_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, view: str
) -> None:
    """A window of the protocol's size shows sub-01 each picture that model-01 was sent, pixel for pixel."""
    text = study("picture", block=f'key_map = "shown"\nview = "{view}"').replace(
        "max_steps = 4", f"max_steps = {STEPS}"
    )
    text = text.replace("Empty-5x5", "Empty-16x16")
    (tmp_path / "study.toml").write_text(text)
    with serve_endpoint(play) as endpoint:
        monkeypatch.setenv("OPENAI_BASE_URL", endpoint.url)
        monkeypatch.setenv("OPENAI_API_KEY", KEY)
        (path,) = simulate(tmp_path / "study.toml", participants=1, data=tmp_path / "data", player="model:x")
    sent, log = pictures_sent(endpoint.requests), read_log(path)
    keys = [key for episode in log.episodes for key in episode.step_keys]
    from minihuman.display.windows.pygame_window import PygameWindow

    protocol = decode_protocol(text.encode())
    with xvfb() as display:
        monkeypatch.setenv("DISPLAY", display)
        monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
        pygame.display.quit()  # whatever was tried before in this process was on another screen
        typist = Typist(display)
        window = PygameWindow(VirtualClock(), fullscreen=False, size_px=protocol.model.size_px)
        shown = [typist.picture(TITLE) for _ in show_person(protocol, 0, keys, window.show)]
        window.close()
        typist.close()
    assert [line.text for line in verify(path) if not line.ok] == []
    assert log.episodes[0].plan.view == view
    assert len(sent) == len(shown) == 2 * STEPS
    assert all(np.array_equal(one, other) for one, other in zip(sent, shown, strict=True))


@pytest.mark.long
def test_every_picture_that_models_were_sent_is_drawn_again_for_the_people_of_their_slots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each block is another kind of picture; the digests are those of the calls in the log."""
    path = tmp_path / "study.toml"
    path.write_text(KINDS)
    protocol = decode_protocol(path.read_bytes())
    with serve_endpoint(lambda _, number: f"Answer: {'123'[number * 7 % 11 % 3]}") as endpoint:
        monkeypatch.setenv("OPENAI_BASE_URL", endpoint.url)
        monkeypatch.setenv("OPENAI_API_KEY", KEY)
        paths = list(simulate(path, participants=MODELS, data=tmp_path, player="model:x", parallel=2))
    compared = 0
    for log in map(read_log, paths):
        sent = [one.picture_sha256 for one in log.part_events if isinstance(one, ModelCall) and one.state == "answered"]
        keys = [key for episode in log.episodes for key in episode.step_keys]
        drawn = []
        for screen in show_person(protocol, log.plan.participant.index, keys):
            width, height = protocol.model.size_px
            canvas = np.zeros((height, width, 3), np.uint8)
            repaint_screen(canvas, None, screen)
            drawn.append(hashlib.sha256(str(canvas.shape).encode() + canvas.tobytes()).hexdigest())
        assert drawn == sent
        compared += len(drawn)
    print(f"{compared} pictures")
    assert compared >= (9_700 if LONG else 40)


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
