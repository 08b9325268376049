"""The published study's subject means, to set one's own beside.

Chevalier-Boisvert et al. (2023), "Minigrid & Miniworld": mean reward of each subject in Miniworld's four rooms.
"""

from importlib.resources import files

import pandas as pd

_WORLDS = frozenset({"MiniGrid-FourRooms-v0", "MiniWorld-FourRooms-v0"})
SOURCE = "Chevalier-Boisvert et al. (2023), Minigrid & Miniworld"


def published() -> pd.DataFrame:
    """One row a subject: group, subject, reward_mean."""
    with (files("minihuman.report") / "data" / "published.csv").open() as file:
        return pd.read_csv(file)


def is_papers(study: str, worlds: frozenset[str]) -> bool:
    """Whether a study is the published one, by its name and the worlds it is played in, ours or upstream's."""
    names = {world.rpartition(":")[2].rpartition("/")[2] for world in worlds}
    return study.endswith("transfer") and names == _WORLDS
