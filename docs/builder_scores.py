"""Have Lighthouse score the builder's views, and exit with 1 where a score is under 95.

    python -m benchmarks.record builder-scores -- python docs/builder_scores.py

It needs Node and Chromium; npx fetches the version of Lighthouse that `check_site.py` names. Each view is scored as a
desktop's browser shows it; performance is of this machine, and is judged on one that has nothing else to do.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from builder_pictures import ROOT, serve_desk
from check_site import find_low_scores, score_page

CATEGORIES = "performance,accessibility,best-practices"
VIEWS = {
    "studies": "",
    "overview": "#/study/online.toml",
    "part": "#/study/online.toml/parts/practice",
    **{view: f"#/study/online.toml/{view}" for view in ("texts", "media", "data", "settings", "file")},
}


def main() -> None:
    """Print the scores of each view."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--any-speed", action="store_true", help="print performance, and judge the other scores alone")
    arguments = parser.parse_args()
    scores = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        shutil.copy(ROOT / "protocols" / "online.toml", folder)
        simulate = [sys.executable, "-m", "minihuman", "simulate", "online.toml", "--participants=1", "--data=sessions"]
        subprocess.run(simulate, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        with serve_desk(folder) as address:
            for name, view in VIEWS.items():
                scores[name] = score_page(address + view, "--preset=desktop", categories=CATEGORIES)
                print(name, scores[name], flush=True)
    judged = scores
    if arguments.any_speed:
        judged = {
            name: {category: score for category, score in by_category.items() if category != "performance"}
            for name, by_category in scores.items()
        }
    problems = find_low_scores(judged)
    print("\n".join(problems) or "every judged score is 95 or more")
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
