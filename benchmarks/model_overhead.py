"""CPU time that a step of a model costs beside the model's own: screens drawn and packed, requests, log.

    python benchmarks/model_overhead.py [--sessions 32] [--latency-ms 300]

The endpoint is scripted and runs in a process of its own, so its time is not counted. All sessions are in flight
at once. A request is made durable before it is sent, together with the answer before it and with all others that wait:
how many syncs of a file or of a file system that takes is counted.
"""

import argparse
import json
import multiprocessing
import os
import platform
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

STUDY = """
[study]
name = "overhead"
version = "1"
seed = 1
participants = 1000
closing = ""
[model]
modality = "both"
size_px = [640, 480]
[keys]
keyboard_check = false
pool = ["1", "2", "3"]
[[groups]]
name = "all"
blocks = ["rooms"]
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = {steps}
"""


def serve(latency_s: float, port: "multiprocessing.SimpleQueue[int]") -> None:
    """Answer every request after the latency."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            time.sleep(latency_s)
            message = {"message": {"content": "Answer: 1"}, "finish_reason": "stop"}
            content = json.dumps({"model": "scripted", "choices": [message], "usage": {}}).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            pass

    class Server(ThreadingHTTPServer):
        request_queue_size = 256

    server = Server(("127.0.0.1", 0), Handler)
    port.put(server.server_port)
    server.serve_forever()


def measure(sessions: int, latency_ms: float, steps: int) -> None:
    """Print CPU and wall time per step."""
    import minihuman
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.log.record.disk import GroupCommit
    from minihuman.operating_system import sync_file, sync_file_system
    from minihuman.runtime.model_run import ModelRun
    from minihuman.runtime.model_sessions import simulate_models

    port: multiprocessing.SimpleQueue[int] = multiprocessing.SimpleQueue()
    endpoint = multiprocessing.Process(target=serve, args=(latency_ms / 1_000, port), daemon=True)
    endpoint.start()
    os.environ["OPENAI_BASE_URL"] = f"http://127.0.0.1:{port.get()}/v1"
    with tempfile.TemporaryDirectory() as folder:
        protocol = Path(folder) / "study.toml"
        for count in (1, sessions):  # the first compiles and imports
            protocol.write_text(STUDY.format(steps=steps if count > 1 else 2))
            began_s, cpu_s = time.perf_counter(), time.process_time()
            syncs = Counter[str]()

            def count_call(name: str, sync: Callable[[int], None]) -> Callable[[int], None]:
                return lambda fd: (syncs.update([name]), sync(fd))[1]  # noqa: B023 - read in this round only

            syncing = {"sync_one": count_call("file", sync_file), "sync_all": count_call("system", sync_file_system)}
            group = GroupCommit(**syncing, max_single_syncs=1)
            run = ModelRun.of_model("model:scripted", group_commit=group)
            study, data = read_protocol(protocol), Path(folder) / str(count)
            list(simulate_models(study, data, participants=count, parallel=count, run=run))
            wall_s, cpu_s = time.perf_counter() - began_s, time.process_time() - cpu_s
    endpoint.terminate()
    total = sessions * steps
    print(f"minihuman {minihuman.__version__}, Python {platform.python_version()}, {os.cpu_count()} cores")
    print(f"{sessions} sessions in flight, {total} steps of 640 x 480: {1e3 * cpu_s / total:.2f} CPU-ms a step")
    print(f"{2 * total} durable events by {syncs.total()} syncs ({dict(syncs)}): {syncs.total() / total:.2f} a call")
    print(f"{group.rounds} rounds, each of what was waiting then")
    print(f"{total / wall_s:.0f} steps/s; with answers of {latency_ms:g} ms at most {sessions * 1e3 / latency_ms:.0f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=32)
    parser.add_argument("--latency-ms", type=float, default=300.0)
    parser.add_argument("--steps", type=int, default=100)
    arguments = parser.parse_args()
    measure(arguments.sessions, arguments.latency_ms, arguments.steps)
