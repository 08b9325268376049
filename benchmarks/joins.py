"""What a join costs where several servers share one database, and whether any slot is given out twice.

    python -m benchmarks.joins --people 10000 --servers 3 --taken 100000

The servers are processes with folders of their own; the database is a PostgreSQL server of this run. Each person opens
their link at one server, and every tenth opens it at a second one at the same time. The CPU is that of the servers, and
of the database beside it. What a server reads when it starts is not part of a join.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.web_load import GRID, KINDS, TOML
from minihuman.admin.enrolment_entries import open_enrolment_log, read_enrolled
from minihuman.admin.recruitment import ParticipantArrived, Recruitment, hash_link_token
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list
from minihuman.experiment.plan.participant_codes import format_participant_code
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.record.session_leases import Lease, SessionLeases
from minihuman.storage.lease import RENEWAL_INTERVAL_S, open_lease_table
from minihuman.storage.study_journals import URL_FILE_NAME
from minihuman.web.arrivals import Admission, Arrival, Arrivals
from tests.lab.database import database, fresh

TWICE = 10  # every so many people open their link at two servers
ADMITTED_LATER = "wait"  # what the second server says while the first one hosts the session


def make_protocol(participants: int) -> Protocol:
    """The study of the load benchmark, with that many slots and ten episodes."""
    grid = {"world": KINDS["grid"][0], "size": "[400, 300]", "actions": GRID, "computed": "page"}
    protocol = decode_protocol(TOML.format(**grid).replace("episodes = 1000", "episodes = 10").encode())
    return msgspec.structs.replace(protocol, study=msgspec.structs.replace(protocol.study, participants=participants))


def serve(folder: Path, participants: int) -> None:
    """Let the people of a file arrive, and print for each the slot or the refusal, and the CPU in ms."""
    protocol = make_protocol(participants)
    table = open_lease_table(folder / protocol.study.name)
    assert table is not None
    leases = SessionLeases(table)
    arrivals = Arrivals(protocol, folder, leases)
    tokens = (folder / "tokens.txt").read_text().split()
    began_s = time.process_time()
    arrivals.recruits.find_participant(hash_link_token(tokens[0]))  # the first look reads what is there
    read_enrolled(folder / protocol.study.name)
    allocation_sha256(build_allocation_list(protocol))
    print(f"ready {time.process_time() - began_s}", flush=True)
    sys.stdin.readline()
    hosted: list[Lease] = []
    threading.Thread(target=renew, args=[leases, hosted], daemon=True).start()
    answers = []
    for token in tokens:
        began_s = time.process_time()
        found = arrivals.arrive(Arrival(token))
        took_ms = (time.process_time() - began_s) * 1e3
        if isinstance(found, Admission) and found.lease is not None:
            hosted.append(found.lease)
        said = found.participant if isinstance(found, Admission) else found.reason
        answers.append(json.dumps([token, isinstance(found, Admission), said, took_ms]))
    print("\n".join(answers))


def renew(leases: SessionLeases, hosted: list[Lease]) -> None:
    """Keep the sessions of a server, as it does while people play."""
    while True:
        time.sleep(RENEWAL_INTERVAL_S)
        leases.renew([*hosted])


def fill(folder: Path, protocol: Protocol, taken: int, tokens: list[str]) -> None:
    """Write down those who came before, in one piece."""
    arrivals, study_dir = Arrivals(protocol, folder), folder / protocol.study.name
    arrivals.arrive(Arrival(tokens[0]))
    first = read_enrolled(study_dir)[0]
    codes = [format_participant_code(index) for index in range(1, taken)]
    with open_enrolment_log(study_dir).hold() as register:
        slots = (msgspec.structs.replace(first, index=n, participant=code) for n, code in enumerate(codes, 1))
        register.append(*slots)
    with arrivals.recruits.exclusive() as file:
        keys = map(hash_link_token, tokens[1:taken])
        file.journal.append(*(ParticipantArrived(key, code, first.at) for key, code in zip(keys, codes, strict=True)))


def database_cpu_s() -> float:
    """CPU seconds of every PostgreSQL process of this machine, those that ended with a connection left out."""
    spent = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, rest = stat.read_text().partition(") ")
        except OSError:
            continue
        if name.partition("(")[2] == "postgres":
            spent += sum(map(int, rest.split()[11:15]))
    return spent / 100


def main() -> None:
    """Run it, and print the counts and the CPU per join."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=10_000)
    parser.add_argument("--servers", type=int, default=3)
    parser.add_argument("--taken", type=int, default=1, help="slots, when they begin to come")
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    slots = asked.taken + asked.people
    if asked.serve:
        serve(asked.serve, slots)
        return
    protocol = make_protocol(slots)
    with tempfile.TemporaryDirectory(prefix="minihuman-") as name, database() as url:
        folders = [Path(name) / f"server-{number}" for number in range(asked.servers)]
        address = fresh(url)
        for folder in folders:
            folder.mkdir()
            (folder / URL_FILE_NAME).write_text(f"{address}\n")
        recruits = Recruitment(folders[0] / protocol.study.name)
        tokens = [token for begin in range(0, slots, 500) for token in recruits.issue(min(500, slots - begin))]
        fill(folders[0], protocol, asked.taken, tokens)
        people = tokens[asked.taken :]
        for number, folder in enumerate(folders):
            mine = [
                token
                for n, token in enumerate(people)
                if n % asked.servers == number or (n % TWICE == 0 and (n + 1) % asked.servers == number)
            ]
            (folder / "tokens.txt").write_text("\n".join(mine))
        words = ["--people", str(asked.people), "--taken", str(asked.taken)]
        servers = [
            subprocess.Popen(
                [sys.executable, "-m", "benchmarks.joins", "--serve", str(folder), *words],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for folder in folders
        ]
        start_s = 0.0
        for server in servers:
            assert server.stdout is not None
            start_s += float(server.stdout.readline().removeprefix("ready ")) / len(servers)
        before_s, began_s = database_cpu_s(), time.monotonic()
        for server in servers:
            assert server.stdin is not None
            server.stdin.write("\n")
            server.stdin.flush()
        answers = [json.loads(line) for server in servers for line in server.communicate()[0].splitlines()]
        took_s, theirs_s = time.monotonic() - began_s, database_cpu_s() - before_s
        enrolled = read_enrolled(folders[0] / protocol.study.name)
    admitted = Counter(token for token, is_admitted, _, _ in answers if is_admitted)
    slots_of = {token: said for token, is_admitted, said, _ in answers if is_admitted}
    refused = Counter(said for _, is_admitted, said, _ in answers if not is_admitted)
    unique = len({slot.index for slot in enrolled}) == len({slot.participant for slot in enrolled}) == len(enrolled)
    lost, doubled = len(set(people) - admitted.keys()), sum(count > 1 for count in admitted.values())
    shared = len(slots_of) - len(set(slots_of.values()))
    first_ms = [took_ms for _, is_admitted, _, took_ms in answers if is_admitted]
    median, p95 = np.percentile(first_ms, (50, 95))
    print(
        f"{len(people)} people at {asked.servers} servers, {asked.taken} slots taken before, {took_s:.0f} s; "
        f"{len(enrolled)} slots taken after, {'none' if unique else 'SOME'} twice; {lost} people without a slot, "
        f"{shared} slots with two people, {doubled} sessions at two servers; refused the second time: {dict(refused)}"
    )
    print(
        f"CPU to read what is there, once per server: {start_s:.1f} s\n"
        f"CPU per join: median {median:.1f} ms, 95 % {p95:.1f} ms, mean {np.mean(first_ms):.1f} ms; "
        f"of the database at the same time {theirs_s * 1e3 / len(first_ms):.1f} ms"
    )
    sys.exit(bool(lost or shared or doubled or not unique or set(refused) - {ADMITTED_LATER}))


if __name__ == "__main__":
    main()
