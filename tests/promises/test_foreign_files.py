"""What a protocol names beside itself: regular files of its own folder, of the right kind and size, or one sentence."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from minihuman import simulate, verify
from minihuman.admin.protocol_file import MAX_PROTOCOL_BYTES, read_protocol
from minihuman.errors import LearnError, ProtocolError
from tests.machine import needs
from tests.promises.sessions import TOML

TEXT = TOML.format(episodes=1, steps=10)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A protocol's folder with a picture, and what leads out of it."""
    study = tmp_path / "study"
    study.mkdir()
    picture = Image.fromarray(np.zeros((4, 4, 3), np.uint8))
    picture.save(study / "seen.png")
    picture.save(tmp_path / "outside.png")
    picture.save(study / "seen.jpg", "jpeg")
    (study / "link.png").symlink_to(tmp_path / "outside.png")
    os.mkfifo(study / "pipe")
    with (study / "long").open("wb") as file:
        file.truncate(1 << 40)
    return study


def _refusal(folder: Path, more: str) -> str:
    (folder / "p.toml").write_text(TEXT + more)
    with pytest.raises(ProtocolError) as refused:
        read_protocol(folder / "p.toml")
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("/dev/zero", "is outside the protocol's folder"),
        ("/etc/passwd", "is outside the protocol's folder"),
        ("../outside.png", "is outside the protocol's folder"),
        ("link.png", "is outside the protocol's folder"),
        ("pipe", "is not a regular file"),
        (".", "is not a regular file"),
        ("long", "is larger than 16777216 bytes"),
        ("seen.jpg", "is not a PNG"),
        ("gone.png", "No such file"),
    ],
)
def test_a_picture_is_a_png_of_the_protocols_folder(folder: Path, name: str, said: str) -> None:
    assert said in _refusal(folder, f'\n[[pages]]\nname = "look"\nimages = ["{name}"]\n')


def test_a_picture_in_the_folder_is_read(folder: Path) -> None:
    (folder / "p.toml").write_text(f'{TEXT}\n[[pages]]\nname = "look"\nimages = ["seen.png"]\n')
    assert read_protocol(folder / "p.toml").files == {"seen.png": (folder / "seen.png").read_bytes()}


def test_a_session_whose_page_showed_a_picture_is_proven_without_the_folder(folder: Path) -> None:
    parts = TEXT.replace('blocks = ["small"]', 'parts = ["look", "small"]')
    (folder / "p.toml").write_text(f'{parts}\n[[pages]]\nname = "look"\ntext = "A page."\nimages = ["seen.png"]\n')
    (log,) = simulate(folder / "p.toml", participants=1, data=folder.parent / "data")
    found = list(verify(log))
    assert found
    assert all(line.ok for line in found), found


@pytest.mark.parametrize("make", [lambda path: os.mkfifo(path), lambda path: path.symlink_to("/dev/zero")])
def test_a_protocol_is_a_regular_file(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "p.toml")
    with pytest.raises(ProtocolError, match="is not a regular file"):
        read_protocol(tmp_path / "p.toml")


def test_a_protocol_is_of_a_limited_size(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_bytes(b"#" * (MAX_PROTOCOL_BYTES + 1))
    with pytest.raises(ProtocolError, match="is larger than 1048576 bytes"):
        read_protocol(tmp_path / "p.toml")


@needs("learn")
@pytest.mark.parametrize("name", ["/etc/passwd", "../outside.png", "seen.png", "pipe"])
def test_a_policy_is_read_as_one_before_anything_is_kept(folder: Path, name: str) -> None:
    text = TEXT.replace(
        "episodes = 1", f'kind = "takeover"\nagent = {{ policy = "{name}", step_ms = 400 }}\nepisodes = 1'
    )
    (folder / "p.toml").write_text(text)
    with pytest.raises(
        ProtocolError,
        match=r"agent.policy: .*(is outside the protocol's folder|is not a policy file|is not a regular file)",
    ):
        read_protocol(folder / "p.toml")


@needs("learn")
def test_malformed_policies_are_each_refused_in_a_sentence(tmp_path: Path) -> None:
    import torch

    from minihuman.learn.policy.file import PolicyCard, load_policy, save_policy
    from minihuman.learn.policy.network import build_policy
    from minihuman.learn.policy.observation import ObservationEncoder

    names = ("left", "right", "forward")
    world = "minihuman/MiniGrid-Empty-5x5-v0"
    card = PolicyCard(world, {}, names, (3, 7, 7), ObservationEncoder(missions=False), "codes", "nothing", 0, 1)
    path = tmp_path / "made.pt"
    save_policy(build_policy(card.observation_space, 3, "codes"), card, path)
    whole = torch.load(path, weights_only=True)
    assert load_policy(path)[1] == card

    def but(**card_fields: object) -> dict[str, object]:
        return {**whole, "card": {**whole["card"], **card_fields}}

    def weigh(name: str, value: object) -> dict[str, object]:
        return {**whole, "weights": {**whole["weights"], name: value}}

    without_bias = {name: value for name, value in whole["weights"].items() if name != "action_net.bias"}
    for content, said in (
        ({name: value for name, value in whole.items() if name != "weights"}, "weights is a NoneType"),
        ({**whole, "weights": without_bias}, "action_net.bias is absent"),
        ({**whole, "weights": [1, 2]}, "weights is a list"),
        (but(image_shape=(3, 100_000, 100_000)), "an image of 3 x 100000 x 100000"),
        (but(image_shape=(3, 2_000, 1_000)), "features_extractor"),
        (but(action_names=("left",)), "action_net.bias is"),
        (but(image_shape="wide"), "its model card cannot be read"),
        (weigh("action_net.bias", torch.full((3,), float("nan"))), "is not a tensor of finite 32-bit floats"),
        (weigh("action_net.weight", torch.zeros(1).expand(100_000, 100_000)), "is not a tensor of finite"),
    ):
        torch.save(content, path)
        with pytest.raises(LearnError) as refused:
            load_policy(path)
        assert said in str(refused.value)
        assert "\n" not in str(refused.value)
