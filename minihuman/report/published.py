"""The published study's subject means, to set one's own beside.

Chevalier-Boisvert et al. (2023), "Minigrid & Miniworld": mean reward of each subject in Miniworld's four rooms.
"""

from importlib.resources import files

import pandas as pd

SOURCE = "Chevalier-Boisvert et al. (2023), Minigrid & Miniworld"


def published() -> pd.DataFrame:
    """One row a subject: group, subject, reward_mean."""
    with (files("minihuman.report") / "data" / "published.csv").open() as file:
        return pd.read_csv(file)
