"""The public API as a user types it: mypy reads this file with the package, and nothing runs it."""

from collections.abc import Iterator
from typing import Any, assert_type

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

import minihuman
from minihuman import Episode, Moment, Segment, Selection, Session, Study

opened = minihuman.open("sessions/demo", Selection(block=("grid",), with_=("exclude",)))
assert_type(opened, Study | Session)
assert_type(opened.table("episodes"), pd.DataFrame)
assert_type(opened.episodes, tuple[Episode, ...])
assert_type(opened.sessions, tuple[Session, ...])
if isinstance(opened, Study):
    assert_type(opened["sub-01"], Session)
    assert_type(opened.figure("learning"), Figure)
    assert_type(opened.query("select 1"), pd.DataFrame)
else:
    assert_type(opened.figure("paths"), Figure)
    assert_type(opened.segments, tuple[Segment, ...])
episode = opened.episodes[3]
assert_type(episode.path, NDArray[np.float64])
assert_type(episode.actions, tuple[str, ...])
assert_type(episode.frames(), list[NDArray[np.uint8]])
assert_type(episode.play_back(), Iterator[Moment])
assert_type(next(episode.play_back()).observation, Any)
