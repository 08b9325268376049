"""How long a session's replay takes to write, against logging the same step by step in the same run.

    python -m benchmarks.replay [LOG...]

Without a log it makes a ten-episode session of the length people need. Each way runs five times, its saved layout
included; the best is printed.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rerun as rr

from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.replay.recording import build_layout, save_recording
from minihuman.replay.rerun_scene import AGENT, PATH, TRAIL, WALL, build_facts_page
from tests.builders import session

REPEATS = 5


def step_by_step(log: SessionLog, path: Path) -> None:
    """The same replay with one ``rr.log`` a thing and step."""
    recording = rr.RecordingStream("minihuman")
    recording.save(path, default_blueprint=build_layout([log], with_view=False))
    recording.log("facts", rr.TextDocument(build_facts_page(log), media_type=rr.MediaType.MARKDOWN), static=True)
    count = 0
    for episode in log.episodes:
        floor = episode.start.map
        recording.set_time("episode", sequence=episode.plan.episode + 1)
        recording.set_time("step", sequence=count)
        recording.set_time("session_time", duration=np.timedelta64(int(episode.t_ns[0]), "ns"))
        if floor is not None:
            recording.log("map/walls", rr.LineStrips2D(np.reshape(floor.walls, (-1, 2, 2)), colors=WALL))
            places = [(thing.x, thing.z) for thing in floor.things]
            recording.log("map/things", rr.Points2D(places, labels=[thing.name for thing in floor.things]))
        walked: list[tuple[float, float]] = []
        for row, (x, _, z, yaw) in enumerate(episode.poses):
            recording.set_time("step", sequence=count)
            recording.set_time("session_time", duration=np.timedelta64(int(episode.t_ns[row]), "ns"))
            recording.log(
                "map/agent", rr.Arrows2D(origins=[(x, z)], vectors=[(np.cos(yaw), -np.sin(yaw))], colors=AGENT)
            )
            if not walked or walked[-1] != (x, z):
                walked.append((x, z))
                recording.log("map/path", rr.LineStrips2D([walked], colors=PATH))
                recording.log("map/trail", rr.LineStrips2D([walked[-13:]], colors=TRAIL))
            recording.log("return", rr.Scalars(float(episode.rewards[:row].sum())))
            if row:
                recording.log("reward", rr.Scalars(float(episode.rewards[row - 1])))
                recording.log("reaction_ms", rr.Scalars(float(episode.rt_ms[row - 1])))
            count += 1
        for press in episode.keys:
            recording.set_time("session_time", duration=np.timedelta64(press.t_ns, "ns"))
            recording.log(f"keys/{press.key}", rr.StateChange(state=press.verdict if press.down else ""))
            if press.down:
                recording.log("events", rr.TextLog(f"key {press.key}: {press.verdict}"))
    recording.flush()
    recording.disconnect()


def best_s(work: Callable[[], object]) -> tuple[float, float]:
    """The shortest of a few runs, seconds: on the clock, and of the processors."""
    took, spent = [], []
    for _ in range(REPEATS):
        began, used = time.perf_counter(), time.process_time()
        work()
        took.append(time.perf_counter() - began)
        spent.append(time.process_time() - used)
    return min(took), min(spent)


def main() -> None:
    """Time both ways for each log and print them."""
    logs = [read_log(Path(name)) for name in sys.argv[1:]] or [session(episodes=5)]
    with tempfile.TemporaryDirectory() as folder:
        for log in logs:
            steps = sum(len(episode.actions) for episode in log.episodes)
            columns_s, columns_cpu_s = best_s(lambda log=log: save_recording([log], Path(folder) / "columns.rrd"))
            stepwise_s, stepwise_cpu_s = best_s(lambda log=log: step_by_step(log, Path(folder) / "steps.rrd"))
            print(f"{log.plan.participant.id}: {len(log.episodes)} episodes, {steps} steps")
            print(f"  replay, column by column: {columns_s:.3f} s ({columns_cpu_s:.3f} processor-seconds)")
            print(f"  replay, step by step:     {stepwise_s:.3f} s ({stepwise_cpu_s:.3f} processor-seconds)")
            print(f"  {stepwise_s / columns_s:.0f} and {stepwise_cpu_s / columns_cpu_s:.0f} times longer")


if __name__ == "__main__":
    main()
