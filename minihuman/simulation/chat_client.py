"""Ask a model through any endpoint that speaks OpenAI's chat completions. Knows no session and writes nothing.

Where it is and its key come from the environment, ``OPENAI_BASE_URL`` and ``OPENAI_API_KEY``, and stay in memory: no
answer or error that leaves this module holds the key or the address.
"""

import abc
import http.client
import json
import os
import re
import ssl
import time
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from minihuman.errors import MinihumanError, SimulationError
from minihuman.simulation.model_seat import Prompt

BASE_URL, API_KEY = "OPENAI_BASE_URL", "OPENAI_API_KEY"
DEFAULT_URL = "https://api.openai.com/v1"
MAX_ANSWER_BYTES = 8_000_000


class ModelUnavailableError(MinihumanError, OSError):
    """The endpoint gave no answer; its text names no address."""

    def __init__(self, reason: str, *, temporary: bool) -> None:
        super().__init__(reason)
        self.reason = reason
        self.temporary = temporary


@dataclass(frozen=True, slots=True)
class ChatAnswer:
    """One answer, as the server gave it."""

    text: str
    reasoning: str
    model: str
    finish_reason: str
    prompt_tokens: int
    completion_tokens: int
    latency_ms: float


class SeatClient(abc.ABC):
    """Answers for whoever sits in a participant's place; each session has its own."""

    model: str  # its name, as the log is to hold it

    @abc.abstractmethod
    def ask(self, prompt: Prompt) -> ChatAnswer:
        """Hand over a screen and wait for the whole answer.

        Raises:
            ModelUnavailableError: if there is none.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Let go of what is open. A second call does nothing."""


class ChatClient(SeatClient):
    """A connection to one model.

    Args:
        model: the name that the endpoint knows it by.
        timeout_s: how long an answer may take.

    Raises:
        SimulationError: if the endpoint's address is none.
    """

    def __init__(self, model: str, *, temperature: float, max_tokens: int, timeout_s: float) -> None:
        self.model = model
        self._settings = {"temperature": temperature, "max_tokens": max_tokens}
        self._timeout_s = timeout_s
        self._key = os.environ.get(API_KEY, "")
        url = urlsplit(os.environ.get(BASE_URL) or DEFAULT_URL)
        if url.scheme not in ("http", "https") or not url.hostname:
            raise SimulationError(
                f"{BASE_URL} is not a valid URL; set it to one such as https://HOST/v1, or unset it to use OpenAI's"
            )
        self._tls = ssl.create_default_context() if url.scheme == "https" else None
        self._host, self._port, self._path = url.hostname, url.port, f"{url.path.rstrip('/')}/chat/completions"
        self._connection: http.client.HTTPConnection | None = None

    def ask(self, prompt: Prompt) -> ChatAnswer:
        """Send the messages and wait for the whole answer.

        Raises:
            ModelUnavailableError: if there is none.
        """
        body = json.dumps({"model": self.model, "messages": prompt.messages, **self._settings}).encode()
        started_s = time.perf_counter()
        try:
            status, content = self._post(body)
        except (OSError, http.client.HTTPException) as error:
            self.close()
            name = "timeout" if isinstance(error, TimeoutError) else type(error).__name__
            raise ModelUnavailableError(name, temporary=True) from None  # an error's text may hold the address
        latency_ms = (time.perf_counter() - started_s) * 1_000
        if status != 200:
            raise ModelUnavailableError(f"HTTP {status}", temporary=status in (408, 409, 429) or status >= 500)
        return self._read(content, latency_ms)

    def close(self) -> None:
        """Close the connection; the next request opens another."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _post(self, body: bytes) -> tuple[int, bytes]:
        if self._connection is None:
            self._connection = (
                http.client.HTTPConnection(self._host, self._port, timeout=self._timeout_s)
                if self._tls is None
                else http.client.HTTPSConnection(self._host, self._port, timeout=self._timeout_s, context=self._tls)
            )
        headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {self._key}"} if self._key else {})
        self._connection.request("POST", self._path, body, headers)
        response = self._connection.getresponse()
        content = response.read(MAX_ANSWER_BYTES + 1)
        if len(content) > MAX_ANSWER_BYTES:
            raise http.client.HTTPException
        return response.status, content

    def _read(self, content: bytes, latency_ms: float) -> ChatAnswer:
        try:
            found = json.loads(content)
            choice, usage = found["choices"][0], found.get("usage") or {}
            message = choice["message"]
            return ChatAnswer(
                text=self._clean(message.get("content")),
                reasoning=self._clean(message.get("reasoning") or message.get("reasoning_content")),
                model=_drop_folder(self._clean(found.get("model"))) or self.model,
                finish_reason=self._clean(choice.get("finish_reason")),
                prompt_tokens=max(0, int(usage.get("prompt_tokens") or 0)),
                completion_tokens=max(0, int(usage.get("completion_tokens") or 0)),
                latency_ms=latency_ms,
            )
        except (ValueError, KeyError, IndexError, TypeError, AttributeError):
            raise ModelUnavailableError("not a chat completion", temporary=False) from None

    def _clean(self, text: Any) -> str:
        """A text without the key, whatever a server echoes."""
        cleaned = (text if isinstance(text, str) else "").encode("utf-8", "replace").decode()
        return cleaned.replace(self._key, "[key]") if self._key else cleaned


def _drop_folder(model: str) -> str:
    """A model's name without the folder of its file, which local servers give."""
    return re.split(r"[/\\]", model)[-1] if re.match(r"([A-Za-z]:)?[/\\~.]", model) else model
