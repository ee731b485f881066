"""Services over RTPS without ROS: who asks gets its own answer, also late, also when datagrams are lost."""

from __future__ import annotations

import random
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from peers import LOOPBACK, any_domain

for needed in ("cyclonedds", "rosbags"):
    pytest.importorskip(needed, reason="needs cartier[ros]")
ros_services = pytest.importorskip("ros_services")
ASKED, KIND, Asker, until = ros_services.ASKED, ros_services.KIND, ros_services.Asker, ros_services.until

if TYPE_CHECKING:
    from cartier_ros.dds.services import Request, Services


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


def state(number: int) -> Any:
    from cartier_ros.dds.types import message

    return message(f"{KIND}_Response", current_state=message("lifecycle_msgs/msg/State", id=number, label="active"))


@contextmanager
def served(domain: int, answered: Callable[[Request], object]) -> Iterator[Services]:
    from cartier_ros.dds.services import Services

    services = Services(domain)
    try:
        services.serve("/amcl/get_state", KIND, answered)
        yield services
    finally:
        services.close()


def test_each_client_gets_its_own_answers() -> None:
    domain, waiting, late = any_domain(), list[Any](), list[bool]()
    askers = [Asker(domain) for _ in range(2)]  # before the service: what they announced is remembered
    time.sleep(0.5)
    with served(domain, lambda request: waiting.append(request) if late else request.reply(state(9))):
        for asker in askers:
            asker.wait()
        late.append(True)
        for asker in askers:
            asker.ask(ASKED)
            asker.ask(ASKED)
        assert until(lambda: len(waiting) == 4)
        assert not any(asker.got for asker in askers)
        for number, request in enumerate(waiting):
            request.reply(state(number))
        assert until(lambda: all(len(asker.got) >= 2 for asker in askers))
        time.sleep(0.4)  # what is sent again comes once
        assert sorted(askers[0].numbers() + askers[1].numbers()) == [0, 1, 2, 3]
        assert all(each.related.guid == asker.reader for asker in askers for each in asker.got)
    for asker in askers:
        asker.participant.close()


def test_a_client_of_cyclonedds_reads_its_header() -> None:
    domain = any_domain()
    asker = ros_services.CycloneAsker(domain)
    with served(domain, lambda request: request.reply(state(3))):
        assert asker.asked(42, 7) == [(42, 7, 3, "active")]


class Lossy(socket.socket):
    """A socket that loses a third of what it is to send."""

    chance, lost = random.Random(5), 1 / 3

    def sendto(self, data: bytes, *address: Any) -> int:  # type: ignore[override]
        return len(data) if self.chance.random() < self.lost else super().sendto(data, *address)


def test_lost_datagrams_are_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cartier_ros.dds.ports.socket.socket", Lossy)
    domain = any_domain()
    with served(domain, lambda request: request.reply(state(3))):
        asker = Asker(domain)
        asker.wait()
        for _ in range(12):
            asker.ask(ASKED)
        assert until(lambda: len(asker.got) >= 12, 20)
        time.sleep(0.4)
        assert len({each.sender for each in asker.got}) == len(asker.got), "none came twice"
        asker.participant.close()


TEXT = "std_msgs/msg/String"


def test_lost_fragments_are_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier_ros.dds.large import LargeWriter
    from cartier_ros.dds.rtps import Participant
    from cartier_ros.dds.topics import Offer, Reader, participant
    from cartier_ros.dds.types import encoded, message

    monkeypatch.setattr("cartier_ros.dds.ports.socket.socket", Lossy)
    monkeypatch.setattr(Lossy, "lost", 1 / 20)
    domain, chance = any_domain(), random.Random(2)
    ours = Participant(domain)
    writer, reader = (
        LargeWriter(ours, "/text", TEXT),
        Reader(participant(domain), Offer("/text", TEXT, True, False), 9),
    )
    assert until(lambda: writer.listeners() and reader.writers(), 20)
    sent, got = list[bytes](), list[bytes]()
    for _ in range(20):
        sent.append(encoded(message(TEXT, data=chance.randbytes(200_000).hex())))
        writer.write(sent[-1], 50e6)
        time.sleep(0.05)
        got += reader.take()
    ours.close()
    assert len(got) > 14 and set(got) <= set(sent), "one of 28 fragments is lost of three samples in four"


def test_large_samples_go_at_a_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier_ros.dds import large
    from cartier_ros.dds.rtps import Participant
    from cartier_ros.dds.topics import Offer, Reader, participant

    domain, slept = any_domain(), list[float]()
    ours = Participant(domain)
    writer = large.LargeWriter(ours, "/text", TEXT)
    reader = Reader(participant(domain), Offer("/text", TEXT, False, False), 9)
    assert until(lambda: writer.listeners() and reader.writers(), 20)
    monkeypatch.setattr(large, "time", SimpleNamespace(monotonic=lambda: 0.0, sleep=slept.append))
    writer.write(b"\0\1\0\0" + bytes(900_000), 20e6)
    ours.close()
    assert slept == sorted(slept) and len(slept) > 40, "a pause after each few fragments"
    assert slept[-1] == pytest.approx(900_000 / 20e6, rel=0.02)


def test_damaged_datagrams_harm_nobody() -> None:
    domain, chance = any_domain(), random.Random(3)
    with served(domain, lambda request: request.reply(state(3))), socket.socket(type=socket.SOCK_DGRAM) as stranger:
        asker = Asker(domain)
        head = b"RTPS\x02\x03\x01\x0f" + bytes(range(12))
        for _ in range(400):
            kind, body = chance.choice((6, 7, 8, 14, 21, 22, 99)), chance.randbytes(chance.randrange(80))
            for port in range(7410 + 250 * domain, 7420 + 250 * domain, 2):
                stranger.sendto(head + bytes((kind, chance.randrange(16))) + len(body).to_bytes(2, "little") + body,
                                ("127.0.0.1", port))  # fmt: skip
        asker.ask(b"\0\1\0\0")  # no request at all
        asker.wait()
        asker.participant.close()
