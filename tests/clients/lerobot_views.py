"""`lerobot-dataset-viz --save` writes the first episode of every LeRobot export; rerun reads in it what was exported.

    python tests/clients/lerobot_views.py FOLDER

Runs where only lerobot with its viewer is installed. LeRobot must take each feature for what it is: one action, one
state, one picture.
"""

import os
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

os.environ["HF_HUB_OFFLINE"] = "1"

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

try:
    from lerobot.utils.feature_utils import dataset_to_policy_features
except ImportError:  # lerobot 0.4
    from lerobot.datasets.utils import dataset_to_policy_features


def main(folder: Path) -> None:
    """Raise where one is not."""
    roots = sorted(path.parent for path in (folder / "lerobot").glob("*/*/meta"))
    assert roots, "nothing was exported"
    for root in roots:
        dataset = LeRobotDataset(f"minihuman/{root.name}", root=root, video_backend="pyav")
        kinds = {key: its.type.name for key, its in dataset_to_policy_features(dataset.features).items()}
        pictures = dict.fromkeys(dataset.meta.camera_keys, "VISUAL")
        assert pictures, root
        assert kinds == {"action": "ACTION", "observation.state": "STATE"} | pictures, kinds
        frames = [dataset[row] for row in range(int(dataset.meta.episodes[0]["length"]))]
        found = save(root)
        for entity, feature in (("action", "action"), ("state", "observation.state")):
            expected = np.array([frame[feature].numpy() for frame in frames], np.float64)
            names = [f"/{entity}"] if f"/{entity}" in found else [f"/{entity}/{n}" for n in range(expected.shape[1])]
            assert np.array_equal(np.hstack([found[name] for name in names]), expected), f"{root}: {feature}"
        assert {len(found[f"/{key}"]) for key in pictures} == {len(frames)}, f"{root}: pictures"
        print(f"{root.parent.name}/{root.name}: {len(frames)} frames, {len(found)} entities", flush=True)
    print(f"lerobot {version('lerobot')}, rerun-sdk {version('rerun-sdk')}: {len(roots)} datasets")


def save(root: Path) -> dict[str, list[list[float]]]:
    """The first episode as the command saves it: an entity's values in each frame."""
    with tempfile.TemporaryDirectory() as out:
        command = [
            str(Path(sys.executable).with_name("lerobot-dataset-viz")), f"--repo-id=minihuman/{root.name}",
            f"--root={root}", "--episode-index=0", "--save=1", f"--output-dir={out}", "--num-workers=0",
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        [path] = Path(out).glob("*.rrd")
        return read(path)


def read(path: Path) -> dict[str, list[list[float]]]:
    """What rerun reads in a recording, in order of frame."""
    try:
        from rerun.experimental import RrdReader
    except ImportError:  # rerun 0.26, which lerobot 0.4 brings
        from rerun.dataframe import load_recording

        table = load_recording(path).view(index="frame_index", contents="/**").select().read_all()
        columns = [(name.split(":")[0], name, table) for name in table.schema.names if name.startswith("/")]
    else:
        chunks = [(str(chunk.entity_path), chunk.to_record_batch()) for chunk in RrdReader(path).stream().to_chunks()]
        columns = [(entity, name, table) for entity, table in chunks for name in table.schema.names]
    found: dict[str, list[tuple[int, list[float]]]] = {}
    for entity, name, table in columns:  # of a long episode an entity has several chunks
        if name.endswith(("Scalars:scalars", "Image:buffer")):
            rows = zip(table.column("frame_index").to_pylist(), table.column(name).to_pylist(), strict=True)
            found.setdefault(entity, []).extend(rows)
    return {entity: [values for _, values in sorted(rows)] for entity, rows in found.items()}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
