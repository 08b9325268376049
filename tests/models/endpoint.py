"""A scripted endpoint that speaks chat completions: answers at once, remembers every request, and can misbehave."""

import json
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

KEY = "sk-very-secret-0123456789"
Reply = Callable[[list[dict[str, Any]], int], str | int]  # messages and the request's number; an int is a status


def text_of(messages: list[dict[str, Any]]) -> str:
    """The words of the latest message."""
    content = messages[-1]["content"]
    return content if isinstance(content, str) else content[0]["text"]


def play(messages: list[dict[str, Any]], number: int) -> str:
    """Agree, press keys in turn, and answer every question."""
    text = text_of(messages)
    last = text.splitlines()[-1]
    if "go_on" in last:
        return "I have read it.\nAnswer: go_on"
    if found := re.search(r"one key of: ([^.,]*)", last):
        keys = found[1].split()
        return f"I try a key.\nAnswer: {keys[number * 7 % len(keys)]}"
    if "How old" in text:
        return "Answer: 30"
    return "Answer: it was fine" if "one line" in last else "Answer: 1"


class Endpoint:
    """The server's memory."""

    def __init__(self, reply: Reply) -> None:
        self.reply = reply
        self.requests: list[list[dict[str, Any]]] = []
        self.keys: set[str] = set()
        self.lock = threading.Lock()
        self.url = ""


@contextmanager
def serve_endpoint(reply: Reply = play) -> Iterator[Endpoint]:
    """Serve until the block ends."""
    endpoint = Endpoint(reply)

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_POST(self) -> None:
            sent = self.rfile.read(length := int(self.headers["Content-Length"]))
            if len(sent) < length:  # by a program that was killed
                raise ConnectionAbortedError
            body = json.loads(sent)
            with endpoint.lock:
                endpoint.requests.append(body["messages"])
                endpoint.keys.add(self.headers["Authorization"])
                number = len(endpoint.requests)
            answer = endpoint.reply(body["messages"], number)
            status = answer if isinstance(answer, int) else 200
            message = {"role": "assistant", "content": answer, "reasoning": f"the key is {KEY}"}
            found = {
                "id": "chatcmpl-secret-request-id",
                "model": "/home/somebody/models/scripted-2026",
                "choices": [{"message": message, "finish_reason": "stop"}],
                "usage": {"prompt_tokens": 1000, "completion_tokens": 10},
            }
            content = json.dumps(
                found if status == 200 else {"error": {"message": f"{KEY} at http://localhost"}}
            ).encode()
            self.send_response(status)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            pass

    class Server(ThreadingHTTPServer):
        def handle_error(self, *address: Any) -> None:
            if not isinstance(sys.exc_info()[1], ConnectionError):  # of a program that was killed
                super().handle_error(*address)

    server = Server(("127.0.0.1", 0), Handler)
    endpoint.url = f"http://127.0.0.1:{server.server_port}/v1"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield endpoint
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
