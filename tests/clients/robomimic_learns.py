"""robomimic's own dataset class reads every robomimic export, and its behaviour cloning learns from one. Runs without
minihuman.
"""

import sys
from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np
import robomimic.utils.obs_utils as obs_utils
import torch
from robomimic.algo import algo_factory
from robomimic.config import config_factory
from robomimic.utils.dataset import SequenceDataset


def main(folder: Path) -> None:
    """Raise where it does not."""
    paths = sorted((folder / "robomimic").glob("*/*.hdf5"))
    assert paths, "nothing was exported"
    for path in paths:
        learn(path)
    print(f"robomimic {version('robomimic')}: {len(paths)} datasets")


def learn(path):
    """Clone from the state; the last losses are below the first."""
    config = config_factory("bc")
    config.observation.modalities.obs.low_dim = ["state"]
    config.lock()
    obs_utils.initialize_obs_utils_with_config(config)
    with h5py.File(path) as file:
        demo = file["data/demo_0"]
        width, actions = demo["obs/state"].shape[1], demo["actions"].shape[1]
    dataset = SequenceDataset(
        hdf5_path=str(path), obs_keys=["state"], dataset_keys=["actions", "rewards", "dones"], seq_length=1
    )
    torch.manual_seed(0)
    model = algo_factory("bc", config, obs_key_shapes={"state": [width]}, ac_dim=actions, device=torch.device("cpu"))
    model.set_train()
    losses = []
    loader = torch.utils.data.DataLoader(dataset, batch_size=16, shuffle=True)
    for epoch in range(12):
        for batch in loader:
            given = model.postprocess_batch_for_training(
                model.process_batch_for_training(batch), obs_normalization_stats=None
            )
            losses.append(float(model.train_on_batch(given, epoch=epoch)["losses"]["action_loss"]))
    half = max(1, len(losses) // 4)
    first, last = np.mean(losses[:half]), np.mean(losses[-half:])
    assert last < first, f"{path.name}: loss {first:.3f} to {last:.3f}"
    print(f"{path.parent.name}/{path.name}: {len(dataset)} steps, loss {first:.3f} to {last:.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
