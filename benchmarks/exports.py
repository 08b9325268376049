"""What LeRobot and Minari exports cost beyond encoding the same frames, beside another checkout, in turn in one run.

    python -m benchmarks.exports STUDY [--against CHECKOUT] [--rounds N] [--out FILE]

Each checkout exports the study in a process of its own. "Bare" is the same software's least: the exported pictures are
encoded again by the same encoder, or the exported arrays written again by h5py, from memory. Prints processor-seconds,
the least of the rounds, and the share that this checkout needs beyond bare encoding of what the other one needs.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import av
import h5py

from benchmarks.verify import run_python
from minihuman.display.video import VideoWriter

HERE = Path(__file__).parents[1]
CODE = """
import sys, time
from pathlib import Path
import minihuman
study, form, first, out = sys.argv[1:]
minihuman.export(form, Path(study), Path(first))
began = time.process_time()
minihuman.export(form, Path(study), Path(out))
print(time.process_time() - began)
"""


def export(checkout: Path, study: Path, form: str, folder: Path) -> tuple[float, Path]:
    """Export a study twice, the second time measured; processor-seconds, and where it lies."""
    out = folder / "out"
    printed = run_python(checkout, "-c", CODE, study, form, folder / "first", out)
    return float(printed.splitlines()[-1]), out


def encode_videos(out: Path, folder: Path) -> float:
    """Encode the pictures of an export again; processor-seconds."""
    spent_s = 0.0
    for number, file in enumerate(sorted(out.rglob("*.mp4"))):
        with av.open(str(file)) as container:
            pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        began_s = time.process_time()
        with VideoWriter(folder / f"{number}.mp4", "dataset", fps=10) as writer:
            writer.write(pictures)
        spent_s += time.process_time() - began_s
    return spent_s


def read_arrays(path: Path) -> dict[str, Any]:
    """The arrays of an HDF5 file, by name."""
    arrays = {}

    def keep(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            arrays[name] = node[()]

    with h5py.File(path) as file:
        file.visititems(keep)
    return arrays


def write_arrays(out: Path, folder: Path) -> float:
    """Write the arrays of an export again; processor-seconds."""
    spent_s = 0.0
    for number, path in enumerate(sorted(out.rglob("*.hdf5"))):
        arrays = read_arrays(path)
        began_s = time.process_time()
        with h5py.File(folder / f"{number}.hdf5", "w") as file:
            for name, array in arrays.items():
                file.create_dataset(name, data=array)
        spent_s += time.process_time() - began_s
    return spent_s


def main() -> None:
    """Export and measure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("study", type=Path)
    parser.add_argument("--against", type=Path, default=None)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=None)
    arguments = parser.parse_args()
    checkouts = {"here": HERE} | ({"against": arguments.against} if arguments.against else {})
    record = {}
    for form, encode in (("lerobot", encode_videos), ("minari", write_arrays)):
        spent_s: dict[str, list[float]] = {name: [] for name in (*checkouts, "bare")}
        for _ in range(arguments.rounds):
            for name, checkout in checkouts.items():
                with tempfile.TemporaryDirectory() as folder:
                    export_s, out = export(checkout, arguments.study.resolve(), form, Path(folder))
                    spent_s[name].append(export_s)
                    spent_s["bare"].append(encode(out, Path(folder)))
        least = {name: round(min(times_s), 2) for name, times_s in spent_s.items()}
        if "against" in least:
            least["share"] = round((least["here"] - least["bare"]) / (least["against"] - least["bare"]), 2)
        record[form] = least
        print(form, least, flush=True)
    if arguments.out:
        arguments.out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
