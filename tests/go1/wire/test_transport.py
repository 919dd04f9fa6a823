import socket
import statistics
import threading
import time

import pytest

from pypose_lite.go1.simulator.faults import Faults, FaultyLine
from pypose_lite.go1.wire.transport import Udp, UdpServer, pair


def test_a_pair_in_memory_carries_datagrams_both_ways_in_order():
    here, there = pair()
    for number in range(3):
        here.send(bytes([number]))
    there.send(b"back")
    assert [there.receive(0.0) for _ in range(4)] == [b"\0", b"\1", b"\2", None]
    assert (here.receive(0.0), here.receive(0.0)) == (b"back", None)


def test_a_full_box_in_memory_loses_what_comes_later():
    here, there = pair(size=2)
    for number in range(5):
        here.send(bytes([number]))
    assert [there.receive(0.0) for _ in range(3)] == [b"\0", b"\1", None]


def test_receiving_from_memory_waits_for_a_datagram():
    here, there = pair()
    threading.Timer(0.05, here.send, [b"late"]).start()
    assert there.receive(5.0) == b"late"
    assert there.receive(0.01) is None


@pytest.fixture
def server():
    server = UdpServer("127.0.0.1", 0, size=4, silence=0.2)
    yield server
    server.close()


def test_udp_carries_datagrams_to_the_server_and_back(server):
    client = Udp("127.0.0.1", server.port)
    client.send(b"ping")
    assert server.receive(1.0) == b"ping"
    server.send(b"pong, longer")
    assert client.receive(1.0) == b"pong, longer"
    assert client.receive(0.0) is None
    client.close()


@pytest.mark.wall_clock
def test_a_server_holds_on_to_its_first_client_until_that_is_silent(server):
    first, second = Udp("127.0.0.1", server.port), Udp("127.0.0.1", server.port)
    first.send(b"1st ")
    assert server.receive(1.0) == b"1st "
    second.send(b"2nd ")
    assert server.receive(0.05) is None
    server.send(b"to the first")
    assert (first.receive(1.0), second.receive(0.0)) == (b"to the first", None)
    time.sleep(0.25)
    second.send(b"2nd ")
    assert server.receive(1.0) == b"2nd "
    first.send(b"1st ")
    assert server.receive(0.05) is None
    first.close()
    second.close()


def test_a_server_drops_datagrams_of_another_size_and_is_not_taken_by_them(server):
    stranger, client = Udp("127.0.0.1", server.port), Udp("127.0.0.1", server.port)
    stranger.send(b"too long")
    client.send(b"fits")
    assert server.receive(1.0) == b"fits"
    stranger.close()
    client.close()


def test_nobody_listening_is_no_error():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    client = Udp("127.0.0.1", port)
    for _ in range(20):
        client.send(b"hello?")
        assert client.receive(0.01) is None
    client.close()


def test_an_address_that_is_none_is_named():
    with pytest.raises(ValueError, match="udp://256.1.1.1:80: no such address"):
        Udp("256.1.1.1", 80)


def test_a_port_that_is_taken_is_named(server):
    with pytest.raises(ValueError, match=f"127.0.0.1:{server.port}: cannot listen there"):
        UdpServer("127.0.0.1", server.port, 4, 1.0)


class Clock:
    def __init__(self):
        self.time = 0.0

    def __call__(self):
        return self.time


def sent_over(faults, count=2000, seed=0, step=0.001):
    """[(time of arrival, number sent)] of datagrams that set out every `step` seconds."""
    clock, (here, there) = Clock(), pair(size=10_000)
    line, arrivals = FaultyLine(here, faults, seed, clock), []
    for tick in range(count + 2000):
        clock.time = tick * step
        if tick < count:
            there.send(tick.to_bytes(4, "big") + bytes(60))
        while (data := line.receive(0.0)) is not None:
            arrivals.append((clock.time, data))
    return arrivals


def good(arrivals):
    return [
        (time, int.from_bytes(data[:4], "big"))
        for time, data in arrivals
        if len(data) == 64 and data[4:] == bytes(60) and data[:2] == bytes(2)
    ]


def test_a_line_without_faults_changes_nothing():
    assert good(sent_over(Faults())) == [(tick * 0.001, tick) for tick in range(2000)]


def test_a_line_loses_its_share():
    arrived = good(sent_over(Faults(loss=0.3)))
    assert len(arrived) == pytest.approx(1400, abs=80)  # 4 standard deviations
    assert [number for _, number in arrived] == sorted(number for _, number in arrived)


def test_a_line_delays_every_datagram_alike():
    arrived = good(sent_over(Faults(delay=0.2)))
    assert len(arrived) == 2000
    assert all(time - number * 0.001 == pytest.approx(0.2, abs=0.0011) for time, number in arrived)


def test_a_line_doubles_its_share():
    numbers = [number for _, number in good(sent_over(Faults(duplicates=0.25)))]
    assert set(numbers) == set(range(2000))
    assert len(numbers) - 2000 == pytest.approx(500, abs=80)


def test_a_line_reorders_its_share_and_none_is_later_than_said():
    arrived = good(sent_over(Faults(reordering=0.2, lateness=0.03)))
    numbers = [number for _, number in arrived]
    assert sorted(numbers) == list(range(2000)) and numbers != sorted(numbers)
    lateness = [time - number * 0.001 for time, number in arrived]
    assert max(lateness) <= 0.0311
    held = [late for late in lateness if late > 0.0011]
    assert len(held) == pytest.approx(400, abs=80)
    assert statistics.mean(held) == pytest.approx(0.015, abs=0.003)


def test_a_line_adds_garbage_and_leaves_the_rest():
    arrivals = sent_over(Faults(garbage=0.5))
    assert {number for _, number in good(arrivals)} >= set(range(2000))
    others = [data for _, data in arrivals if len(data) != 64 or any(data[4:])]
    assert len(others) == pytest.approx(1000, abs=120)
    assert len({len(data) for data in others}) > 300


@pytest.mark.parametrize("faults", [Faults(loss=0.3, delay=0.05, duplicates=0.3, garbage=0.3)])
def test_a_line_does_the_same_again_with_the_same_seed(faults):
    assert sent_over(faults, seed=1) == sent_over(faults, seed=1)
    assert sent_over(faults, seed=1) != sent_over(faults, seed=2)


def test_a_line_is_bad_in_both_directions():
    clock, (here, there) = Clock(), pair()
    line = FaultyLine(here, Faults(delay=0.1), 0, clock)
    line.send(b"out")
    assert there.receive(0.0) is None
    clock.time = 0.11
    assert line.receive(0.0) is None  # moves what is due
    assert there.receive(0.0) == b"out"


def test_a_line_on_the_wall_clock_wakes_up_for_a_late_datagram():
    here, there = pair()
    line = FaultyLine(here, Faults(delay=0.05))
    there.send(b"soon")
    assert line.receive(0.001) is None
    assert line.receive(5.0) == b"soon"


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"loss": 1.5}, "loss"),
        ({"duplicates": -0.1}, "duplicates"),
        ({"reordering": float("nan")}, "reordering"),
        ({"garbage": 2}, "garbage"),
        ({"delay": -1.0}, "delay"),
        ({"lateness": float("inf")}, "lateness"),
    ],
)
def test_impossible_faults_are_refused(options, name):
    with pytest.raises(ValueError, match=f"{name}: expected"):
        Faults(**options)
