"""The card: a README that says what an export holds, where it came from and what was left out."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from minihuman import __version__
from minihuman.data.counted import Account
from minihuman.export.port import Written


@dataclass(slots=True)
class Card:
    """Counts what passes on its way to an exporter."""

    format: str
    account: Account
    stored_frames: bool = False  # observations were taken from the logs
    counts: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def count(self, facts: Mapping[str, Any]) -> None:
        """Take an episode into the counts."""
        for name in ("study", "participant", "group", "player", "block", "world", "outcome", "protocol_sha256"):
            self.counts[name][str(facts[name])] += 1

    def write(self, out: Path, written: Written) -> Path:
        """Write the card into the export's folder."""
        path = out / "README.md"
        path.write_text(self._text(out, written))
        return path

    def _text(self, out: Path, written: Written) -> str:
        source = "stored in the logs" if self.stored_frames else "played again from seed and actions"
        lines = [
            f"# {self.format} export",
            "",
            f"{written.episodes} episodes, {written.steps} steps, written by minihuman {__version__}.",
            f"Observations, where the format holds them, were {source}, and each has the hash",
            "that was taken when it was made.",
            "",
            "What it is made of:",
            "",
            *(f"- {line}" for line in (*self.account.lines(), *written.left_out)),
            "",
            "| file or folder |",
            "|---|",
            *(f"| `{path.relative_to(out)}` |" for path in written.paths),
        ]
        for name, counter in self.counts.items():
            lines += ["", f"| {name} | episodes |", "|---|---|"]
            lines += [f"| {value} | {count} |" for value, count in sorted(counter.items())]
        return "\n".join(lines) + "\n"
