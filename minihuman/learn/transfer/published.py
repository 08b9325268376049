"""Published improvements, to set one's own beside.

Chevalier-Boisvert et al. (2023), "Minigrid & Miniworld", table of the transfer study: mean and standard deviation over
ten runs of 200,000 steps. Four of its twelve cells are here, as they were quoted to this project; the other eight could
not be had at first hand and are left out rather than read off a figure.
"""

from importlib.resources import files
from pathlib import Path

import pandas as pd

from minihuman.errors import LearnError
from minihuman.learn.transfer.plan import Study

SOURCE = "Chevalier-Boisvert et al. (2023), Minigrid & Miniworld; four of its twelve cells"
STEPS = 200_000  # the published runs'; an area over fewer steps is not the same measure


def shipped() -> pd.DataFrame:
    """One row a cell that is known: improvement and sd, as fractions."""
    with (files("minihuman.learn.transfer") / "data" / "published.csv").open() as file:
        return pd.read_csv(file, index_col="cell")


def beside_of(study: Study, path: Path | None) -> pd.DataFrame | None:
    """What to set beside a study: the file's, or the paper's where the study has as many steps; else nothing.

    Raises:
        LearnError: as ``read_published``.
    """
    if path is not None:
        return read_published(path)
    return shipped() if study.steps == STEPS and not study.quick else None


def read_published(path: Path) -> pd.DataFrame:
    """Published improvements from a CSV with columns cell and improvement (fractions), and sd where it is known.

    Raises:
        LearnError: if the file is missing or lacks a column.
    """
    try:
        found = pd.read_csv(path).set_index("cell")
        found["improvement"].astype(float)
    except FileNotFoundError:
        raise LearnError(f"{path} is not there; --beside takes a CSV with columns cell and improvement") from None
    except (KeyError, ValueError) as error:
        raise LearnError(f"{path}: {error}; --beside takes a CSV with columns cell and improvement") from None
    return found.reindex(columns=["improvement", "sd"])
