"""A gamepad at the desk: what SDL says of it is in the log, and a session that was played with it is proven."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.errors import WindowError
from minihuman.experiment.machine.events import AxisMoved
from minihuman.log.read.session_reader import read_log
from tests.counts import PATIENCE_S
from tests.window_host import HostedWindow

pytestmark = pytest.mark.program


@pytest.mark.skipif(sys.platform != "linux", reason="SDL's library is looked up in /proc")
def test_a_session_is_played_with_a_gamepad_and_replays(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.windows.virtual_gamepad", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1])
    [path] = tmp_path.rglob("*.mcap")
    log = read_log(path)
    [segment] = log.segments
    assert segment.facts["gamepad_dead_zone"] == "0.1"
    assert "-1 to 1" in segment.facts["gamepad_axes"]
    assert segment.facts["gamepad"]
    presses = [press for press in log.keys if press.down]
    assert {"enter", "pad_south"} <= {press.key for press in presses}
    assert {press.symbol for press in presses} == {"gamepad"}
    moved = {event.value for event in segment.part_events if isinstance(event, AxisMoved)}
    assert moved == {0.0, 0.5}, "the dead zone is rest"
    [episode] = log.episodes
    assert {(-0.5, 0.0), (-0.5, 2.0)} <= {*episode.actions_taken}
    assert all(ok for _, ok in verify_session(path))


def test_a_study_that_needs_a_gamepad_says_so_where_none_is(display: str) -> None:
    window = HostedWindow("pygame", display, size_px=(320, 240))
    try:
        with pytest.raises(WindowError, match="none is connected"):
            window.open_gamepad()
    finally:
        window.end()
