"""One run of a study under faults, from a seed, and what must be true of it afterwards.

A run has one server, or two on machines of their own that share a database and lease sessions from it, and a few
participants, whose pages come to either. Something goes wrong a few times, at moments that the seed chooses; then
all of it works again, and everybody comes to an end. What the disks hold then is compared with what pages were told.
"""

import asyncio
import logging
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

from minihuman.admin.enrolment_entries import SlotTaken, list_taken_slots, read_enrolment_log
from minihuman.admin.manifest import record_missing_heads
from minihuman.admin.recruitment import Recruitment, hash_link_token
from minihuman.admin.verify.log import verify_session
from minihuman.admin.verify.study import verify_enrolment
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.events import KeyPressed, Noted, Stepped
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.paths import LOG_SUFFIX, find_log_folders, group_sessions, list_sessions, session_folder
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record import live_log
from minihuman.log.record.disk import GATHER_S, FileWriter, GroupCommit
from minihuman.log.record.finalization import find_leftovers, recover_log
from minihuman.log.record.session_leases import SessionLeases
from minihuman.storage import study_journals
from minihuman.storage.lease import TTL_S
from minihuman.storage.remote_store import STORE_URL_FILE_NAME
from minihuman.storage.study_journals import URL_FILE_NAME
from minihuman.storage.system import System, use_system
from minihuman.web.arrivals import Arrivals
from minihuman.web.connection_factory import ConnectionFactory
from minihuman.web.server.app import WebServer
from tests.fault_simulation.database import URL, Database, LeaseDatabase
from tests.fault_simulation.network import Socket
from tests.fault_simulation.page import Participant, Tab
from tests.fault_simulation.schedule import MachineClock, ProcessKilled, Schedule, ServerLoop
from tests.fault_simulation.volume import ProcessDisk, Volume

STUDY = b"""
[study]
name = "walk"
version = "1"
seed = 3
participants = 6
[keys]
keyboard_check = false
[web]
image_size_px = [16, 16]
reconnect_timeout_s = 60
open_access = true
[[groups]]
name = "short"
blocks = ["walk"]
[[groups]]
name = "long"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 1
max_steps = 4
final_frame_ms = 0
actions = ["left", "right", "forward"]
"""
FAULTS_S = 5.0  # so long things go wrong
FAULTS_OF_TWO_S = 20.0  # longer than leases
PATIENCE_S = 400.0  # so long everybody has to come to an end afterwards
HAZARDS = (
    *("kill", "restart", "power", "power", "cut", "cut", "reload", "tab", "copy", "clock"),
    *("full", "short", "failing", "unsynced", "database", "commits", "answers"),
)
OF_DISKS = ("power", "full", "short", "failing", "unsynced")
HAZARDS_OF_TWO = (*HAZARDS, *("partition",) * 4, *("reload",) * 4)
HAZARDS_AT_COMMITS = (*HAZARDS_OF_TWO, *("absent",) * 8, *("stores",) * 4, *("remote",) * 3)
FAULTS_AT_COMMITS_S = 45.0  # longer than a session is kept for a page that is away
_MEMORY = Path("/dev/shm")
_PACKAGES = b"simulated==1.0\n"  # how long a write takes, and where it tears, must not depend on what is installed


@dataclass
class Outcome:
    """What a run showed."""

    seed: int
    failures: list[str] = field(default_factory=list)
    happened: Counter[str] = field(default_factory=Counter)
    acknowledged: int = 0
    steps: int = 0
    trace: list[str] = field(default_factory=list)


class ScheduledCommit(GroupCommit):
    """Writes and syncs on the server's loop: no thread of its own.

    Args:
        disk: the process's.
    """

    def __init__(self, disk: ProcessDisk) -> None:
        super().__init__(sync_one=disk.sync, sync_all=disk.sync)

    def expect(self, file: FileWriter, *, at_once: bool = False) -> None:
        """Have a file's turn come, in a moment or now."""
        if at_once:
            self.commit([file])
        else:
            asyncio.get_running_loop().call_later(GATHER_S, lambda: self.commit([file]))


class Server(WebServer):
    """The real one, but for the thread that writes its logs.

    Args:
        protocol: the study.
        data: the data folder.
        group: writes its logs.
        leases: of its sessions; None where no other server has the study.
    """

    def __init__(self, protocol: Protocol, data: Path, group: GroupCommit, leases: SessionLeases | None = None) -> None:
        arrivals = Arrivals(protocol, data, leases)
        super().__init__(arrivals, data)
        self.study_dir = data / protocol.study.name
        self._factory = ConnectionFactory(arrivals, data, self.connections, group=group)


@dataclass(frozen=True)
class Parts:
    """What a run is made of; a planted fault replaces one of them."""

    disk: type[ProcessDisk] = ProcessDisk
    database: type[Database] = Database
    tab: type[Tab] = Tab
    commit: type[ScheduledCommit] = ScheduledCommit
    server: type[Server] = Server
    leases: type[SessionLeases] = SessionLeases
    lease_table: type[LeaseDatabase] = LeaseDatabase


@cache
def _protocol(consent: bool, episodes: int, reconnect_timeout_s: int = 60) -> Protocol:
    text = STUDY.replace(b"episodes = 1", b"episodes = %d" % episodes)
    text = text.replace(b"timeout_s = 60", b"timeout_s = %d" % reconnect_timeout_s)
    return decode_protocol(text.replace(b"[keys]", b'consent = "May we?"\n[keys]', 1) if consent else text)


class Machine:
    """A server's: its disk, its clocks, and the process that runs on it.

    Args:
        name: of its folder, and to the database.
        simulation: what it is part of.
        leases: where sessions are leased; None where this is the only server.
    """

    def __init__(self, name: str, simulation: "Simulation", leases: LeaseDatabase | None) -> None:
        self.name, self.schedule, self.parts = name, simulation.schedule, simulation.parts
        self.loop: ServerLoop | None = None
        self.sockets: list[Socket] = []
        self.abandoned: list[ServerLoop] = []
        self.clock = MachineClock(self.schedule)
        self.data = simulation.folder / name
        self.data.mkdir()
        self.volume = Volume(self.data, self.schedule, self.clock)
        self.disk = self.parts.disk(self.volume)
        self._simulation, self._leases = simulation, leases
        self._app: Any = None

    @property
    def system(self) -> System:
        """As its programs have it."""
        return System(self.disk, self.clock, self._simulation.database.open_journal)

    @property
    def has_work(self) -> bool:
        """Whether its server has something to do now."""
        return self.loop is not None and self.loop.has_work

    def start(self) -> None:
        """Start the server; it is killed at some operation of the disk, or not."""
        if self.loop is not None:
            return
        rng, faults_over = self.schedule.rng, self._simulation.faults_over
        study_journals._open_in_file.cache_clear()
        study_journals._open_in_database.cache_clear()
        ops_left = None
        if not faults_over and self.schedule.chance(0.35):
            ops_left = rng.randint(0, 60)
        self.disk = self.parts.disk(self.volume, ops_left=ops_left)
        self.loop = ServerLoop(self.schedule)
        if not faults_over and ops_left is None and self.schedule.chance(0.2):
            self.loop.turns_left = rng.randint(20, 1000)
        elif self._simulation.at_commits and not faults_over and ops_left is None and self.schedule.chance(0.6):
            self.disk.commits_left = rng.randint(0, 15)
        self.schedule.note("server starts")
        self.run_until_idle(self._begin)

    def _begin(self) -> None:
        assert self.loop is not None
        leases = None if self._leases is None else self.parts.leases(self._leases)
        group = self.parts.commit(self.disk)
        self._server = server = self.parts.server(self._simulation.protocol, self.data, group, leases)
        server._factory.facts = {"player": "human", "rules": "simulated"}
        self._app = server.app()
        works = (server._look_ahead, server._supervise, server._poll)
        for work in works if leases is None else (*works, server._keep_leases, server._finish_ended_sessions):
            self.loop.create_task(work())

    def run_until_idle(self, do: Callable[[], None] = lambda: None) -> None:
        """Do something in the server's process, and all that it can do now."""
        if self.loop is None:
            return
        self._simulation.database.asker, self._simulation.database.process = self.name, self.disk
        try:
            with use_system(self.system):
                do()
                self.loop.run_until_idle()
        except ProcessKilled:
            what = "a commit" if (self.disk.commits_left or 0) < 0 else "a step"
            self._simulation.outcome.happened[f"killed at {what} of its own"] += 1
            self.kill()
        finally:
            self._simulation.database.process = None

    def kill(self, *, power: bool = False, away_s: float | None = None) -> None:
        """End its process; with ``power`` the machine's, too."""
        if self.loop is None:
            return
        self.schedule.note("power cut" if power else "server killed")
        self._end(self.loop)
        if power:
            if self._simulation.at_commits:  # logs of the shared store come and go past the disk
                self.volume.adopt()
            self.volume.power_cut()
        longest_s = 3 if self._leases is None or self.schedule.chance(0.5) else 20
        self.schedule.after(self.schedule.rng.random() * longest_s if away_s is None else away_s, self.start)

    def stop(self) -> None:
        """End it in good order."""
        if self.loop is None:
            return
        loop = self.loop

        def leave() -> None:
            for connection in self._server.connections.values():
                connection.leave()  # as at the end of its lifespan

        self.run_until_idle(leave)
        if self.loop is loop:
            self._end(loop)

    def _end(self, loop: ServerLoop) -> None:
        loop.abandon()
        self.abandoned.append(loop)
        self.disk.kill()
        self.loop = None
        for socket in self.sockets:
            socket.server_died()
        self.sockets = []

    def connect(self, tab: Tab, *, delay_s: float, twice: float, swapped: float) -> Socket | None:
        """A socket of a page's; None where no server runs."""
        if self.loop is None:
            return None
        loop = self.loop
        socket = Socket(self.schedule, loop, tab, delay_s=delay_s, twice=twice, swapped=swapped)
        self.sockets.append(socket)
        self.run_until_idle(lambda: _start(loop, socket.serve(self._app)))
        return socket


class Simulation:
    """A run.

    Args:
        seed: of all that happens.
        parts: what it is made of.
        machines: how many, each with a server.
        at_commits: whether several servers die at commits, too, and finished logs cannot always be stored: in the
            database, and in half of the runs in a folder that all machines have. Some participants stay away for a
            while, so that their segments end.
    """

    def __init__(self, seed: int, parts: Parts = Parts(), *, machines: int = 1, at_commits: bool = False) -> None:
        self.schedule = Schedule(seed)
        self.parts = parts
        self.at_commits = at_commits
        self.outcome = Outcome(seed, trace=self.schedule.trace)
        rng, several = self.schedule.rng, machines > 1
        self.protocol = _protocol(
            rng.random() < 0.4, rng.choice([3, 5, 8] if several else [1, 1, 2]), 15 if several else 60
        )
        self.folder = Path(tempfile.mkdtemp(dir=_MEMORY if _MEMORY.is_dir() else None))
        self.database = parts.database(self.schedule)
        self._leases = parts.lease_table(self.database) if several else None
        self.machines = [
            Machine("data" if not number else f"data-{number}", self, self._leases) for number in range(machines)
        ]
        if rng.random() < 0.4 or several:
            for machine in self.machines:
                (machine.data / URL_FILE_NAME).write_text(f"{URL}?{machine.name}")
        self._store = self.folder / "store"
        if at_commits and rng.random() < 0.5:
            self._store.mkdir()
            for machine in self.machines:
                (machine.data / STORE_URL_FILE_NAME).write_text(str(self._store))
        self.study_dir = self.machines[0].data / self.protocol.study.name
        self.faults_over = False
        self.logged: list[logging.LogRecord] = []
        self._faults_s = FAULTS_AT_COMMITS_S if at_commits else FAULTS_OF_TWO_S if several else FAULTS_S
        self._hazards = HAZARDS_AT_COMMITS if at_commits else HAZARDS_OF_TWO if several else HAZARDS
        self._all_sockets: list[Socket] = []
        self._twice = rng.choice([0.0, 0.0, 0.05])
        self._swapped = rng.choice([0.0, 0.0, 0.0, 0.02])
        self._delay_s = rng.choice([0.005, 0.05, 0.3])
        self.people = [
            Participant(f"{number}" * 22, self.schedule, self._connect, parts.tab, pause_s=2.0 if several else 0.5)
            for number in range(rng.choice([1, 1, 1, 2, 2, 3]))
        ]

    def _connect(self, tab: Tab) -> Socket | None:
        machine = self.machines[0]
        if len(self.machines) > 1:  # a load balancer keeps a page where it was, if it can
            machine = tab.home if tab.home is not None else self.schedule.rng.choice(self.machines)
            if machine.loop is None or self.schedule.chance(0.1):
                machine = self.schedule.rng.choice(self.machines)
            tab.home = machine
        healthy = self.faults_over
        twice, swapped = (0.0, 0.0) if healthy else (self._twice, self._swapped)
        socket = machine.connect(tab, delay_s=self._delay_s, twice=twice, swapped=swapped)
        if socket is not None:
            self._all_sockets.append(socket)
        return socket

    # The run

    def run(self) -> Outcome:
        """Run it to its end."""
        logger = logging.getLogger("minihuman")
        logger.addFilter(self._keep_record)
        try:
            self._run()
            self._check()
        except MinihumanError as error:  # what is there cannot be read
            self.outcome.failures.append(str(error))
        except Exception as error:
            self.outcome.failures.append(f"traceback: {type(error).__name__}: {error}")
        finally:
            logger.removeFilter(self._keep_record)
            for loop in self._abandoned:
                _unwind(loop)
            shutil.rmtree(self.folder, ignore_errors=True)
        return self.outcome

    @property
    def _abandoned(self) -> list[ServerLoop]:
        return [loop for machine in self.machines for loop in machine.abandoned]

    def _keep_record(self, record: logging.LogRecord) -> bool:
        self.logged.append(record)
        return False

    def _run(self) -> None:
        rng = self.schedule.rng
        for machine in self.machines:
            self.schedule.after(0, machine.start)
        for person in self.people:
            self.schedule.after(0.01 + rng.random() * 2, person.arrive)
        for _ in range(rng.randint(1, 5) * len(self.machines) * (2 if self.at_commits else 1)):
            self.schedule.after(rng.random() * self._faults_s, self._go_wrong)
        self.schedule.after(self._faults_s + 1, self._heal)
        until_ns = round((self._faults_s + PATIENCE_S) * 1e9)
        while self.schedule.now_ns < until_ns:
            self._step()
            if self.faults_over and all(person.end for person in self.people):
                break
        for machine in self.machines:
            machine.stop()
        if len(self.machines) > 1:  # once more each, to finish what it left when it was killed
            for machine in self.machines:
                machine.start()
            until_ns = self.schedule.now_ns + round(1.2 * TTL_S * 1e9)
            while self.schedule.now_ns < until_ns:
                self._step()
            for machine in self.machines:
                machine.stop()

    def _step(self) -> None:
        next_ns = self.schedule.next_ns
        idle = [machine.loop.idle_until_ns for machine in self.machines if machine.loop is not None]
        idle_ns = min((at_ns for at_ns in idle if at_ns is not None), default=None)
        if idle_ns is not None and (next_ns is None or idle_ns <= next_ns):
            self.schedule.now_ns = max(self.schedule.now_ns, idle_ns)
        else:
            self.schedule.run_next()
        for machine in self.machines:
            if machine.has_work:
                machine.run_until_idle()

    def _go_wrong(self) -> None:
        rng = self.schedule.rng
        person = rng.choice(self.people)
        what = rng.choice(self._hazards)
        machine = self.machines[0] if len(self.machines) == 1 else rng.choice(self.machines)
        self.outcome.happened[what] += 1
        self.schedule.note(f"fault: {what} {machine.name}")
        match what:
            case "kill":
                machine.kill()
            case "restart":
                machine.stop()
                self.schedule.after(rng.random() * 3, machine.start)
            case "power":
                machine.kill(power=True)
            case "cut":
                for socket in machine.sockets:
                    socket.cut()
                machine.sockets = []
            case "reload":
                person.reload()
            case "tab":
                person.arrive()
            case "copy":
                person.copy_tab()
            case "clock":
                jump_ns = round(rng.choice([-86_400, -3_600, -30, 30, 3_600]) * 1e9)
                if rng.random() < 0.7:
                    machine.clock.wall_offset_ns += jump_ns
                else:
                    person.wall_skew_ns += jump_ns
            case "full" | "failing" | "unsynced":
                disk = machine.disk
                setattr(disk, what, True)
                self.schedule.after(rng.random() * 3, lambda: setattr(disk, what, False))
                if rng.random() < 0.5:  # a device that fails seldom fails once
                    self.schedule.after(rng.random() * 3, lambda: self._cut_power(machine))
            case "short":
                machine.disk.short = 0.5
                if rng.random() < 0.5:
                    self.schedule.after(rng.random() * 3, lambda: self._cut_power(machine))
            case "database":
                self.database.away = True
                self.schedule.after(rng.random() * 4, lambda: setattr(self.database, "away", False))
            case "partition":
                self.database.cut_off.add(machine.name)
                self.schedule.after(rng.random() * 25, lambda: self.database.cut_off.discard(machine.name))
            case "commits":
                self.database.lost_commits = 0.3
            case "answers":
                self.database.lost_answers = 0.3
            case "absent":
                if person.tab is not None and not person.end:
                    person.tab.leave()
                    self.schedule.after(10 + rng.random() * 20, person.arrive)
            case "stores":
                self.database.lost_stores = 0.5
                self.schedule.after(rng.random() * 20, lambda: setattr(self.database, "lost_stores", 0.0))
            case "remote":
                self._take_store_away()
                self.schedule.after(rng.random() * 20, self._bring_store_back)

    def _cut_power(self, machine: Machine) -> None:
        if not self.faults_over:
            machine.kill(power=True)

    def _take_store_away(self) -> None:
        if self._store.is_dir():
            self._store.rename(self._store.with_name("store away"))
            self._store.touch()

    def _bring_store_back(self) -> None:
        if self._store.is_file():
            self._store.unlink()
            self._store.with_name("store away").rename(self._store)

    def _heal(self) -> None:
        """Everything works again."""
        self.faults_over = True
        for machine in self.machines:
            disk = machine.disk
            disk.full = disk.failing = disk.unsynced = False
            disk.ops_left, disk.commits_left, disk.short = None, None, 0.0
            if machine.loop is not None:
                machine.loop.turns_left = None
        self.database.away = False
        self.database.cut_off.clear()
        self.database.lost_commits = self.database.lost_answers = self.database.lost_stores = 0.0
        self._bring_store_back()
        self._twice = self._swapped = 0.0
        self.schedule.note("faults are over")
        for person in self.people:
            if person.tab is None or person.tab.finished:
                person.arrive() if not person.end else None

    # What must be true

    def _check(self) -> None:
        fail = self.outcome.failures.append
        disks_failed = any(self.outcome.happened[what] for what in OF_DISKS)
        for person in self.people:
            if not person.end:
                fail(f"not ended: {person.token[:2]} after {person.errors[-3:]}")
            if "broken" in person.errors and not disks_failed:
                fail(f"{person.token[:2]} was turned away for good, although every disk worked")
        for socket in self._all_sockets:
            for error in socket.errors:
                fail(f"traceback: {error}")
        for loop in self._abandoned:
            for error in loop.errors:
                fail(f"traceback: {error}")
        for record in self.logged:
            if record.exc_info:
                fail(f"traceback: {record.getMessage()}: {record.exc_info[1]!r}")
        study_journals._open_in_file.cache_clear()
        study_journals._open_in_database.cache_clear()
        with use_system(System(clock=self.machines[0].clock, open_database_journal=self.database.open_journal)):
            self._check_enrolment()
            for machine in self.machines:
                for part in find_leftovers(machine.data):  # as `recover` does
                    finished = (
                        recover_log(part) if self._leases is None else self.parts.leases(self._leases).recover(part)
                    )
                    if finished is not None:
                        record_missing_heads(finished.path)
            self._gather()
            self._check_logs()
            self._check_ends()

    def _gather(self) -> None:
        """Bring all logs to the first machine; of two with one name one has to have all segments of the other.

        Where servers share no store of finished logs, one that finished a segment keeps that log when another goes on.
        """
        for machine in self.machines[1:]:
            for log in sorted(machine.data.rglob(f"*{LOG_SUFFIX}")):
                here = self.machines[0].data / log.relative_to(machine.data)
                here.parent.mkdir(parents=True, exist_ok=True)
                if here.exists() and here.read_bytes() != log.read_bytes():
                    kept, theirs = (
                        [(segment.started_unix_ns, segment.end_ns) for segment in read_log(one).segments]
                        for one in (here, log)
                    )
                    shorter, longer = sorted((kept, theirs), key=len)
                    if len(shorter) == len(longer) or longer[: len(shorter)] != shorter:
                        self.outcome.failures.append(f"{log.name} is there twice")
                    if longer is kept:
                        continue
                shutil.copy(log, here)

    def _check_enrolment(self) -> None:
        fail = self.outcome.failures.append
        try:
            lines = read_enrolment_log(self.study_dir)
        except MinihumanError as error:
            fail(f"enrolment log: {error}")
            return
        allocated = build_allocation_list(self.protocol)
        holders = Counter(line.index for line in list_taken_slots(lines))
        for index, holding in holders.items():
            if holding > 1:
                fail(f"slot {index} is held {holding} times")
        for line in lines:
            if isinstance(line, SlotTaken) and line.group != allocated[line.index].group:
                fail(f"{line.participant} is in group {line.group}")

    def _check_logs(self) -> None:
        fail = self.outcome.failures.append
        if not self.study_dir.exists():
            return
        failed = self.outcome.happened["unsynced"] + self.outcome.happened["failing"]
        presses: Counter[tuple[str, int]] = Counter()
        notes = ""
        for folder, names in find_log_folders(self.study_dir):
            for log, files in group_sessions(folder, names).items():
                seen: Counter[tuple[int, int, int]] = Counter()
                for file in files:
                    for event in read_events(file):
                        match event:
                            case KeyPressed(down=True):
                                presses[event.key, event.t_ns - event.waited_ns] += 1
                            case Stepped():
                                seen[event.episode, event.step, event.t_ns] += 1
                            case Noted(text=text) if text.startswith("not taken: "):
                                notes += f"{text}, "
                self.outcome.steps += len(seen)
                for step, times in seen.items():
                    if times > 1:
                        fail(f"{log.name}: step {step} is there {times} times")
                for line, good in verify_session(files[0] if len(files) == 1 else folder):
                    if not good and not (failed and "damage" in line):  # what the device lost is named
                        fail(f"{log.name}: {line}")
        made = {(press.key, press.stamp_ns) for person in self.people for press in person.presses}
        for logged in presses:
            if logged not in made:
                fail(f"nobody pressed {logged}")
        for person in self.people:
            for press in person.presses:
                found = presses[press.key, press.stamp_ns]
                self.outcome.acknowledged += press.safe
                if press.safe and not found and f"{press.key} at {press.stamp_ns} ns" not in notes:
                    fail(f"lost: {press} of {person.token[:2]}")
                if found > sum(
                    (other.key, other.stamp_ns) == (press.key, press.stamp_ns)
                    for one in self.people
                    for other in one.presses
                ):
                    fail(f"doubled: {press} is there {found} times")

    def _check_ends(self) -> None:
        """Compare what participants were told with what there is, and do what ``verify`` advises."""
        fail = self.outcome.failures.append
        holding = {line.participant for line in list_taken_slots(read_enrolment_log(self.study_dir))}
        came = Recruitment(self.study_dir).standing().came
        theirs = [(person, came.get(hash_link_token(person.token), "")) for person in self.people]
        for person, code in theirs:
            if person.end.endswith("complete") and code not in holding:
                fail(f"{code} has no slot")
            if person.end.endswith("complete"):
                folder = session_folder(self.machines[0].data, self.protocol.study.name, code, 1)
                if not folder.is_dir() or not list_sessions(folder) or read_log(folder).end_reason != "complete":
                    fail(f"{code} was told that the session is complete")
        for log in sorted(self.study_dir.rglob("*.mcap")):
            record_missing_heads(log)
        known = {code for person, code in theirs if not person.end.endswith("broken")}
        for line, good in verify_enrolment(self.study_dir):
            code = line.partition(" ")[0]
            if not good and ("has a slot and no log" not in line or code in known):
                fail(line)


def _start(loop: ServerLoop, serving: Any) -> None:
    loop.create_task(serving)


def _unwind(loop: ServerLoop) -> None:
    """Let the tasks of a process that was killed end: its disk is gone, so that nothing comes of it."""
    for task in asyncio.all_tasks(loop):
        task.cancel()
    for _ in range(50):
        with suppress(ProcessKilled):
            loop.run_until_idle()
            break
    loop.close()


def simulate(seed: int, parts: Parts = Parts(), *, machines: int = 1, at_commits: bool = False) -> Outcome:
    """Run a seed."""
    with patch.object(live_log, "_list_packages", lambda: _PACKAGES):
        return Simulation(seed, parts, machines=machines, at_commits=at_commits).run()
