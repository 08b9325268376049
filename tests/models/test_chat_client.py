"""The client of chat completions against endpoints that misbehave: no key leaves it, and no answer breaks it."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

import pytest

from minihuman.errors import SimulationError
from minihuman.simulation.chat_client import MAX_ERROR, ChatClient, ModelUnavailableError
from minihuman.simulation.model_conversation import AnswerRule, Prompt
from tests.models.endpoint import KEY

PROMPT = Prompt([{"role": "user", "content": "?"}], "", "", 1, "?", "", AnswerRule("page", "?"), None, None)
SETTINGS: dict[str, Any] = {"temperature": 0.5, "max_tokens": 7}


@contextmanager
def answering(status: int, content: bytes) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """An endpoint that gives every request the same bytes; its address and the requests' bodies."""
    bodies: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            bodies.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(status)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/v1", bodies
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture
def make_client(monkeypatch: pytest.MonkeyPatch) -> Callable[..., ChatClient]:
    def make(url: str = "http://127.0.0.1:9/v1", key: str = KEY, settings: dict[str, Any] = SETTINGS) -> ChatClient:
        monkeypatch.setenv("OPENAI_BASE_URL", url)
        monkeypatch.setenv("OPENAI_API_KEY", key)
        return ChatClient("x", settings=settings, timeout_s=5)

    return make


def completion(text: str = "Answer: 1", **usage: Any) -> bytes:
    message = {"content": text, "reasoning": f"with {KEY}"}
    return json.dumps({"model": "m", "choices": [{"message": message}], "usage": usage}).encode()


@pytest.mark.parametrize("end", ["\n", "\r\n", " ", "\t"])
def test_a_key_from_a_file_with_a_line_end_is_used_without_it(make_client: Callable[..., ChatClient], end: str) -> None:
    with answering(200, completion()) as (url, _):
        assert make_client(url, KEY + end).ask(PROMPT).text == "Answer: 1"


@pytest.mark.parametrize("key", [f"{KEY}\r\nX: y", f"{KEY}\nmore", f"clé-{KEY}", f"{KEY}\x01", f"{KEY}\u2028z"])
def test_a_key_that_no_header_can_hold_is_refused_without_a_word_of_it(
    make_client: Callable[..., ChatClient], key: str
) -> None:
    with pytest.raises(SimulationError, match="OPENAI_API_KEY") as caught:
        make_client(key=key)
    assert "secret" not in repr(caught.value)


@pytest.mark.parametrize(
    "url",
    ["http://[secret", "http://secret:port/v1", "http://secret:99999/v1", "ftp://secret", "http://secret/a b\r\nX: y",
     "http://secret/é", "http:///v1"],
)  # fmt: skip
def test_an_address_that_is_none_is_refused_without_a_word_of_it(
    make_client: Callable[..., ChatClient], url: str
) -> None:
    with pytest.raises(SimulationError, match="OPENAI_BASE_URL is not a valid URL") as caught:
        make_client(url)
    assert "secret" not in repr(caught.value)


def test_a_host_that_cannot_be_is_an_endpoint_that_is_not_there(make_client: Callable[..., ChatClient]) -> None:
    """Encoding such a name is a ValueError of the library."""
    with pytest.raises(ModelUnavailableError) as caught:
        make_client(f"http://{'secret' * 20}.invalid/v1").ask(PROMPT)
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("key", ["1", "x", "dummy", "EMPTY"])
def test_a_dummy_key_of_a_local_server_changes_no_answer(make_client: Callable[..., ChatClient], key: str) -> None:
    with answering(200, completion(f"{key} 1 x\nAnswer: 1")) as (url, _):
        assert make_client(url, key).ask(PROMPT).text == f"{key} 1 x\nAnswer: 1"


@pytest.mark.parametrize(
    "content",
    [
        completion().replace(b'"usage": {}', b'"usage": {"prompt_tokens": 1e999}'),
        completion().replace(b'"usage": {}', b'"usage": {"prompt_tokens": NaN}'),
        completion().replace(b'"usage": {}', b'"usage": {"completion_tokens": ' + b"9" * 5000 + b"}"),
        b"[" * 100_000,
        b'{"choices": [{"message": ' + b'{"a":' * 100_000,
        b"\xff\xfe",
        b"",
    ],
)
def test_an_answer_that_is_none_leaves_the_session_to_be_resumed(
    make_client: Callable[..., ChatClient], content: bytes
) -> None:
    with (
        answering(200, content) as (url, _),
        pytest.raises(ModelUnavailableError, match="not a chat completion"),
    ):
        make_client(url).ask(PROMPT)


def test_counts_of_tokens_are_bounded(make_client: Callable[..., ChatClient]) -> None:
    with answering(200, completion(prompt_tokens=10**300, completion_tokens=-4)) as (url, _):
        answer = make_client(url).ask(PROMPT)
    assert (answer.prompt_tokens, answer.completion_tokens) == (10**9, 0)


def test_what_the_provider_says_of_an_error_is_reported_without_what_is_private(
    make_client: Callable[..., ChatClient],
) -> None:
    said = f"Unsupported parameter: 'max_tokens'. {KEY} {KEY[:9]}*** https://secret.example/v1 req_secret9 at 10.0.0.7"
    error = {"error": {"message": said + " very long" * 1000, "code": "unsupported_parameter"}}
    with answering(400, json.dumps(error).encode()) as (url, _), pytest.raises(ModelUnavailableError) as caught:
        make_client(url).ask(PROMPT)
    assert caught.value.reason.startswith("HTTP 400: Unsupported parameter: 'max_tokens'. [key]")
    assert not caught.value.temporary
    assert len(caught.value.reason) <= MAX_ERROR + len("HTTP 400: ")
    assert not any(word in caught.value.reason for word in ("secret", "sk-very", "10.0.0.7", "127.0.0.1"))


@pytest.mark.parametrize("content", [b"", b"<html>secret</html>", b'{"error": 3}', b'{"error": ' + b"[" * 100_000])
def test_an_error_without_a_message_is_its_status(make_client: Callable[..., ChatClient], content: bytes) -> None:
    with answering(503, content) as (url, _), pytest.raises(ModelUnavailableError) as caught:
        make_client(url).ask(PROMPT)
    assert caught.value.reason == "HTTP 503"
    assert "OPENAI_BASE_URL" in str(caught.value), "what to check, and how to resume"
    assert caught.value.temporary


def test_a_request_holds_the_settings_that_it_was_given(make_client: Callable[..., ChatClient]) -> None:
    with answering(200, completion()) as (url, bodies):
        make_client(url, settings={"max_completion_tokens": 9}).ask(PROMPT)
    assert bodies == [{"model": "x", "messages": PROMPT.messages, "max_completion_tokens": 9}]
