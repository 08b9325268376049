"""What it costs that a cache's rows are compared with their digests: commands that read, with and without, processor-s.

    python -m benchmarks.cache_digests [SESSIONS] [--rounds ROUNDS]

Eight sessions of the shipped study are played by simulated people, and each is written again as many other people's.
When the caches are made, every command runs in processes of its own, in turn as it is and with the comparison taken
out: digests of the tables' rows. The medians of all rounds are printed, and their ratio.
"""

import argparse
import shutil
import statistics
import tempfile
from pathlib import Path

from benchmarks.store import DIFFERENT, HERE, make, measure, run

AS_IT_IS = "from minihuman.cli import main; main()"
WITHOUT = f"""
from minihuman.dataset import store
store.TableDatabase.digest_rows = lambda self, name: {{}}
{AS_IT_IS}
"""


def main() -> None:
    """Make a study, and time every command on it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sessions", nargs="?", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=5)
    settings = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        protocol = HERE / "protocols" / "fourrooms-transfer.toml"
        run(HERE, "simulate", protocol, "--participants", DIFFERENT, "--data", folder / "played")
        played = sorted((folder / "played").rglob("*.mcap"))
        study = make(folder / "many" / "fourrooms-transfer", played, settings.sessions)
        out = folder / "out"
        commands = {
            "status": ("status", study),
            "query of sessions": ("query", study, "select count(*) from participants"),
            "query of steps": ("query", study, "select avg(reward) from steps"),
            "export csv": ("export", "csv", study, "--out", out),
            "report": ("report", study, "--out", out),
        }
        print(f"{settings.sessions} sessions, {settings.rounds} rounds; processor-s with digests, without, ratio")
        for told, command in commands.items():
            measure(HERE, "-c", AS_IT_IS, *command)  # makes the caches
            spent: dict[str, list[float]] = {AS_IT_IS: [], WITHOUT: []}
            for number in range(2 * settings.rounds):
                code = (AS_IT_IS, WITHOUT)[number % 2]
                shutil.rmtree(out, ignore_errors=True)
                spent[code].append(measure(HERE, "-c", code, *command)[0])
            ours, bare = (statistics.median(spent[code]) for code in (AS_IT_IS, WITHOUT))
            print(f"{told:18} {ours:6.2f} {bare:6.2f} {ours / bare:5.2f}", flush=True)


if __name__ == "__main__":
    main()
