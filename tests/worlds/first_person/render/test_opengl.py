"""The same textures and meshes drawn by OpenGL and by us."""

import json
import subprocess
import sys

import pytest

from tests.counts import count
from tests.machine import needs

SCENES = ("FourRooms", "Hallway", "Maze", "PickupObjects", "Sidewalk")


@needs("opengl")
@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("name", SCENES[: count(1, len(SCENES))])
def test_a_picture_differs_little_from_miniworlds_opengl_picture(name: str) -> None:
    poses = str(count(10, 200))
    run = subprocess.run(
        [sys.executable, "-m", "tests.worlds.first_person.render.compare", name, poses], capture_output=True, check=True
    )
    result = json.loads(run.stdout.splitlines()[-1])
    # OpenGL blends two sizes of a texture where we take the one that fits: what is far away is a little sharper
    assert result["mean"] <= 3.5, result
    assert result["far_off"] <= 0.06, result
    assert result["depth_off"] <= 0.005, result  # edges, where the one sees the wall and the other what is behind it
