"""A peer that drips is as late as one that is silent: each call ends, whatever still comes."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from minihuman.simulation.chat_client import ChatClient, ModelUnavailableError
from minihuman.simulation.model_conversation import AnswerRule, Prompt
from minihuman.storage import remote_store
from minihuman.storage.deadlines import call_within, cut_off_late
from minihuman.storage.remote_store import RemoteStoreError, S3Store

PROMPT = Prompt([{"role": "user", "content": "?"}], "", "", 1, "?", "", AnswerRule("page", "?"), None, None)
HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
DRIPS = {
    "nothing": (b"", b""),
    "a status line": (b"", b"HTTP/1.1 200 OK "),
    "header lines": (HEAD, b"X-A: b\r\n"),
    "one header": (HEAD + b"X-A: ", b"b"),
    "a body": (HEAD + b"Content-Length: 5000000\r\n\r\n", b" "),
    "chunks": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\n \r\n"),
    "a chunk's length": (HEAD + b"Transfer-Encoding: chunked\r\n\r\n", b"0"),
    "a body without an end": (HEAD + b"Connection: close\r\n\r\n", b" "),
}
TIMEOUT_S = 0.3


@contextmanager
def dripping(first: bytes, drip: bytes) -> Iterator[str]:
    """An endpoint that answers every connection for ever; its address."""
    stopped = threading.Event()
    server = socket.create_server(("127.0.0.1", 0))

    def answer(line: socket.socket) -> None:
        with suppress(OSError), line:
            line.recv(1 << 16)
            line.sendall(first)
            while not stopped.wait(0.05):
                line.sendall(drip)

    def accept() -> None:
        with suppress(OSError):
            while True:
                threading.Thread(target=answer, args=[server.accept()[0]], daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.getsockname()[1]}"
    finally:
        stopped.set()
        server.close()


@pytest.mark.parametrize("kind", DRIPS)
def test_a_call_of_a_model_that_drips_ends_as_a_timeout(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with dripping(*DRIPS[kind]) as address:
        monkeypatch.setenv("OPENAI_BASE_URL", f"{address}/v1")
        client = ChatClient("m", settings={}, timeout_s=TIMEOUT_S)
        for _ in range(2):  # the second opens a connection of its own
            with pytest.raises(ModelUnavailableError) as refused:
                client.ask(PROMPT)
            assert refused.value.reason == "timeout"
            assert refused.value.temporary
        client.close()


@pytest.mark.parametrize("kind", ["one header", "a body"])
def test_a_call_of_a_store_that_drips_ends_with_a_sentence(
    kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("boto3")
    with dripping(*DRIPS[kind]) as address:
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            monkeypatch.setenv(name, "tester-tester")
        monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        monkeypatch.setenv("AWS_ENDPOINT_URL", address)
        monkeypatch.setattr(remote_store, "STORE_TIMEOUT_S", TIMEOUT_S)
        monkeypatch.setattr(remote_store, "_SLOWEST_BYTES_PER_S", 1e12)
        store = S3Store("bucket/prefix")
        (tmp_path / "file").write_bytes(b"content")
        calls: list[Callable[[], Any]] = [
            lambda: store.versions(""),
            lambda: store.fetch("a/b", tmp_path / "fetched"),
            lambda: store.put("a/b", tmp_path / "file"),
            lambda: store.remove("a/b"),
        ]
        for call in calls[: 2 if kind == "a body" else None]:
            with pytest.raises(RemoteStoreError, match=r"no whole answer within 0\.3 s; check the network"):
                call()
        assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_an_answer_in_time_and_an_error_in_time_are_what_they_are() -> None:
    assert call_within(60, lambda: 7) == 7
    with pytest.raises(KeyError):
        call_within(60, lambda: {}["nothing"])


def test_after_the_deadline_what_is_waited_for_is_shut() -> None:
    shut = threading.Event()
    with pytest.raises(TimeoutError, match=r"no whole answer within 0\.01 s"):
        call_within(0.01, lambda: shut.wait(60), shut=shut.set)
    assert shut.is_set()
    let_go = threading.Event()
    with cut_off_late(0.01, let_go.set) as timer:
        assert let_go.wait(60)
    assert not timer.is_alive() or timer.join(60) is None
