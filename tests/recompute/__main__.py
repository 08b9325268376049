"""Compare a folder of outputs with a study's logs, and print a line for each output.

``python -m tests.recompute STUDY OUT [NAME ...]``: ``OUT`` holds a folder for each output, as ``play.write_outputs``
makes them. The last line is the same as JSON.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path

from tests.recompute.exports import (
    Logs,
    compare_bids,
    compare_lerobot,
    compare_minari,
    compare_notebook,
    compare_queries,
    compare_tables,
)
from tests.recompute.methods import check_methods
from tests.recompute.page import Study, compare_page
from tests.recompute.tables import TABLES, Tally, read_csv, read_sessions, read_told, recompute


def main(study: Path, out: Path, names: list[str]) -> bool:
    sessions = read_sessions(study)
    told = read_told(read_csv(out / "query" / "episodes.csv")) if (out / "query").exists() else {}
    tables = recompute(sessions, told)
    logs = Logs(sessions, tables)

    def report(folder: Path, tally: Tally) -> None:
        for name in (name for name in TABLES if (folder / "tables" / f"{name}.csv").exists()):
            tally.rows(f"report {name}", read_csv(folder / "tables" / f"{name}.csv"), tables[name], is_whole=True)
        methods = compare_page(Study(study, sessions, tables), folder / "report.html", tally)
        lines = [json.loads(line) for line in (study / "register.jsonl").read_text().splitlines()]
        counts = check_methods(methods, sessions, [line for line in lines if "format" not in line])
        tallies["methods"] = counts

    checks: dict[str, Callable[[Path, Tally], None]] = {
        "report": report,
        "query": lambda folder, tally: compare_queries(logs, folder, tally),
        "notebook": lambda folder, tally: compare_notebook(logs, folder / "notebook.json", tally),
        "csv": lambda folder, tally: compare_tables(logs, folder, tally),
        "parquet": lambda folder, tally: compare_tables(logs, folder, tally),
        "minari": lambda folder, tally: compare_minari(logs, folder, tally),
        "lerobot": lambda folder, tally: compare_lerobot(logs, folder, tally),
        "bids": lambda folder, tally: compare_bids(logs, folder, tally),
    }
    tallies: dict[str, Tally] = {}
    for name, check in checks.items():
        if names and name not in names:
            continue
        tallies[name] = Tally()
        check(out / name, tallies[name])
    for name, tally in tallies.items():
        print(f"{study.name} {name}: {tally.compared} compared, {len(tally.wrong)} wrong")
        for line in tally.wrong[:20]:
            print(f"  {line[:600]}")
    print(json.dumps({name: [tally.compared, len(tally.wrong)] for name, tally in tallies.items()}))
    return any(tally.wrong for tally in tallies.values())


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]))
