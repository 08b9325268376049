"""Draw the state diagrams of session.md from the transition tables: python docs/diagrams.py docs/images."""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape

from minihuman.activities.play.activity import PLAY_TRANSITIONS
from minihuman.experiment.machine.transitions import SESSION_TRANSITIONS, TransitionCause, TransitionTable

BOX_PX = 128, 34
MARKS = "\u00b9\u00b2\u00b3"
LINE_PX = 17  # from one line of a label to the next
DIALOGS = frozenset({TransitionCause.ASK_QUIT, TransitionCause.ASK_ABORT, TransitionCause.STAY, TransitionCause.END})
STYLE = """
text { font: 14px sans-serif; fill: #1f2328; text-anchor: middle; dominant-baseline: central }
.label { font-size: 13px; paint-order: stroke; stroke: #ffffff; stroke-width: 4px }
.left { text-anchor: start }
rect { fill: #e8eefc; stroke: #3d5a98; stroke-width: 1.5 }
path { fill: none; stroke: #57606a; stroke-width: 1.5 }
.tip { fill: #57606a; stroke: none }
@media (prefers-color-scheme: dark) {
  text { fill: #e6edf3 }
  .label { stroke: #1e2129 }
  rect { fill: #26324d; stroke: #8fabea }
  path { stroke: #a8b1bb }
  .tip { fill: #a8b1bb }
}
"""


@dataclass(frozen=True)
class Diagram:
    """A table of transitions and where its states and labels are drawn, pixels."""

    table: TransitionTable
    size_px: tuple[int, int]
    centres: Mapping[str, tuple[int, int]]
    title: str
    bends: Mapping[tuple[str, str], int] = field(default_factory=dict)  # how far an arrow bows to its left
    labels: Mapping[tuple[str, str], tuple[int, int]] = field(default_factory=dict)  # where not beside the arrow


DIAGRAMS = {
    "session_states.svg": Diagram(
        SESSION_TRANSITIONS,
        (430, 470),
        {"start": (215, 30), "part": (215, 130), "paused": (80, 270), "unfocused": (350, 270), "over": (215, 380)},
        "The states of a session: start, part, paused, unfocused and over, with what leads from one to another",
        {("part", "paused"): 26, ("paused", "part"): 26, ("part", "unfocused"): 26, ("unfocused", "part"): 26},
        {
            ("part", "part"): (348, 122),
            ("part", "paused"): (160, 232),
            ("paused", "part"): (62, 190),
            ("part", "unfocused"): (372, 186),
            ("unfocused", "part"): (268, 214),
            ("part", "over"): (215, 330),
        },
    ),
    "block_phases.svg": Diagram(
        PLAY_TRANSITIONS,
        (430, 740),
        {
            **{
                name: (150, 30 + 70 * row)
                for row, name in enumerate(
                    ("start", "instructions", "preparing", "ready", "interval", "fixation", "playing")
                )
            },
            "hold": (360, 450),
            "feedback": (360, 540),
            "learning": (150, 540),
            "rest": (360, 620),
            "over": (360, 700),
        },
        "The phases of a block: from instructions over the episodes, each with its feedback, to the rest",
        {("learning", "preparing"): 60},
        {("feedback", "learning"): (256, 526), ("playing", "hold"): (256, 422), ("learning", "preparing"): (42, 355)},
    ),
}


def draw_diagram(diagram: Diagram) -> str:
    """The diagram as SVG; arrows between the same two states share one, and conditions stand below."""
    arrows: dict[tuple[str, str], list[str]] = {}
    conditions: list[str] = []
    for row in diagram.table.rows:
        if row.cause not in DIALOGS:
            label = str(row.cause)
            if row.when is not None:
                conditions.append(f"if {row.when.__name__.strip('_').replace('_', ' ')}")
                label += f" {MARKS[len(conditions) - 1]}"
            arrows.setdefault((str(row.start), str(row.end)), []).append(label)
    width, height = diagram.size_px
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" role="img">',
        f"<title>{escape(diagram.title)}</title>",
        f"<style>{STYLE}</style>",
    ]
    labels: list[str] = []
    for (start, end), texts in arrows.items():
        path, tip, middle = _arrow(diagram.centres[start], diagram.centres[end], diagram.bends.get((start, end), 0))
        x, y = diagram.labels.get((start, end), middle)
        lines += [f'<path d="{path}"/>', f'<path class="tip" d="{tip}"/>']
        for number, text in enumerate(texts):
            labels.append(_text(text, x, y + (number - (len(texts) - 1) / 2) * LINE_PX, "label"))
    for name, (x, y) in diagram.centres.items():
        wide, high = BOX_PX
        lines.append(f'<rect x="{x - wide / 2:g}" y="{y - high / 2:g}" width="{wide}" height="{high}" rx="8"/>')
        lines.append(_text(name, x, y, ""))
    for number, condition in enumerate(conditions):
        y = height - LINE_PX * (len(conditions) - number) + 5
        labels.append(_text(f"{MARKS[number]} {condition}", 12, y, "label left"))
    return "\n".join([*lines, *labels, "</svg>", ""])


def _text(text: str, x: float, y: float, kind: str) -> str:
    return f'<text{f" class={chr(34)}{kind}{chr(34)}" if kind else ""} x="{x:.0f}" y="{y:.0f}">{escape(text)}</text>'


def _arrow(start: tuple[int, int], end: tuple[int, int], bend: int) -> tuple[str, str, tuple[float, float]]:
    """An arrow's path, its tip, and where its label is: a quadratic curve from edge to edge of two boxes."""
    if start == end:
        x, y = start[0] + BOX_PX[0] / 2, start[1]
        path = f"M{x:.0f} {y - 9} C{x + 44:.0f} {y - 30} {x + 44:.0f} {y + 30} {x:.0f} {y + 9}"
        return path, _tip((x, y + 9), (-1.0, -0.45)), (x + 40, y)
    if start[0] == end[0] and bend:  # past the states between them
        x, outside = start[0] - BOX_PX[0] / 2, start[0] - BOX_PX[0] / 2 - bend
        path = f"M{x:.0f} {start[1]} C{outside:.0f} {start[1]} {outside:.0f} {end[1]} {x:.0f} {end[1]}"
        return path, _tip((x, end[1]), (1.0, 0.0)), (outside, (start[1] + end[1]) / 2)
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy)
    control = ((start[0] + end[0]) / 2 + dy / length * bend * 2, (start[1] + end[1]) / 2 - dx / length * bend * 2)
    first, last = _edge(start, control), _edge(end, control)
    middle = tuple((a + 2 * b + c) / 4 for a, b, c in zip(first, control, last, strict=True))
    path = f"M{first[0]:.0f} {first[1]:.0f} Q{control[0]:.0f} {control[1]:.0f} {last[0]:.0f} {last[1]:.0f}"
    return path, _tip(last, (last[0] - control[0], last[1] - control[1])), (middle[0], middle[1])


def _edge(centre: tuple[int, int], towards: tuple[float, float]) -> tuple[float, float]:
    dx, dy = towards[0] - centre[0], towards[1] - centre[1]
    share = min(BOX_PX[0] / 2 / abs(dx) if dx else math.inf, BOX_PX[1] / 2 / abs(dy) if dy else math.inf)
    return centre[0] + dx * share, centre[1] + dy * share


def _tip(at: tuple[float, float], direction: tuple[float, float]) -> str:
    length = math.hypot(*direction)
    x, y = direction[0] / length, direction[1] / length
    corners = (at, (at[0] - 10 * x - 4 * y, at[1] - 10 * y + 4 * x), (at[0] - 10 * x + 4 * y, at[1] - 10 * y - 4 * x))
    return "M" + " L".join(f"{px:.1f} {py:.1f}" for px, py in corners) + " Z"


def list_dialog_moves() -> str:
    """The moves that the diagram of a session leaves out, as a list: the dialogs, and the end."""
    rows = []
    for cause in sorted(DIALOGS, key=list(TransitionCause).index):
        moves = [row for row in SESSION_TRANSITIONS.rows if row.cause is cause]
        starts = ", ".join(dict.fromkeys(f"`{row.start}`" for row in moves))
        (end,) = dict.fromkeys(f"`{row.end}`" if row.end else "the state before" for row in moves)
        rows.append(f"- `{cause}` leads from {starts} to {end}.")
    return "\n".join(rows)


if __name__ == "__main__":
    for file_name, what in DIAGRAMS.items():
        (Path(sys.argv[1]) / file_name).write_text(draw_diagram(what), encoding="utf-8", newline="\n")
