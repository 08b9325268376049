"""A PostgreSQL server of a test's own, in a folder of its own, on a socket there."""

import os
import pwd
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from tests.machine import need


@contextmanager
def database(*, port: int | None = None) -> Iterator[str]:
    """A database's address; with a port it also listens there, on this machine."""
    programs = Path(need("postgresql")).parent
    as_whom = ["runuser", "-u", "postgres", "--"] if os.getuid() == 0 else []  # it refuses to run as root
    with tempfile.TemporaryDirectory(prefix="mh-pg-", dir="/tmp") as name:  # a socket's path is short
        folder = Path(name)
        if as_whom:
            os.chown(folder, pwd.getpwnam("postgres").pw_uid, -1)

        def told(*words: str) -> None:
            done = subprocess.run([*as_whom, *words], capture_output=True, text=True, cwd="/")
            assert done.returncode == 0, done.stdout + done.stderr

        told(f"{programs}/initdb", "-D", f"{name}/data", "-U", "tester", "-A", "trust", "--no-sync")
        listening = "-c listen_addresses=" if port is None else f"-c listen_addresses=127.0.0.1 -c port={port}"
        options = f"{listening} -c unix_socket_directories={name} -c max_connections=60"
        told(f"{programs}/pg_ctl", "-D", f"{name}/data", "-l", f"{name}/log", "-w", "-o", options, "start")
        try:
            yield f"postgresql://tester@/postgres?host={name}" + (f"&port={port}" if port else "")
        finally:
            told(f"{programs}/pg_ctl", "-D", f"{name}/data", "-m", "immediate", "stop")


def fresh(url: str) -> str:
    """An empty database on the same server."""
    import psycopg

    name = f"test_{uuid4().hex[:12]}"
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f'create database "{name}"')
    return url.replace("/postgres?", f"/{name}?")
