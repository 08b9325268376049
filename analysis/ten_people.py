"""What the human study of "Minigrid & Miniworld" could have found: its design, played by simulated people.

    python analysis/ten_people.py OUT [--people 200] [--studies 1000] [--processes 2]

The paper's ten people sat in two groups of five. A pool of simulated people plays its protocol's first-person block;
studies are drawn from them, one group's excess steps are shortened, and each study is put to the report's own tests.
Writes `ten_people_pool.csv`, what the people did (it is read where it is there already), `ten_people.csv` and the
figure `ten_people`.
"""

import argparse
import csv
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from minihuman.admin.protocol_file import find_shipped_protocol
from minihuman.figures.style import MUTED, PAGE_CM, SERIES, figure_style, save_figure
from minihuman.planning.power import (
    TWO_PARTS,
    Effect,
    ParticipantPool,
    PowerEstimate,
    compute_values,
    power_curve,
    simulate_pool,
)

SIZES = (5, 10, 20, 40)  # people a group; the paper had five
EFFECTS = (1.0, 0.7, 0.5, 0.3)  # what is left of the excess steps
ASKED = 0.7
MEASURES = ("log_excess_steps", "log_steps_ratio", "reward", "success", TWO_PARTS)
Row = tuple[float, PowerEstimate]  # with what is left of the excess steps


def main(out: Path, *, people: int, studies: int, processes: int | None) -> None:
    out.mkdir(parents=True, exist_ok=True)
    pool = pool_of(out / "ten_people_pool.csv", people, processes)
    rows = [*rows_of(pool, EFFECTS, SIZES[:1], studies), *rows_of(pool, (ASKED,), SIZES[1:], studies)]
    with (out / "ten_people.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("measure", "excess_left", "participants_a_group", "power", "low", "high", "studies", "people"))
        for left, one in rows:
            table.writerow(
                (one.measure, left, one.participants, one.power, one.low, one.high, one.studies, pool.people)
            )
    print("\n".join(told(rows)))
    print(*save_figure(figure(rows), out / "ten_people"), sep="\n")


def pool_of(kept: Path, people: int, processes: int | None) -> ParticipantPool:
    """The people: read, or played and written."""
    if not kept.exists():
        toml = find_shipped_protocol("fourrooms-transfer").read_bytes()
        played = simulate_pool(toml, people=people, player="human-like", seed=1, processes=processes)
        played.episodes.to_csv(kept, index=False)
    episodes = pd.read_csv(kept)
    return ParticipantPool(str(episodes["block"].iloc[0]), str(episodes["group"].iloc[0]), episodes)


def rows_of(pool: ParticipantPool, effects: tuple[float, ...], sizes: tuple[int, ...], studies: int) -> list[Row]:
    """Power of every measure, effect and size."""
    found = list[Row]()
    for left in effects:
        changed = Effect(left).of(pool.episodes)
        for measure in MEASURES:
            treated, untreated = compute_values(changed, measure), compute_values(pool.episodes, measure)
            found += [(left, one) for one in power_curve(measure, treated, untreated, sizes, studies=studies, seed=1)]
    return found


def told(rows: list[Row]) -> list[str]:
    """The share of studies of five a group that find each effect, and of more people the one that is asked for."""
    lines = [f"{'five a group; left of the excess steps':<40}" + "".join(f"{left:>8.1f}" for left in EFFECTS)]
    for measure in MEASURES:
        at = {left: one.power for left, one in rows if one.measure == measure and one.participants == SIZES[0]}
        lines.append(f"{measure:<40}" + "".join(f"{at[left]:>8.2f}" for left in EFFECTS))
    lines.append(f"{f'{ASKED:g} left; people a group':<40}" + "".join(f"{size:>8}" for size in SIZES))
    for measure in MEASURES:
        at = {float(one.participants): one.power for left, one in rows if one.measure == measure and left == ASKED}
        lines.append(f"{measure:<40}" + "".join(f"{at[float(size)]:>8.2f}" for size in SIZES))
    return lines


def figure(rows: list[Row]) -> Figure:
    """Power over the effect with five a group, and over people a group for one effect."""
    with figure_style():
        drawn = Figure(figsize=(PAGE_CM / 2.54, 6.6 / 2.54), layout="constrained")
        over_effect, over_size = drawn.subplots(1, 2, sharey=True)
        fewest = [(left, one) for left, one in rows if one.participants == SIZES[0]]
        draw(over_effect, [(100 * (1 - left), one) for left, one in fewest])
        draw(over_size, [(float(one.participants), one) for left, one in rows if left == ASKED])
        over_effect.set(xlabel="fewer excess steps in one group (%), 5 + 5 people", ylabel="power", ylim=(0, 1.02))
        over_size.set(xlabel=f"people a group, {100 * (1 - ASKED):.0f} % fewer excess steps")
        drawn.legend(*over_effect.get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return drawn


def draw(axes: Axes, points: list[Row]) -> None:
    """A line a measure, with its Monte Carlo interval; dotted what is usually asked for, and the tests' own error."""
    for place, measure in enumerate(MEASURES):
        at = sorted((x, one.power, one.low, one.high) for x, one in points if one.measure == measure)
        x, power, low, high = zip(*at, strict=True)
        axes.fill_between(x, low, high, color=SERIES[place], alpha=0.2, lw=0)
        axes.plot(x, power, "osv^D"[place], ls="-", ms=3, color=SERIES[place], label=measure.replace("_", " "))
    for level in (0.8, 0.05):
        axes.axhline(level, color=MUTED, linewidth=0.6, linestyle=":")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--people", type=int, default=200)
    parser.add_argument("--studies", type=int, default=1000)
    parser.add_argument("--processes", type=int)
    arguments = parser.parse_args()
    main(arguments.out, people=arguments.people, studies=arguments.studies, processes=arguments.processes)
