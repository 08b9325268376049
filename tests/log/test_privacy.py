"""No names, e-mails, host or login names: nothing in a log says whose machine it was."""

import getpass
import os
import platform
import re
import socket
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.records import Attachment, Metadata

from minihuman.experiment.machine.events import SessionStarted
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner
from minihuman.runtime.machine import collect_machine_facts
from tests.log.samples import STARTED_NS, session_events, session_plan


def _all_bytes(path: Path) -> bytes:
    found = []
    for record in LogScanner(path):
        match record:
            case LogMessage():
                found.append(record.data)
            case Metadata():
                found.append(repr(record).encode())
            case Attachment():
                found.append(repr(record.name).encode() + record.data)
    return b"\n".join(found)


def test_a_log_says_nothing_of_the_person_or_machine_that_wrote_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    really = {getpass.getuser(), socket.gethostname()}
    for variable in ("LOGNAME", "USER", "USERNAME", "HOSTNAME"):
        monkeypatch.setenv(variable, "jane-7f3a")
    for module, name in ((socket, "gethostname"), (socket, "getfqdn"), (platform, "node")):
        monkeypatch.setattr(module, name, lambda: "host-7f3a")
    monkeypatch.setattr(platform, "release", lambda: "6.1.0-jane-7f3a")  # a kernel built at home
    plan = session_plan()
    recorder = McapRecorder(tmp_path, plan, started_ns=STARTED_NS)
    start, *rest = session_events(plan)
    assert isinstance(start, SessionStarted)
    recorder.write([replace(start, facts={"player": "human", **collect_machine_facts()}), *rest])
    recorder.drain()
    live = recorder.segment_path.part.read_bytes()
    log = recorder.close()
    assert log is not None
    private = {"jane-7f3a", "host-7f3a", str(Path.home()), str(tmp_path), os.getcwd()}
    private |= {name for name in really if len(name) > 3}  # a shorter one is there by chance
    for content in (live, _all_bytes(log)):
        assert len(content) > 10_000
        for name in private:
            assert name.encode() not in content, name
        assert not re.search(rb"[\w.-]{2,}@[\w-]{2,}\.\w{2,}", content), "an e-mail address"
