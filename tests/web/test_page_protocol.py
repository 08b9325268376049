"""A page's protocol without a socket: texts in, batches out."""

import json
import struct
from collections.abc import Iterator

import pytest

from minihuman.web import messages
from minihuman.web.message_streams import OutgoingStream
from minihuman.web.page_protocol import MAX_BATCH_BYTES, PageProtocol, PageSession, ServerMessages, StreamNames
from minihuman.web.traffic_limits import MAX_BACKLOG, MESSAGE_BURST, PREFETCH_BACKLOG


class EchoSession(PageSession):
    """Answers every numbered message with the state of an episode, and has it on the disk when told so."""

    def __init__(self) -> None:
        self.taken: list[tuple[int, bool]] = []
        self.durable = 0
        self.time_ns = 1_000
        self._outgoing: ServerMessages = OutgoingStream()
        self.texts = 0
        self.acts = 0
        self.farewells: list[bool] = []

    @property
    def outgoing(self) -> ServerMessages:
        return self._outgoing

    def now_ns(self) -> int:
        return self.time_ns

    def safe(self) -> int:
        return self.durable

    def take(self, numbered: messages.NumberedMessage, *, more: bool = False) -> None:
        self.taken.append((numbered.n, more))
        if not isinstance(numbered.what, messages.RoundTripMessage):
            self.outgoing.add(messages.EpisodeState(numbered.n, None))

    def hear(self, now_s: float) -> None:
        self.texts += 1

    def record_act(self) -> None:
        self.acts += 1

    def bid_farewell(self, *, is_left: bool) -> None:
        self.farewells.append(is_left)

    def spend(self, n_bytes: int, *, number: int, is_text: bool = False) -> bool:
        return True

    def forget(self) -> None:
        self._outgoing = OutgoingStream()


WELCOME = messages.Welcome("", "", False, 0, 0, {}, {}, "", {}, 0, False, 4_500)


def protocol_of(session: PageSession, after: int = 0) -> PageProtocol:
    return PageProtocol(session, WELCOME, after, 0.0)


def receive(protocol: PageProtocol, *lines: str) -> tuple[bool, bool]:
    """Have a text received; whether there is an answer, and more to look for ahead."""
    protocol.begin_text(0.0)
    for place, line in enumerate(lines, 1):
        protocol.receive(line, more=place < len(lines))
    effect = protocol.end_text()
    return effect.has_answer, effect.wants_more


def parts_of(batch: bytes) -> Iterator[dict[str, object]]:
    while batch:
        kind, size = struct.unpack_from("<BI", batch)
        assert kind == 0
        yield json.loads(batch[5 : 5 + size])
        batch = batch[5 + size :]


def sent(protocol: PageProtocol) -> list[dict[str, object]]:
    return [part for batch in protocol.take_batches() for part in parts_of(batch)]


def tick(number: int) -> str:
    return json.dumps(["t", number, 1_000 + number])


def test_a_key_is_answered_once_and_acknowledged_when_it_is_on_the_disk() -> None:
    session = EchoSession()
    protocol = protocol_of(session)
    assert receive(protocol, tick(1)) == (True, True)
    [answer] = sent(protocol)
    assert (answer["n"], answer["m"]["through"]) == (1, 1)  # type: ignore[index]
    session.durable = 1
    assert sent(protocol) == [{"t": "acked", "through": 1}]
    assert sent(protocol) == []


def test_messages_of_one_text_are_known_to_come_together_and_a_ping_among_them_is_answered_with_the_rest() -> None:
    session = EchoSession()
    protocol = protocol_of(session)
    receive(protocol, tick(1), '{"t":"ping","sent":5}', tick(2))
    assert session.taken == [(1, True), (2, False)]
    session.time_ns = 1_200
    assert sent(protocol)[-1] == {"t": "pong", "sent": 5, "received": 1_000, "answered": 1_200}
    assert session.ping is None


def test_a_ping_says_that_something_was_typed_which_has_not_settled() -> None:
    session = EchoSession()
    protocol = protocol_of(session)
    receive(protocol, '{"t":"ping","sent":5,"acted":true}', tick(1), '{"t":"ping","sent":6}')
    assert session.acts == 1


def test_a_ping_alone_is_answered_at_once() -> None:
    answer = protocol_of(EchoSession()).receive('{"t":"ping","sent":5}', more=False)
    assert answer is not None
    assert json.loads(answer) == {"t": "pong", "sent": 5, "received": 1_000, "answered": 1_000}


def test_a_page_that_comes_back_is_sent_what_it_does_not_have() -> None:
    session = EchoSession()
    receive(protocol_of(session), tick(1), tick(2), tick(3))
    session.outgoing.acknowledge(1)
    assert [message["n"] for message in sent(protocol_of(session, after=2))] == [3]


def test_what_is_long_goes_in_several_batches_with_one_acknowledgement_at_the_end() -> None:
    session = EchoSession()
    session.durable = 7
    for _ in range(3):
        session.outgoing.add(messages.PictureMessage(1, 0, 1, 1, bytes(MAX_BATCH_BYTES)))
    batches = list(protocol_of(session).take_batches())
    assert [len(batch) > MAX_BATCH_BYTES for batch in batches] == [True, True, True, False]
    assert list(parts_of(batches[-1])) == [{"t": "acked", "through": 7}]


def test_a_page_that_acknowledges_nothing_begins_anew() -> None:
    session = EchoSession()
    protocol = protocol_of(session)
    for _ in range(MAX_BACKLOG + 1):
        session.outgoing.add(messages.CommandMessage(1))
    with pytest.raises(messages.MessageError, match="have not been acknowledged; reload the page"):
        receive(protocol, tick(1))
    assert protocol.is_superseded


def test_a_page_that_caught_up_is_looked_ahead_for_again() -> None:
    session = EchoSession()
    protocol = protocol_of(session)
    for _ in range(PREFETCH_BACKLOG):
        session.outgoing.add(messages.CommandMessage(1))
    assert receive(protocol, '{"t":"heard","n":1}') == (False, False)
    session.outgoing.add(messages.CommandMessage(1))
    session.outgoing.add(messages.CommandMessage(1))
    assert receive(protocol, '{"t":"heard","n":2}') == (False, True)


def test_a_measured_round_trip_says_how_far_to_look_ahead() -> None:
    link = {"t": "link", "sent": 1, "received": 2, "answered": 3, "back": 4, "latest": 5}
    text = json.dumps({"t": "n", "n": 1, "at": 9, "what": link})
    assert receive(protocol_of(EchoSession()), text) == (False, True)


@pytest.mark.parametrize(
    ("message", "waits"),
    [
        (messages.EpisodeState(1, None), True),
        (messages.EpisodeState(1, 500), False),
        (messages.EpisodeState(1, None, who="agent"), False),
        (messages.CommandMessage(1), False),
    ],
    ids=["where a key led", "when the next step is due", "what an agent does", "a command"],
)
def test_only_what_a_page_knows_already_waits_for_what_is_found_ahead(message, waits) -> None:
    session = EchoSession()
    session.outgoing.add(message)
    assert protocol_of(session).can_wait is waits


def test_a_second_hello_and_a_flood_are_not_admitted() -> None:
    protocol = protocol_of(EchoSession())
    with pytest.raises(messages.MessageError, match="a second hello"):
        protocol.receive('{"t":"hello","version":6}', more=False)
    assert [protocol.admit(MESSAGE_BURST - 1, 0.0), protocol.admit(3, 0.0), protocol.admit(1, 0.0)] == [
        MESSAGE_BURST - 1,
        1,
        0,
    ]
    assert protocol.admit(1, 0.1) == 1


def test_a_tab_goes_on_with_its_stream_and_another_tab_begins_one() -> None:
    names = StreamNames()
    assert names.receive_stream("tab", 1)
    assert names.incoming.take(1)
    assert not names.receive_stream("tab", 1)
    assert names.incoming.received == 1
    assert names.receive_stream("other tab", 8)
    assert names.incoming.received == 7


@pytest.mark.parametrize(
    ("life", "heard", "resumes"),
    [("a", 2, True), ("a", 0, True), ("b", 2, False), ("", 0, False), ("a", 3, False)],
    ids=["it has all", "it has nothing yet", "of another server", "a new page", "it has what was never sent"],
)
def test_a_page_goes_on_with_the_numbering_that_it_has(life, heard, resumes) -> None:
    outgoing: ServerMessages = OutgoingStream()
    outgoing.add(messages.CommandMessage(1))
    outgoing.add(messages.CommandMessage(2))
    names = StreamNames()
    assert not names.resumes(life, heard, outgoing)
    names.life = "a"
    assert names.resumes(life, heard, outgoing) is resumes


def test_any_text_is_a_sign_of_life_of_the_page_and_its_farewell_says_where_it_goes() -> None:
    session = EchoSession()
    protocol = protocol_of(session)
    receive(protocol, '{"t":"ping","sent":1}')
    receive(protocol, '{"t":"heard","n":0}', '{"t":"bye","left":true}')
    receive(protocol, '{"t":"bye","left":false}')
    assert session.texts == 3
    assert session.farewells == [True, False]


def test_the_late_farewell_of_a_page_that_another_one_followed_says_nothing() -> None:
    session = EchoSession()
    protocol = protocol_of(session)
    session.forget()  # the next page's numbering
    receive(protocol, '{"t":"bye","left":false}')
    assert session.farewells == []
