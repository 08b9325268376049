"""What people did is their owner's alone to read, and no secret is in any text that leaves a program."""

import asyncio
import os
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from minihuman.admin.recruitment import PlatformId, Recruitment
from minihuman.admin.remote_logs import sync_logs
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from minihuman.simulation.chat_client import ChatClient, ModelUnavailableError
from minihuman.simulation.model_conversation import AnswerRule, Prompt
from minihuman.storage import redaction
from minihuman.storage.lease import open_lease_table
from minihuman.storage.redaction import redact
from minihuman.storage.remote_store import STORE_URL_FILE_NAME, RemoteStoreError, open_store_url
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, URL_FILE_NAME, open_journal
from minihuman.web.arrival_signature import KEY_VARIABLE, read_arrival_key
from minihuman.web.server.metrics import METRICS_TOKEN_VARIABLE
from tests.borders.test_three_machines import read_all_text
from tests.programs import running
from tests.web.processes import below, until
from tests.web.protocols import study
from tests.web.serving import free_port
from tests.web.typed_page import TypedPage

CANARY = "canary-Zebrafink-7391"
PROMPT = Prompt([{"role": "user", "content": "?"}], "", "", 1, "?", "", AnswerRule("page", "?"), None, None)


@pytest.mark.parametrize("umask", [0o000, 0o022, 0o077])
def test_folders_and_files_of_a_study_are_their_owners_alone_whatever_the_umask(tmp_path: Path, umask: int) -> None:
    protocol = decode_protocol(study(tmp_path, max_steps=4).read_bytes())
    before = os.umask(umask)
    try:
        list(simulate(protocol, tmp_path / "new" / "data", participants=1, seed=1, player="random"))
        recruitment = Recruitment(tmp_path / "new" / "data" / "tried")
        recruitment.issue(1)
        recruitment.remember(PlatformId("sub-01", "prolific", "someone"))
        recruitment.hash_platform_id("prolific", "someone")
        with StudyStore(StudySessions(tmp_path / "new" / "data" / "tried"), with_shortest=False):
            pass
    finally:
        os.umask(before)
    paths = [tmp_path / "new", *(tmp_path / "new").rglob("*")]
    assert len(paths) > 8
    open_paths = {path.name: oct(mode) for path in paths if (mode := stat.S_IMODE(path.stat().st_mode)) & 0o077}
    assert open_paths == {}


def test_a_store_in_a_folder_is_as_open_as_the_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"content")
    for mode, expected in ((0o700, 0o600), (0o770, 0o660)):
        folder = tmp_path / f"{mode:o}"
        folder.mkdir()
        folder.chmod(mode)
        before = os.umask(0)
        try:
            open_store_url(str(folder)).put("study/sub-01/ses-01/a.mcap", tmp_path / "file")
        finally:
            os.umask(before)
        assert stat.S_IMODE((folder / "study/sub-01/ses-01/a.mcap").stat().st_mode) == expected


def _open_database(url: str, folder: Path) -> None:
    (folder / "data" / "study").mkdir(parents=True)
    (folder / "data" / URL_FILE_NAME).write_text(url)
    open_journal(folder / "data" / "study", ENROLMENT_FILE_NAME, lambda line, number: None).read()


def _ask_model(url: str, folder: Path) -> None:
    ChatClient("m", settings={}, timeout_s=1.0).ask(PROMPT)


def _list_store(url: str, folder: Path) -> None:
    open_store_url(url or "s3://bucket/prefix", may_be_new=False).versions("")


def _lease_session(url: str, folder: Path) -> None:
    (folder / "data" / "study").mkdir(parents=True)
    (folder / "data" / URL_FILE_NAME).write_text(url)
    table = open_lease_table(folder / "data" / "study")
    assert table is not None
    table.acquire("study/sub-01/ses-01")


def _gather(url: str, folder: Path) -> None:
    (folder / "data" / "study").mkdir(parents=True)
    (folder / "data" / STORE_URL_FILE_NAME).write_text(url)
    sync_logs(folder / "data", "study/")


def _read_key(url: str, folder: Path) -> None:
    read_arrival_key(os.environ)


class _RepeatingHandler(BaseHTTPRequestHandler):
    """Refuses each request, and repeats the secret in its refusal, as some services do."""

    def _refuse(self) -> None:
        content = f"<Error><Code>InvalidKey</Code><Message>{CANARY} is wrong</Message></Error>".encode()
        self.send_response(401, f"wrong key {CANARY}")
        self.send_header("Content-Type", "application/xml")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def do_GET(self) -> None:
        """Refuse it."""
        self._refuse()

    def do_POST(self) -> None:
        """Refuse it."""
        self._refuse()

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def _use_repeating_endpoint(fail: Callable[[str, Path], None], variable: str) -> Callable[[str, Path], None]:
    def fail_at_endpoint(url: str, folder: Path) -> None:
        with ThreadingHTTPServer(("127.0.0.1", 0), _RepeatingHandler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv(variable, f"http://127.0.0.1:{server.server_port}/v1")
                try:
                    fail(url, folder)
                finally:
                    server.shutdown()

    return fail_at_endpoint


FAILURES: dict[str, tuple[Callable[[str, Path], None], str, dict[str, str]]] = {
    "S3 endpoint with a password": (_list_store, "", {"AWS_ENDPOINT_URL": f"http://user:{CANARY}@127.0.0.1:9"}),
    "S3 endpoint that is none": (_list_store, "", {"AWS_ENDPOINT_URL": f"user:{CANARY}@host"}),
    "S3 endpoint with a key in its query": (
        _list_store, "", {"AWS_ENDPOINT_URL": f"http://127.0.0.1:9/?X-Amz-Signature={CANARY}&token={CANARY}"},
    ),
    "S3 secret": (_list_store, "", {"AWS_SECRET_ACCESS_KEY": CANARY, "AWS_ENDPOINT_URL": "http://127.0.0.1:9"}),
    "S3 session token": (_list_store, "", {"AWS_SESSION_TOKEN": CANARY, "AWS_ENDPOINT_URL": "http://127.0.0.1:9"}),
    "S3 proxy": (_list_store, "", {"HTTP_PROXY": f"http://u:{CANARY}@127.0.0.1:9", "AWS_ENDPOINT_URL": "http://h.test"}),
    "S3 key in the address": (_list_store, f"s3://KEY:{CANARY}@bucket/prefix", {}),
    "S3 bucket that is none": (_list_store, f"s3://b!{CANARY.replace('-', '!')}:x@/p", {}),
    "another kind of store": (_list_store, f"https://user:{CANARY}@host/bucket", {}),
    "a password with a slash": (_list_store, f"ftp://user:x/{CANARY}@host/bucket", {}),
    "database that is not there": (_open_database, f"postgresql://u:{CANARY}@127.0.0.1:9/d", {}),
    "database by keywords": (_open_database, f"host=127.0.0.1 port=9 password={CANARY}", {}),
    "database address that is none": (_open_database, f"postgres//u:{CANARY}@host", {}),
    "database with a wrong port": (_open_database, f"postgresql://u:{CANARY}@127.0.0.1:port/d", {}),
    "database with an unknown setting": (_open_database, f"postgresql://u:{CANARY}@127.0.0.1:9/d?nothing={CANARY}", {}),
    "database password in the environment": (_open_database, "postgresql://u@127.0.0.1:9/d", {"PGPASSWORD": CANARY}),
    "model key": (_ask_model, "", {"OPENAI_API_KEY": CANARY, "OPENAI_BASE_URL": "http://127.0.0.1:9/v1"}),
    "model address with a password": (_ask_model, "", {"OPENAI_BASE_URL": f"http://u:{CANARY}@127.0.0.1:9/v1"}),
    "model address that is none": (_ask_model, "", {"OPENAI_BASE_URL": f"u:{CANARY}@host"}),
    "model key with a line's end": (
        _ask_model, "", {"OPENAI_API_KEY": f"{CANARY}\nX: y", "OPENAI_BASE_URL": "http://127.0.0.1:9/v1"},
    ),
    "model key with letters that no header has": (
        _ask_model, "", {"OPENAI_API_KEY": f"{CANARY}\u2026", "OPENAI_BASE_URL": "http://127.0.0.1:9/v1"},
    ),
    "model endpoint that repeats the key": (
        _use_repeating_endpoint(_ask_model, "OPENAI_BASE_URL"), "", {"OPENAI_API_KEY": CANARY},
    ),
    "S3 endpoint that repeats the secret": (
        _use_repeating_endpoint(_list_store, "AWS_ENDPOINT_URL"), "", {"AWS_SECRET_ACCESS_KEY": CANARY},
    ),
    "S3 session token with a line's end": (
        _list_store, "", {"AWS_SESSION_TOKEN": f"{CANARY}\nX: y", "AWS_ENDPOINT_URL": "http://127.0.0.1:9"},
    ),
    "S3 key in the address of a study's store": (_gather, f"s3://KEY:{CANARY}@bucket/prefix", {}),
    "S3 store with a secret in its query": (
        _gather, f"s3://bucket/prefix?token={CANARY}", {"AWS_ENDPOINT_URL": "http://127.0.0.1:9"},
    ),
    "database password with a stray percent sign": (_open_database, f"postgresql://u:{CANARY}%ZZ@127.0.0.1:9/d", {}),
    "database keywords without an equals sign": (_open_database, f"host=127.0.0.1 port=9 password {CANARY}", {}),
    "database keywords with an open quote": (_open_database, f"host=127.0.0.1 port=9 password='{CANARY}", {}),
    "database password with an at sign": (_open_database, f"postgresql://u:x@{CANARY}@127.0.0.1:9/d", {}),
    "database of leases that is not there": (_lease_session, f"postgresql://u:{CANARY}@127.0.0.1:9/d", {}),
    "arrival key that is too short": (_read_key, "", {KEY_VARIABLE: CANARY}),
}  # fmt: skip


@pytest.mark.parametrize("kind", FAILURES)
def test_a_secret_of_a_configuration_is_in_no_text_of_a_failure(
    kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("boto3")
    monkeypatch.setattr(redaction, "_ADDRESS_SECRETS", set())  # or what one kind tells would hide it in the next
    fail, url, variables = FAILURES[kind]
    defaults = {"AWS_ACCESS_KEY_ID": "tester", "AWS_SECRET_ACCESS_KEY": "tester", "AWS_DEFAULT_REGION": "us-east-1"}
    for name, text in (defaults | {"AWS_MAX_ATTEMPTS": "1"} | variables).items():
        monkeypatch.setenv(name, text)
    with pytest.raises((OSError, RemoteStoreError, ModelUnavailableError, ValueError)) as raised:
        fail(url, tmp_path)
    error: BaseException | None = raised.value
    texts = []
    while error is not None:
        texts.append(f"{error} {error!r}")
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    printed = capfd.readouterr()
    letters = CANARY.replace("-", "!")
    assert [text for text in (*texts, printed.out, printed.err) if CANARY in text or letters in text] == []


SECRET_VARIABLES = {
    "AWS_SECRET_ACCESS_KEY": CANARY,
    "AWS_SESSION_TOKEN": CANARY,
    "AWS_ENDPOINT_URL": f"http://user:{CANARY}@127.0.0.1:9",
    "OPENAI_API_KEY": CANARY,
    "PGPASSWORD": CANARY,
    KEY_VARIABLE: CANARY * 2,
    METRICS_TOKEN_VARIABLE: CANARY,
}


@pytest.mark.program
@pytest.mark.nightly
def test_no_process_of_a_server_no_file_of_its_study_and_no_line_of_it_holds_a_secret(tmp_path: Path) -> None:
    pytest.importorskip("boto3")
    data = tmp_path / "data"
    data.mkdir()
    (data / STORE_URL_FILE_NAME).write_text("s3://bucket/prefix\n")
    web = 'recruitment_platforms = ["prolific"]\nrequire_signed_arrival = true'
    protocol = study(tmp_path, episodes=1, max_steps=4, web=web)
    port = free_port(in_a_row=2)
    command = [sys.executable, "-m", "minihuman", "serve", str(protocol), "--data", str(data), "--port", str(port)]
    defaults = {"AWS_ACCESS_KEY_ID": "tester", "AWS_DEFAULT_REGION": "us-east-1", "AWS_MAX_ATTEMPTS": "1"}
    with (tmp_path / "errors").open("w") as errors:
        environment = {**os.environ, **defaults, **SECRET_VARIABLES}
        options = ["--workers", "2", "--watch", "--links", "1"]
        with running(
            [*command, *options], stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
        ) as process:
            assert process.stdout is not None
            link = ""
            lines = []
            while "#t=" not in link:
                link = process.stdout.readline()
                assert link, (tmp_path / "errors").read_text()
                lines.append(link)
            until(lambda: len(below(process.pid)) >= 2)
            token = link.strip().partition("#t=")[2]
            counts = asyncio.run(TypedPage(f"127.0.0.1:{port}", token, keys_per_s=10).take_part())
            assert counts.over == "complete"
            until(lambda: "`minihuman gather`" in (tmp_path / "errors").read_text())
            command_lines = [
                Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
                for pid in (process.pid, *below(process.pid))
            ]
            process.terminate()
            lines += process.stdout.readlines()
    assert len(command_lines) >= 3
    texts = [*command_lines, *lines, (tmp_path / "errors").read_text()]
    assert [text for text in texts if CANARY in text] == []
    files = [path for path in data.rglob("*") if path.is_file() and path.name != STORE_URL_FILE_NAME]
    assert any(path.suffix == ".mcap" for path in files)
    assert [path.name for path in files if CANARY in read_all_text(path)] == []


def test_what_is_no_secret_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOME_TOKEN", "abc")  # too short to be one
    text = "log sub-01_ses-01.mcap cannot be stored in s3://bucket/prefix: abc: see https://host/path?page=2"
    assert redact(text) == text
    assert redact("Authorization: Bearer abc.def, x") == "Authorization: [...], x"
    assert redact("password='a b' host=h") == "password=[...] host=h"
