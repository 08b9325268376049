"""Write the live gallery: worlds played from static files alone, by `python docs/gallery_live.py [FOLDER]`."""

import argparse
import shutil
from collections.abc import Collection
from pathlib import Path

from minihuman.web import world_pack


def write_gallery(folder: Path, seeds: int = 100, names: Collection[str] = ()) -> int:
    """Write the gallery into a folder; how many worlds it has.

    ``names`` are the worlds to write; none: all that a page can compute. Of those that no page can lay out, it has the
    first states of so many seeds.
    """
    shutil.copytree(Path(__file__).parent / "gallery-live", folder, dirs_exist_ok=True)
    package = Path(world_pack.__file__).parents[1]
    shutil.copy(package / "builder" / "page" / "level.js", folder)  # a level is the same in the builder
    return len(world_pack.pack_worlds(folder, range(seeds), names).worlds)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("site"))
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--worlds", nargs="+", default=(), help="Only these.")
    given = parser.parse_args()
    count = write_gallery(given.folder, given.seeds, given.worlds)
    size = sum(path.stat().st_size for path in given.folder.rglob("*") if path.is_file())
    print(f"{count} worlds, {size / 1e6:.1f} MB in {given.folder}")
