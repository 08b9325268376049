"""What people's hands can do in five kinds of world is logged, verified, drawn and exported so that it replays."""

import pytest

from tests.machine import needs
from tests.worlds.recorded_sessions import RECORDINGS, Recording, try_recording

pytestmark = [pytest.mark.nightly(sample=True), pytest.mark.program, needs("recordings")]


@pytest.mark.parametrize("one", RECORDINGS, ids=lambda one: one.world)
def test_a_recorded_session_is_proven_and_its_exports_replay(one: Recording, tmp_path) -> None:
    assert try_recording(one, tmp_path)
