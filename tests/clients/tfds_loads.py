"""TensorFlow Datasets builds every RLDS export from its folder alone. Runs without minihuman."""

import sys
from importlib.metadata import version
from pathlib import Path

import tensorflow_datasets as tfds


def main(folder: Path) -> None:
    """Raise where one does not."""
    roots = sorted((folder / "rlds").glob("*/*/1.0.0"))
    assert roots, "nothing was exported"
    for root in roots:
        builder = tfds.builder_from_directory(str(root))
        steps = 0
        for episode in builder.as_dataset(split="train"):
            rows = list(episode["steps"].as_numpy_iterator())
            assert [row["is_last"] for row in rows] == [False] * (len(rows) - 1) + [True]
            assert rows[0]["is_first"]
            assert all(row["action"].sum() == 1 for row in rows[:-1])
            assert rows[0]["observation"]["image"].ndim == 3
            steps += len(rows) - 1
        print(f"{root.parts[-3]}/{root.parts[-2]}: {builder.info.splits['train'].num_examples} episodes, {steps} steps")
    print(f"tensorflow-datasets {version('tensorflow-datasets')}: {len(roots)} datasets")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
