"""The shipped transfer study as data: table, curves, speed and how it was run, from a study's folder.

    python analysis/transfer.py STUDY_FOLDER [OUT]

Jobs that have not finished are in the curves as far as they came, marked so, and in nothing else.
"""

import json
import sys
from pathlib import Path

import pandas as pd
import torch

from minihuman.learn.agent.policy_file import versions
from minihuman.learn.transfer.folder import STUDY, read_results
from minihuman.learn.transfer.job import CHECKPOINT
from minihuman.learn.transfer.plan import Ppo, Study
from minihuman.learn.transfer.summary import curves, speed, table


def main(folder: Path, out: Path) -> None:
    settings = json.loads((folder / STUDY).read_text())
    study = Study(
        **settings | {"ppo": Ppo(**settings["ppo"]), "transfers": tuple(settings["transfers"])},
    )
    results = read_results(study, folder)
    points = curves(results).assign(finished=True)
    for job in study.jobs():
        checkpoint = folder / job.name / CHECKPOINT
        if job not in results and checkpoint.exists():
            history = torch.load(checkpoint, weights_only=False)["history"]
            rows = [(job.cell.label, job.run, job.seed, p.steps, p.reward, p.length, False) for p in history.points]
            points = pd.concat([points, pd.DataFrame(rows, columns=points.columns)])
    table(study, results).to_csv(out / "transfer_table.csv", float_format="%.6g")
    speed(results).to_csv(out / "transfer_speed.csv", float_format="%.6g")
    points.to_csv(out / "transfer_curves.csv", index=False, float_format="%.6g")
    facts = {
        "study": study.as_dict(),
        "finished": {job.name: {"seed": job.seed, "seconds": result.seconds} for job, result in results.items()},
        "jobs": len(study.jobs()),
        "versions": versions(),
    }
    (out / "transfer_run.json").write_text(json.dumps(facts, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent)
