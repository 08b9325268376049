"""Two people in two Chromiums on long, lossy lines: from a key to its picture, and to the partner's; what cuts lose.

    python -m benchmarks.team_latency [--episodes 20] [--steps 40] [--rtt 300] [--loss 0 0.02] [--ticks-ms 100]
    python -m benchmarks.team_latency --kills 100 --cuts 100 --reloads 50

Times are the logs': a key's of the page that heard it, a picture's of the page that showed it, both pages brought onto
the server's clock by the links of each log. In turns each person answers a step 200 to 600 ms after they saw it, in
ticks both press on; and a partner's step is counted where the partner's key came last, as before it there is nothing to
show. A lost segment delays what is behind it by a round trip and 200 ms.
"""

import argparse
import os
import random
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import minihuman
from minihuman.activities.team.events import InputLate, JointStepped, PictureCorrected, SeatTaken
from minihuman.experiment.machine.events import FrameShown, Stepped
from minihuman.log.read.reader import read_segment_starts
from tests.activities.team.browsers import Played, play_together
from tests.activities.team.study import FOUR_ROOMS, team_study

PLACE = tuple[int, int]  # episode and step
FRAME_MS = 1000 / 60
IN_A_GAME = 25  # interruptions; each game is compared at its end, so a run that is stopped counts for what it did


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--steps", type=int, default=40, help="per episode")
    parser.add_argument("--rtt", type=float, default=300.0)
    parser.add_argument("--loss", type=float, nargs="+", default=[0.0, 0.02], help="share of TCP segments")
    parser.add_argument("--ticks-ms", type=int, default=100)
    parser.add_argument("--press-on", action="store_true", help="in turns too, whether the last step was seen or not")
    for what in ("kills", "cuts", "reloads"):
        parser.add_argument(f"--{what}", type=int, default=0)
    asked = parser.parse_args()
    print(f"minihuman {minihuman.__version__}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    if asked.kills or asked.cuts or asked.reloads:
        interrupt({"kill": asked.kills, "cut": asked.cuts, "reload": asked.reloads})
        return
    for loss in asked.loss:
        for pace in ("turns", "ticks"):
            block = f'pace = "real_time"\nstep_period_ms = {asked.ticks_ms}' if pace == "ticks" else ""
            with tempfile.TemporaryDirectory() as name:
                study = {"episodes": asked.episodes, "max_steps": asked.steps, "block": block}
                protocol = team_study(Path(name), world=FOUR_ROOMS, **study)
                answers_s = (0.2, 0.6) if pace == "turns" and not asked.press_on else None
                played, _ = play_together(protocol, Path(name), rtt_ms=asked.rtt, loss=loss, answers_s=answers_s)
                found = measure(played, sorted((Path(name) / "duet").rglob("*.mcap")), in_turns=pace == "turns")
            for what, times_ms in found.items():
                at = "  ".join(f"{value:7.1f}" for value in np.percentile(times_ms, (50, 95, 99)))
                at_once = np.mean(np.array(times_ms) <= FRAME_MS + 4)
                print(
                    f"{pace} {asked.rtt:.0f} ms loss {loss:<5} {what:16} n {len(times_ms):5}  50/95/99 %: {at} ms, ",
                    end="",
                )
                print(f"{at_once:.0%} within a frame and 4 ms")
            print(f"{'':6}{describe(played)}", flush=True)


def interrupt(times: dict[str, int]) -> None:
    """Interrupt games of short episodes, a few times each; a line after each game says what holds so far.

    What a game ended too soon for is left to the next one.
    """
    chance, games, began_s = random.Random(3), 0, time.monotonic()
    left, happened, total, wrong = Counter(times), Counter[str](), Counter[str](), list[int]()
    while left:
        mine = Counter(chance.sample(sorted(left.elements()), min(IN_A_GAME, left.total())))
        games += 1
        with tempfile.TemporaryDirectory() as name:
            protocol = team_study(Path(name), world=FOUR_ROOMS, episodes=2 + mine.total() // 4, max_steps=10)
            played, found = play_together(protocol, Path(name), interruptions=mine, seed=games, moves_between=3)
        left, happened = left - found, happened + found
        one, other = played.joint
        good = one == other and not any((*played.lost, *played.complaints)) and all(held for _, held in played.teams)
        wrong += [] if good else [games]
        total.update(
            {
                "joint steps": len(one),
                "presses": sum(map(len, played.heard)),
                "lost": sum(map(len, played.lost)),
                "late": sum(played.count(InputLate)),
                "taken seats": sum(played.count(SeatTaken)),
            }
        )
        sums = ", ".join(f"{count} {what}" for what, count in total.items())
        print(
            f"{games} games, {time.monotonic() - began_s:.0f} s: {dict(happened)}; {sums}; not held: {wrong or 'none'}"
        )
        print("" if good else f"      {describe(played)}\n", end="", flush=True)


def describe(played: Played) -> str:
    """What two people's logs prove."""
    steps = [len(rows) for rows in played.joint]
    pairs = zip(*played.joint, strict=False)
    return (
        f"joint steps {steps}, {sum(one != other for one, other in pairs)} differ; verify says "
        f"{[*played.complaints, [text for text, good in played.teams if not good]]}; presses lost {played.lost}; "
        f"late {played.count(InputLate)}; corrected pictures {played.count(PictureCorrected)}"
    )


def measure(played: Played, logs: list[Path], *, in_turns: bool) -> dict[str, list[float]]:
    """Times in ms: from a key to the first picture of what it did, and to the partner's picture of it."""
    starts_ns = [int(next(iter(read_segment_starts(log, first=True).values()))) for log in logs]
    keys = [dict(list_keys(played, of, start)) for of, start in enumerate(starts_ns)]
    true, first = zip(*(list_pictures(played, of, start) for of, start in enumerate(starts_ns)), strict=True)
    own, partner = list[float](), list[float]()
    for of, other in ((0, 1), (1, 0)):
        for place, key_ns in keys[of].items():
            if place in first[of]:
                own.append((first[of][place] - key_ns) / 1e6)
            if place in true[other] and (not in_turns or key_ns >= keys[other].get(place, key_ns)):
                partner.append((true[other][place] - key_ns) / 1e6)
    return {"key to picture": own, "partner's step": partner}


def list_keys(played: Played, of: int, start_ns: int) -> Iterator[tuple[PLACE, int]]:
    """When the key of each step was pressed, ns since 1970; none of a step without one."""
    acted = {(event.episode, event.step) for event in played.events[of] if isinstance(event, JointStepped)}
    for event in played.events[of]:
        if isinstance(event, Stepped) and event.key and (event.episode, event.step) in acted:
            yield (event.episode, event.step), start_ns + event.key_t_ns


def list_pictures(played: Played, of: int, start_ns: int) -> tuple[dict[PLACE, int], dict[PLACE, int]]:
    """When the picture of each closed step was there, and when the first that showed it, perhaps before it was closed.

    A step whose early picture needed no correction has none of the first kind: what others did is not to be seen.
    """
    closed, true, first = dict[PLACE, int](), dict[PLACE, int](), dict[PLACE, int]()
    for event in played.events[of]:
        if isinstance(event, JointStepped):
            closed[event.episode, event.step] = event.t_ns
        elif isinstance(event, FrameShown | PictureCorrected):
            place = event.episode, event.step
            first[place] = min(first.get(place, event.flip_ns + start_ns), event.flip_ns + start_ns)
            if isinstance(event, FrameShown) and event.flip_ns >= closed.get(place, event.flip_ns + 1):
                true.setdefault(place, event.flip_ns + start_ns)
    return true, first


if __name__ == "__main__":
    main()
