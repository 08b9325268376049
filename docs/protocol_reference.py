"""Write the tables of protocols/README.md from the protocol's schema: python docs/protocol_reference.py."""

import re
from pathlib import Path

from minihuman.experiment.protocol.protocol import list_protocol_tables

README = Path(__file__).parents[1] / "protocols" / "README.md"
_PLACE = re.compile(r"(<!-- fields of ([\w.]+) -->\n).*?(<!-- end of fields -->)", re.DOTALL)


def write_tables(text: str) -> str:
    """Fill each place of a text that is marked for a table's fields.

    Raises:
        KeyError: if a place is for no table.
    """
    tables = list_protocol_tables()
    return _PLACE.sub(lambda found: f"{found[1]}{_format_fields(*tables[found[2]])}\n{found[3]}", text)


def _format_fields(_: str, fields: list) -> str:
    lines = ["| field | type | default | meaning | example |", "|---|---|---|---|---|"]
    lines += [f"| `{one.name}` | {one.type} | {one.default} | {one.meaning} | `{one.example}` |" for one in fields]
    return "\n".join(lines)


if __name__ == "__main__":
    README.write_text(write_tables(README.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")
