"""A client for language models at any endpoint with OpenAI's chat completions. It knows no session and writes nothing.

The endpoint's address and key come from the environment, ``OPENAI_BASE_URL`` and ``OPENAI_API_KEY``, and stay in
memory: no answer or error that leaves this module holds the key or the address.
"""

import abc
import http.client
import json
import os
import re
import socket
import ssl
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

from minihuman.errors import MinihumanError, SimulationError
from minihuman.simulation.model_conversation import Prompt
from minihuman.storage.deadlines import call_within

BASE_URL = "OPENAI_BASE_URL"
API_KEY = "OPENAI_API_KEY"
DEFAULT_URL = "https://api.openai.com/v1"
MAX_ANSWER_BYTES = 8_000_000
MAX_ERROR = 300  # characters of what a provider says of an error
MAX_TOKENS = 1_000_000_000  # larger token counts of a server are cut to this
_TEMPORARY_STATUSES = (HTTPStatus.REQUEST_TIMEOUT, HTTPStatus.CONFLICT, HTTPStatus.TOO_MANY_REQUESTS)
MIN_SECRET = 8  # characters; a shorter key is a dummy, and may be part of an answer
# Private parts of a provider's error, which are removed: addresses, shortened keys, ids of requests and accounts, paths
_PRIVATE = re.compile(
    r"https?://\S+|\b\d{1,3}(?:\.\d{1,3}){3}(?::\d+)?|\b(?:sk|req|org|proj|user|acct|chatcmpl)[-_][^\s,;'\")]+"
    r"|\b[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\b|(?:[/\\][\w.~-]+){2,}"
)

_FOLDER = re.compile(r"^(?:[A-Za-z]:)?(?=[/\\~.]).*[/\\]")  # of a model's file, which local servers give in its name
_NOT_A_COMPLETION = (ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, RecursionError)


class ModelUnavailableError(MinihumanError, OSError):
    """The endpoint gave no answer; the error's text names no address."""

    def __init__(self, reason: str, *, temporary: bool) -> None:
        super().__init__(
            f"the model gave no answer: {reason}; check {BASE_URL} and {API_KEY}, then run the same command to resume"
        )
        self.reason = reason
        self.temporary = temporary


@dataclass(frozen=True, slots=True)
class ChatAnswer:
    """One answer of a model, as the server gave it."""

    text: str
    reasoning: str
    model: str
    finish_reason: str
    prompt_tokens: int
    completion_tokens: int
    latency_ms: float


def _shut_down(connection: http.client.HTTPConnection) -> None:
    """Shut a connection down, so that a thread that is reading from it returns."""
    opened: socket.socket | None = connection.sock
    if opened is not None:
        with suppress(OSError):
            opened.shutdown(socket.SHUT_RDWR)


class ModelClient(abc.ABC):
    """A language model that answers in a participant's place; each session has its own client."""

    model: str  # its name, as the log is to hold it

    @abc.abstractmethod
    def ask(self, prompt: Prompt) -> ChatAnswer:
        """Send a prompt and return the whole answer.

        Raises:
            ModelUnavailableError: if there is no answer.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Release open resources. Calling it again does nothing."""


class ChatClient(ModelClient):
    """A connection to one model.

    Args:
        model: the name of the model at the endpoint.
        settings: fields of a request besides the model and its messages, such as ``{"temperature": 0.0}``.
        timeout_s: the longest time that an answer may take, in seconds.

    Raises:
        SimulationError: if the endpoint's address is not valid, or the key cannot be put in a header.
    """

    def __init__(self, model: str, *, settings: Mapping[str, float], timeout_s: float) -> None:
        self.model = model
        self._settings = settings
        self._timeout_s = timeout_s
        self._key = os.environ.get(API_KEY, "").strip()
        if not (self._key.isascii() and self._key.isprintable()):
            raise SimulationError(
                f"{API_KEY} holds a character that a header cannot; set it to the key alone, in printable ASCII"
            )
        address = os.environ.get(BASE_URL, "").strip() or DEFAULT_URL
        try:
            url = urlsplit(address)
            host = url.hostname
            self._port = url.port
        except ValueError:  # its text holds the address
            host = None
        if not host or url.scheme not in ("http", "https") or re.search(r"[^!-~]", address):
            raise SimulationError(
                f"{BASE_URL} is not a valid URL; set it to one such as https://HOST/v1, or unset it to use OpenAI's"
            )
        self._tls: ssl.SSLContext | None = None
        if url.scheme == "https":
            self._tls = ssl.create_default_context()
        self._host = host
        self._path = f"{url.path.rstrip('/')}/chat/completions"
        self._connection: http.client.HTTPConnection | None = None

    def ask(self, prompt: Prompt) -> ChatAnswer:
        """Send the messages of a prompt and return the whole answer.

        Raises:
            ModelUnavailableError: if there is no answer.
        """
        body = json.dumps({"model": self.model, "messages": prompt.messages, **self._settings}).encode()
        started_s = time.perf_counter()
        try:
            status, content = self._post(body)
        except (OSError, http.client.HTTPException, ValueError) as error:
            self.close()
            name = type(error).__name__  # an error's text may hold the address
            if isinstance(error, TimeoutError):
                name = "timeout"
            raise ModelUnavailableError(name, temporary=not isinstance(error, ValueError)) from None
        latency_ms = (time.perf_counter() - started_s) * 1_000
        if status != HTTPStatus.OK:
            reason = ": ".join(filter(None, [f"HTTP {status}", self._read_error(content)]))
            is_server_error = status >= HTTPStatus.INTERNAL_SERVER_ERROR
            raise ModelUnavailableError(reason, temporary=is_server_error or status in _TEMPORARY_STATUSES)
        return self._parse_answer(content, latency_ms)

    def close(self) -> None:
        """Close the connection; the next request opens a new one."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _post(self, body: bytes) -> tuple[int, bytes]:
        """Send a request within the time limit, connecting if necessary; return the response's status and content."""
        if self._connection is None:
            if self._tls is None:
                self._connection = http.client.HTTPConnection(self._host, self._port, timeout=self._timeout_s)
            else:
                self._connection = http.client.HTTPSConnection(
                    self._host, self._port, timeout=self._timeout_s, context=self._tls
                )
        exchange = partial(self._exchange, self._connection, body)
        return call_within(self._timeout_s, exchange, shut=partial(_shut_down, self._connection))

    def _exchange(self, connection: http.client.HTTPConnection, body: bytes) -> tuple[int, bytes]:
        """Send a request over a connection; return the status and the content of the response.

        Raises:
            HTTPException: if the content is larger than `MAX_ANSWER_BYTES`.
        """
        headers = {"Content-Type": "application/json"}
        if self._key:
            headers["Authorization"] = f"Bearer {self._key}"
        connection.request("POST", self._path, body, headers)
        response = connection.getresponse()
        content = response.read(MAX_ANSWER_BYTES + 1)
        if len(content) > MAX_ANSWER_BYTES:
            raise http.client.HTTPException  # reported by its name, as its text could hold the address
        return response.status, content

    def _parse_answer(self, content: bytes, latency_ms: float) -> ChatAnswer:
        """Return the answer that a completion contains.

        Raises:
            ModelUnavailableError: if the content is not a chat completion.
        """
        try:
            completion = json.loads(content)
            choice = completion["choices"][0]
            usage = completion.get("usage") or {}
            message = choice["message"]
            return ChatAnswer(
                text=self._remove_key(message.get("content")),
                reasoning=self._remove_key(message.get("reasoning") or message.get("reasoning_content")),
                model=_FOLDER.sub("", self._remove_key(completion.get("model"))) or self.model,
                finish_reason=self._remove_key(choice.get("finish_reason")),
                prompt_tokens=min(MAX_TOKENS, max(0, int(usage.get("prompt_tokens") or 0))),
                completion_tokens=min(MAX_TOKENS, max(0, int(usage.get("completion_tokens") or 0))),
                latency_ms=latency_ms,
            )
        except _NOT_A_COMPLETION:
            raise ModelUnavailableError("not a chat completion", temporary=False) from None

    def _read_error(self, content: bytes) -> str:
        """Return a provider's error text in one line, without the key and the address; "" if there is none."""
        try:
            message = self._remove_key(json.loads(content)["error"]["message"])
        except _NOT_A_COMPLETION:
            return ""
        return _PRIVATE.sub("[...]", " ".join(message.replace(self._host, "[...]").split()))[:MAX_ERROR]

    def _remove_key(self, text: Any) -> str:
        """Return a server's text without the key, which a server may repeat; "" if it is not a text."""
        if not isinstance(text, str):
            return ""
        cleaned = text.encode("utf-8", "replace").decode()
        if len(self._key) >= MIN_SECRET:
            return cleaned.replace(self._key, "[key]")
        return cleaned
