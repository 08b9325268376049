"""Who is admitted: how many slots invented ids can take, personal links behind one address, and signed arrivals."""

import asyncio
from pathlib import Path

import msgspec
import pytest

from minihuman.admin.enrolment_entries import list_replaced, read_enrolled, read_enrolment_log
from minihuman.admin.status import format_status
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.web.arrival_signature import (
    KEY_FILE_VARIABLE,
    KEY_VARIABLE,
    ArrivalKeyError,
    read_arrival_key,
    sign_arrival,
)
from minihuman.web.arrivals import Admission, Arrival, Arrivals, Rejection
from minihuman.web.connection import Connection
from minihuman.web.connection_factory import ConnectionFactory
from minihuman.web.messages import MESSAGE_VERSION, Hello, KeyMessage, NumberedMessage, Refusal, TickMessage
from minihuman.web.server.app import WebServer
from tests.counts import count
from tests.study.sessions import corridor_plan

ONLINE = Path(__file__).parents[2] / "protocols/online.toml"
TOML = corridor_plan(consent="May we?").protocol_toml
FACTS = {"browser": "Chromium", "window_px": "1600 x 900", "keyboard": True}
KEY = "k" * 40
N_ADDRESSES = 10


def corridor(web: str, participants: int = 300) -> Protocol:
    protocol = decode_protocol(TOML + f"\n[web]\n{web}\n".encode())
    return msgspec.structs.replace(protocol, study=msgspec.structs.replace(protocol.study, participants=participants))


def from_prolific(person: str, **more: str) -> Hello:
    return Hello(MESSAGE_VERSION, platform={"PROLIFIC_PID": person, **more}, stream=person, facts=FACTS)


def agree(connection: Connection) -> None:
    """Press Enter on the consent, as any program can."""
    connection.greet(Hello(MESSAGE_VERSION, stream="x"))
    at_ns = connection.now_ns()
    connection.take(NumberedMessage(1, at_ns + 1_000, TickMessage()))
    connection.take(NumberedMessage(2, at_ns + 2_000, KeyMessage("enter", down=True, stamp=at_ns + 2_000)))
    assert connection.agreed


@pytest.mark.nightly(sample=True)
def test_invented_ids_that_consent_take_no_more_slots_than_the_documented_ones(tmp_path: Path) -> None:
    protocol = decode_protocol(ONLINE.read_bytes())
    limit = protocol.web.max_unconsented_per_address
    per_address = count(6, 100)

    async def come() -> list[Connection | Refusal]:
        factory = ConnectionFactory(Arrivals(protocol, tmp_path), tmp_path, {})
        answers = []
        for number in range(N_ADDRESSES * per_address):
            answer = await factory.connect(from_prolific(f"invented{number}"), f"192.0.2.{number % N_ADDRESSES}")
            if isinstance(answer, Connection):
                agree(answer)
            answers.append(answer)
        return answers

    answers = asyncio.run(come())
    assert sum(isinstance(answer, Connection) for answer in answers) == limit * N_ADDRESSES
    assert {answer.reason for answer in answers if isinstance(answer, Refusal)} == {"busy"}
    assert len(read_enrolled(tmp_path / "online")) == limit * N_ADDRESSES < protocol.study.participants


@pytest.mark.nightly(sample=True)
def test_all_who_have_a_personal_link_are_admitted_behind_one_address(tmp_path: Path) -> None:
    protocol = corridor("open_access = true\nmax_unconsented_per_address = 2\nmax_concurrent_sessions = 300")

    async def come() -> tuple[list[Connection | Refusal], list[Connection | Refusal]]:
        arrivals = Arrivals(protocol, tmp_path)
        factory = ConnectionFactory(arrivals, tmp_path, {})
        invited = [Hello(MESSAGE_VERSION, token, facts=FACTS) for token in arrivals.recruits.issue(count(8, 200))]
        strangers = [Hello(MESSAGE_VERSION, f"{number:022}", facts=FACTS) for number in range(4)]
        return (
            [await factory.connect(hello, "192.0.2.1") for hello in invited],
            [await factory.connect(hello, "192.0.2.1") for hello in strangers],
        )

    invited, strangers = asyncio.run(come())
    assert all(isinstance(answer, Connection) for answer in invited)
    assert [isinstance(answer, Connection) for answer in strangers] == [True, True, False, False]


def test_the_slot_of_a_visitor_who_consented_and_vanished_is_offered_again(tmp_path: Path) -> None:
    protocol = corridor('recruitment_platforms = ["prolific"]\nmax_unconsented_per_address = 1', participants=1)

    async def come() -> tuple[Connection | Refusal, Connection | Refusal]:
        arrivals = Arrivals(protocol, tmp_path)
        server = WebServer(arrivals, tmp_path)
        connection = await server._factory.connect(from_prolific("invented"), "192.0.2.1")
        assert isinstance(connection, Connection)
        agree(connection)
        refused = await server._factory.connect(from_prolific("person"), "192.0.2.1")
        connection.stop("connection_lost", "the page did not come back")
        await server._finish_if_over(connection)
        return refused, await server._factory.connect(from_prolific("person"), "192.0.2.1")

    refused, admitted = asyncio.run(come())
    assert isinstance(refused, Refusal)
    assert isinstance(admitted, Connection)
    assert list_replaced(read_enrolment_log(tmp_path / "corridor")) == ("sub-01",)


def test_a_study_that_requires_signatures_admits_no_invented_id_and_every_signed_one(tmp_path: Path) -> None:
    protocol = corridor('recruitment_platforms = ["prolific", "sona"]\nrequire_signed_arrival = true')
    arrivals = Arrivals(protocol, tmp_path, arrival_key=KEY.encode())
    (token,) = arrivals.recruits.issue(1)
    signature = sign_arrival(KEY.encode(), "corridor", "prolific", "person")
    assert isinstance(arrivals.arrive(Arrival(token)), Admission)
    signed = {"PROLIFIC_PID": "person", "signature": signature}
    assert isinstance(arrivals.arrive(Arrival(platform=signed)), Admission)
    for forged in (
        {"PROLIFIC_PID": "person"},
        {"PROLIFIC_PID": "another", "signature": signature},
        {"survey_code": "person", "signature": signature},
        {"PROLIFIC_PID": "person", "signature": "é"},
    ):
        assert arrivals.arrive(Arrival(platform=forged)) == Rejection("unknown")
    assert arrivals.arrive(Arrival("A" * 22)) == Rejection("unknown")
    keyless = Arrivals(protocol, tmp_path)
    assert keyless.arrive(Arrival(platform=signed)) == Rejection("unknown")
    assert "came online: 1 by personal link, 1 by prolific" in list(format_status(tmp_path / "corridor"))


def test_the_key_of_signatures_is_a_secret_in_the_environment_or_a_file(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text(f"{KEY}\n")
    assert read_arrival_key({KEY_VARIABLE: KEY}) == KEY.encode()
    assert read_arrival_key({KEY_FILE_VARIABLE: str(file)}) == KEY.encode()
    with pytest.raises(ArrivalKeyError, match="has 0 characters; set MINIHUMAN_ARRIVAL_KEY or"):
        read_arrival_key({})
    with pytest.raises(ArrivalKeyError, match="has 5 characters"):
        read_arrival_key({KEY_VARIABLE: "short"})
    with pytest.raises(ArrivalKeyError, match="cannot be read"):
        read_arrival_key({KEY_FILE_VARIABLE: str(tmp_path / "none")})
