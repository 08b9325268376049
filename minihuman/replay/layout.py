"""The replay's layout: what stands where when the viewer opens."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from minihuman.recorded.episode import SessionLog
from minihuman.replay.moments import ALIGNED, PLAY_TIME
from minihuman.replay.scene import session_root

_MARGIN = 0.04
Bounds = tuple[float, float, float, float]


def layout(logs: Sequence[SessionLog], *, with_view: bool) -> rrb.Blueprint:
    """Map and view beside numbers, keys and words for one session; a column a session for several."""
    single = len(logs) == 1
    columns = [_single(log, with_view=with_view) if single else _column(log, with_view=with_view) for log in logs]
    return rrb.Blueprint(
        rrb.Horizontal(*columns) if not single else columns[0],
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=PLAY_TIME if single else ALIGNED, play_state="paused"),
        auto_views=False,
    )


def _single(log: SessionLog, *, with_view: bool) -> rrb.Horizontal:
    root = session_root(log)
    taught = any(episode.taught is not None for episode in log.episodes)
    steering = [rrb.StateTimelineView(origin=f"{root}/steering", name="Policy and person")] if taught else []
    pictures = [_maps(log), *([rrb.Spatial2DView(origin=f"{root}/view", name="View")] if with_view else [])]
    return rrb.Horizontal(
        rrb.Vertical(*pictures, row_shares=[3, 2][: len(pictures)]),
        rrb.Vertical(
            *steering,
            rrb.StateTimelineView(origin=f"{root}/keys", name="Keys"),
            rrb.TimeSeriesView(origin=root, contents=["$origin/reward", "$origin/return"], name="Reward"),
            rrb.TimeSeriesView(origin=root, contents=["$origin/reaction_ms"], name="Reaction time (ms)"),
            rrb.Tabs(
                rrb.TextLogView(origin=f"{root}/events", name="Events"),
                rrb.TextDocumentView(origin=f"{root}/facts", name="Session"),
            ),
            row_shares=[*([2] if taught else []), 3, 2, 2, 3],
        ),
        column_shares=[1, 1],
    )


def _column(log: SessionLog, *, with_view: bool) -> rrb.Vertical:
    root = session_root(log)
    return rrb.Vertical(
        _maps(log, f"{root} ({log.plan.participant.group}): "),
        *([rrb.Spatial2DView(origin=f"{root}/view", name="View")] if with_view else []),
        rrb.TimeSeriesView(origin=root, contents=["$origin/return"], name="Return"),
        rrb.TextLogView(origin=f"{root}/events", name="Events"),
    )


def _maps(log: SessionLog, name: str = "") -> rrb.Spatial2DView | rrb.Tabs:
    """The map in as many sizes as the blocks have; the first block's is in front."""
    bounds: dict[str, list[Bounds]] = {}
    for episode in log.episodes:
        if episode.start.map is not None:
            bounds.setdefault(episode.plan.block_name, []).append(episode.start.map.bounds)
    if len(bounds) < 2:
        return _map_view(log, f"{name}map", next(iter(bounds.values()), []))
    return rrb.Tabs(*(_map_view(log, f"{name}map of {block}", theirs) for block, theirs in bounds.items()))


def _map_view(log: SessionLog, name: str, bounds: Sequence[Bounds]) -> rrb.Spatial2DView:
    visual = None
    if bounds:
        x0, z0 = min(b[0] for b in bounds), min(b[1] for b in bounds)
        x1, z1 = max(b[2] for b in bounds), max(b[3] for b in bounds)
        margin = _MARGIN * max(x1 - x0, z1 - z0)
        visual = rrb.VisualBounds2D(x_range=(x0 - margin, x1 + margin), y_range=(z0 - margin, z1 + margin))
    return rrb.Spatial2DView(origin=f"{session_root(log)}/map", name=name, visual_bounds=visual)
