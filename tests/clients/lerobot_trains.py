"""`lerobot-train` learns ACT and Diffusion from every LeRobot export of a study, no backbone's weights being loaded.

    python tests/clients/lerobot_trains.py FOLDER/lerobot/plain [STEPS] [SEEDS]

Runs where only lerobot is installed. The mean loss of the last sixth of the steps is below that of the first sixth.
"""

import itertools
import os
import re
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

POLICIES = {
    "act": ("--policy.pretrained_backbone_weights=null", "--policy.dim_model=128", "--policy.chunk_size=8",
            "--policy.n_action_steps=8"),
    "diffusion": ("--policy.pretrained_backbone_weights=null", "--policy.crop_shape=null",
                  "--policy.down_dims=[64,128]", "--policy.drop_n_last_frames=0"),  # episodes may be short
}  # fmt: skip
EVALUATES = "eval_freq" if version("lerobot").startswith("0.4.") else "env_eval_freq"  # in an environment; none is here


def main(folder: Path, steps: int = 60, seeds: int = 1) -> None:
    """Raise where one does not."""
    roots = sorted(path.parent for path in folder.glob("*/meta"))
    assert roots, "nothing was exported"
    for seed, root, (policy, options) in itertools.product(range(seeds), roots, POLICIES.items()):
        losses = train(root, policy, options, steps, seed)
        sixth = max(1, len(losses) // 6)
        first, last = (sum(part) / len(part) for part in (losses[:sixth], losses[-sixth:]))
        assert last < first, f"{root.name}, {policy}, seed {seed}: loss {first:.3f} to {last:.3f}"
        print(f"{root.name}, {policy}, seed {seed}: loss {first:.3f} to {last:.3f}", flush=True)
    print(f"lerobot {version('lerobot')}: {len(roots)} datasets")


def train(root, policy, options, steps, seed):
    """The losses that are logged."""
    with tempfile.TemporaryDirectory() as out:
        command = [
            str(Path(sys.executable).with_name("lerobot-train")), f"--dataset.repo_id=minihuman/{root.name}",
            f"--dataset.root={root}", "--dataset.video_backend=pyav", f"--policy.type={policy}", "--policy.device=cpu",
            "--policy.push_to_hub=false", f"--output_dir={out}/run", f"--steps={steps}", "--batch_size=4",
            "--num_workers=0", "--log_freq=5", "--save_checkpoint=false", f"--{EVALUATES}=0", f"--seed={seed}",
            *options,
        ]  # fmt: skip
        environment = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": f"{out}/home"}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return [float(found) for found in re.findall(r" loss:([0-9.]+)", done.stderr + done.stdout)]


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
