"""A notebook to begin with, beside a study: it simulates participants, and looks at their tables and pictures."""

import json
from typing import Any

_SIMULATE = """\
from pathlib import Path

import minihuman

simulated = Path("simulated")  # apart from the data of people
if not simulated.exists():
    list(minihuman.simulate("{name}.toml", data=simulated, participants=4, player="random"))
study = minihuman.open_study(simulated / "{name}")
study"""
_AVERAGE = """\
episodes = study.table("episodes")
episodes.groupby("participant")[["reward", "playing_s"]].mean()"""
_DRAW = """\
session = study["sub-01"]
session.figure("paths")"""
_REDRAW = """\
frames = session.episodes[0].frames()  # what was seen, drawn again and verified
len(frames), frames[0].shape"""
_CELLS = (
    ("markdown", "# {name}\n\nFour simulated participants; those of people are in `sessions`."),
    *(("code", source) for source in (_SIMULATE, _AVERAGE, _DRAW, _REDRAW)),
)


def format_notebook(name: str) -> str:
    """Return the text of a notebook (nbformat 4) that simulates participants of a study and analyses their data.

    The notebook reads the protocol ``NAME.toml`` from the folder in which it runs.

    Args:
        name: the study's name.
    """
    cells: list[dict[str, Any]] = []
    for number, (kind, source) in enumerate(_CELLS):
        text = source.replace("{name}", name)
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": text}
        if kind == "code":
            cell |= {"execution_count": None, "outputs": []}
        cells.append(cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
