"""The shipped transfer study: one small file a job, put together with whatever runs are named, and its table.

    python analysis/transfer.py [FOLDER ...] [--into OUT]

Results of finished jobs are copied into `analysis/transfer/`, so that anyone can add runs; table, curves, speed and
figure are written beside them, as `minihuman learn report` does.
"""

import argparse
import shutil
from pathlib import Path

from minihuman.learn.transfer.folder import open_folder, read_merged
from minihuman.learn.transfer.job import RESULT
from minihuman.learn.transfer.published import beside_of
from minihuman.learn.transfer.summary import Run, write_report


def main(folders: list[Path], shipped: Path) -> None:
    held = [shipped] if shipped.exists() else []
    study, results = read_merged([*held, *folders])
    open_folder(study, shipped)
    for job in results:
        found = next(folder for folder in [*held, *folders] if (folder / job.name / RESULT).exists())
        if found != shipped:
            (shipped / job.name).mkdir(parents=True, exist_ok=True)
            shutil.copyfile(found / job.name / RESULT, shipped / job.name / RESULT)
    command = "python analysis/transfer.py"
    print(
        write_report(
            study, results, shipped, Run(command=command, engine="", wall_s=0.0), beside=beside_of(study, None)
        )
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--into", type=Path, default=Path(__file__).parent / "transfer")
    arguments = parser.parse_args()
    main(arguments.folders, arguments.into)
