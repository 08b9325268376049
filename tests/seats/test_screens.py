"""check --pictures: every screen of a study as a participant will see it, without a window."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from minihuman.lab.protocol_file import read_protocol
from minihuman.seats.screens import save_screens, screens_of
from minihuman.study.expand import enrol, expand

pytestmark = pytest.mark.program
DEMO = Path(__file__).parents[2] / "protocols" / "demo.toml"


def test_every_screen_is_drawn_once_and_all_are_on_one_sheet(tmp_path: Path) -> None:
    demo = read_protocol(DEMO)
    plan = expand(demo, enrol(demo, 0))
    names = [name for name, _ in screens_of(plan, (640, 360))]
    for phase in ("keyboard_check", "instructions", "ready", "grid-playing", "grid-hold", "first-person-playing"):
        assert phase in names
    *pictures, sheet = save_screens(plan, tmp_path / "out", (640, 360))
    assert len(pictures) == len(names)
    for path in pictures:
        with Image.open(path) as image:
            drawn = np.asarray(image)
        assert drawn.shape == (360, 640, 3)
        assert drawn.std() > 1, f"{path.name} is empty"
    assert sheet.name == "contact-sheet.png"
    with Image.open(sheet) as whole:
        assert whole.size[0] == 5 * 328
