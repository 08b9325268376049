"""The public API as a user types it: mypy reads this file with the package, and nothing runs it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, assert_type

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

import minihuman
from minihuman.dataset.selection import Selection
from minihuman.log.model.session_log import Segment
from minihuman.recorded_study import Episode, ReplayedStep, Session, Study

opened = minihuman.open_study("sessions/demo", Selection(block=("grid",), with_=("exclude",)))
session = minihuman.open_session("sessions/demo/sub-01/ses-01")
assert_type(opened, Study)
assert_type(session, Session)
assert_type(opened.table("episodes"), pd.DataFrame)
assert_type(opened.episodes, tuple[Episode, ...])
assert_type(opened.sessions, tuple[Session, ...])
assert_type(opened["sub-01"], Session)
assert_type(opened["sub-01", 2], Session)
assert_type(opened.figure("learning"), Figure)
assert_type(opened.query("select 1"), pd.DataFrame)
assert_type(session.figure("paths"), Figure)
assert_type(session.segments, tuple[Segment, ...])
assert_type(minihuman.run("protocols/demo.toml", participant="sub-01"), Path | None)
assert_type(minihuman.simulate("protocols/demo.toml", participants=2), Iterator[Path])
assert_type(next(minihuman.verify("sessions/demo")).ok, bool)
assert_type(minihuman.export("csv", "sessions/demo", "csv").steps, int)
assert_type(minihuman.report("sessions/demo", "report").page, Path)
episode = opened.episodes[3]
assert_type(episode.path, NDArray[np.float64])
assert_type(episode.actions, tuple[str, ...])
assert_type(episode.frames(), list[NDArray[np.uint8]])
assert_type(episode.play_back(), Iterator[ReplayedStep])
assert_type(next(episode.play_back()).observation, Any)
