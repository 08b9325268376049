"""LeRobot's own dataset class loads every LeRobot export and yields a batch. Runs where only lerobot is installed."""

import os
import sys
from importlib.metadata import version
from pathlib import Path

os.environ["HF_HUB_OFFLINE"] = "1"

import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset


def main(folder: Path) -> None:
    """Raise where one does not."""
    roots = sorted(path.parent for path in (folder / "lerobot").glob("*/*/meta"))
    assert roots, "nothing was exported"
    for root in roots:
        dataset = LeRobotDataset(f"minihuman/{root.name}", root=root, video_backend="pyav")  # torchcodec needs FFmpeg
        batch = next(iter(torch.utils.data.DataLoader(dataset, batch_size=4)))
        assert batch["action"].shape == (4, len(dataset.features["action"]["names"]))
        assert batch["observation.state"].shape[0] == 4
        assert {"min", "max", "mean", "std", "q01", "q99"} <= set(dataset.meta.stats["action"])
        print(f"{root.parent.name}/{root.name}: {len(dataset)} frames, task {batch['task'][0]!r}")
    print(f"lerobot {version('lerobot')}, torch {torch.__version__}: {len(roots)} datasets")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
