"""The time from a change in the builder's form until the preview beside it shows the change.

    python -m benchmarks.record builder-preview -- python -m benchmarks.builder_preview [--changes 60]

The instructions of a world are changed in `protocols/online.toml`, as one who types does. A change ends with the key
that leaves the field, or, for every other one, with its last key: the page saves a text when no key has come for a
while. Its end is the moment at which the text is in the preview's frame, which is looked at every 10 ms.
"""

import argparse
import shutil
import statistics
import tempfile
import time
from pathlib import Path

from tests.builder.hand import Hand, at_the_page

PROTOCOL = Path(__file__).parents[1] / "protocols" / "online.toml"
PART = "#/study/online.toml/parts/practice"
FIRST_TEXT = "This is a map."
LOOK_MS = 10
MEDIAN_S = 1.0  # that the median may take
PERCENTILE_95_S = 2.0
MOST_S = 60.0


def wait_for(hand: Hand, text: str) -> None:
    """Wait until a frame has a text.

    Raises:
        TimeoutError: if that takes a minute.
    """
    until_s = time.monotonic() + MOST_S
    while not any(text in hand.read_frame(frame) for frame in hand.page.frames[1:]):
        if time.monotonic() > until_s:
            raise TimeoutError(f"the preview does not show {text!r} after {MOST_S:.0f} s")
        hand.page.wait_for_timeout(LOOK_MS)


def measure(hand: Hand, address: str, n_changes: int) -> dict[str, list[float]]:
    """Return the seconds of each change, by how it ended."""
    hand.page.goto(address + PART)
    wait_for(hand, FIRST_TEXT)
    instructions = hand.page.get_by_label("Instructions", exact=True)
    durations_s: dict[str, list[float]] = {"leaving the field": [], "the last key": []}
    for number in range(n_changes):
        leaves = number % 2 == 0
        text = f"Change {number} of {n_changes}."
        instructions.press("Control+a")
        instructions.press_sequentially(text)
        begin_s = time.monotonic()
        if leaves:
            instructions.press("Tab")
        wait_for(hand, text)
        durations_s["leaving the field" if leaves else "the last key"].append(time.monotonic() - begin_s)
    return durations_s


def main() -> None:
    """Print the median and the 95th percentile; exit with 1 where leaving the field takes longer than it may."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--changes", type=int, default=60)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        shutil.copy(PROTOCOL, folder)
        with at_the_page(folder) as (hand, address):
            durations_s = measure(hand, address, arguments.changes)
    for end, times_s in durations_s.items():
        median_s = statistics.median(times_s)
        late_s = statistics.quantiles(times_s, n=20)[-1]
        print(f"from {end}: median {median_s:.2f} s, 95th percentile {late_s:.2f} s, of {len(times_s)} changes")
        if end == "leaving the field" and (median_s > MEDIAN_S or late_s > PERCENTILE_95_S):
            raise SystemExit(f"at most {MEDIAN_S} s at the median and {PERCENTILE_95_S} s at 95 % are allowed")


if __name__ == "__main__":
    main()
