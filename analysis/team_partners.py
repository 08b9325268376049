"""A study of partners in one kitchen: a person, the scripted cook, a clone of people, and an agent from self-play.

    python analysis/team_partners.py OUT [--teams 20] [--pilot 40] [--steps 2000000] [--player human-like]

Trains the agent by self-play, clones the pilot's people, plays `team_partners.toml` with so many teams a condition,
verifies every log, and writes report, exports and the table (`team_partners.md`) into OUT. Each step is a command of
minihuman; what lies in OUT already is not made again.
"""

import argparse
import resource
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import minihuman
from minihuman.admin.protocol_file import read_protocol
from minihuman.reporting.block_results import BlockResults
from minihuman.reporting.results import compute_results

PROTOCOL = Path(__file__).with_suffix(".toml")
WORLD = "minihuman/Team-CrampedRoom-v0"
AGENTS = "# Behind this line"  # in the protocol: what is before it makes the pilot
NAME = "team-partners"
EXPORTS = ("pettingzoo", "overcooked")


def main(out: Path, *, teams: int, pilot: int, steps: int, player: str, quick: bool) -> None:
    """Train, clone, simulate, verify, report, export."""
    out.mkdir(parents=True, exist_ok=True)
    text = PROTOCOL.read_text(encoding="utf-8").replace("participants = 100", f"participants = {5 * teams}")
    if quick:
        text = text.replace("max_steps = 200", "max_steps = 20")
    (out / "pilot.toml").write_text(text.partition(AGENTS)[0].replace(NAME, "pilot"), encoding="utf-8")
    (out / f"{NAME}.toml").write_text(text, encoding="utf-8")
    pilot_logs, logs = out / "pilot-logs", out / "logs"
    cpu_s = {
        "self-play": minihuman_once(out / "self-play.pt", "learn", "ppo", WORLD, "--steps", steps, "--worlds", 32),
        "pilot": simulate_once(pilot_logs, out / "pilot.toml", pilot, player),
        "clone": minihuman_once(
            *(out / "clone.pt", "learn", "clone", pilot_logs, "--world", WORLD, "--outcome", "timeout"),
            "--episodes",
            50,
        ),
        "study": simulate_once(logs, out / f"{NAME}.toml", 5 * teams, player),
        "verify": run_minihuman("verify", logs),
        "report": minihuman_once(out / "report", "report", logs / NAME),
        "exports": sum(minihuman_once(out / name, "export", name, logs / NAME) for name in EXPORTS),
    }
    table = "\n".join(describe(compute_kitchen(logs / NAME, out / f"{NAME}.toml"), cpu_s))
    (out / "team_partners.md").write_text(table + "\n", encoding="utf-8")
    print(table)


def simulate_once(data: Path, protocol: Path, people: int, player: str) -> float:
    """Play a protocol into a data folder, which has its name once all have played; the CPU-seconds."""
    unfinished = data.with_name(f"{data.name}-unfinished")
    if data.exists():
        return 0.0
    shutil.rmtree(unfinished, ignore_errors=True)
    cpu_s = run_minihuman("simulate", protocol, "--participants", people, "--player", player, "--data", unfinished)
    unfinished.rename(data)
    return cpu_s


def minihuman_once(made: Path, *arguments: object) -> float:
    """Run a command that writes ``made`` with --out, if it is not there; the CPU-seconds."""
    return 0.0 if made.exists() else run_minihuman(*arguments, "--out", made)


def run_minihuman(*arguments: object) -> float:
    """Run a command of minihuman; its CPU-seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "minihuman", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compute_kitchen(study: Path, protocol: Path) -> BlockResults:
    """What the report computes of the kitchen: a team of people is one unit."""
    opened = minihuman.open_study(study)
    episodes, blocks, people, teams = map(opened.table, ("episodes", "blocks", "participants", "teams"))
    [block] = compute_results(episodes, blocks, people, read_protocol(protocol).analysis, teams).blocks
    return block


def describe(block: BlockResults, cpu_s: dict[str, float]) -> Sequence[str]:
    """The conditions and their comparisons as Markdown."""
    reward = block.measures[block.measures["measure"] == "reward_mean"]
    compared = [one for one in block.comparisons if one.measure == "reward_mean"]
    return [
        "| partner | teams | reward an episode, mean (SD) |",
        "| --- | --- | --- |",
        *(f"| {row.group} | {row.n} | {row.mean:.1f} ({row.sd:.1f}) |" for row in reward.itertuples()),
        "",
        "| compared | difference [95 %] | p | p (Holm) |",
        "| --- | --- | --- | --- |",
        *(
            f"| {one.first} - {one.second} | {one.difference:.1f} [{one.interval[0]:.1f}, {one.interval[1]:.1f}] "
            f"| {one.p:.4f} | {one.p_holm:.4f} |"
            for one in compared
        ),
        "",
        "CPU-seconds: " + ", ".join(f"{name} {value:.0f}" for name, value in cpu_s.items()) + ".",
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--teams", type=int, default=20, help="per condition")
    parser.add_argument("--pilot", type=int, default=40, help="people, two a team")
    parser.add_argument("--steps", type=int, default=2_000_000, help="of self-play")
    parser.add_argument("--player", default="human-like")
    parser.add_argument("--quick", action="store_true", help="episodes of 20 steps")
    given = parser.parse_args()
    main(
        given.out,
        teams=given.teams,
        pilot=given.pilot,
        steps=given.steps,
        player=given.player,
        quick=given.quick,
    )
