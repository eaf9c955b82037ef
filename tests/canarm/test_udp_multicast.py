"""Emulator and controller over python-can's udp_multicast, on the wall clock: it may lose frames, and here it need not.

Hop limit 0 keeps the frames on this machine. Lockstep over it is refused (test_cli.py).
"""

import random
import signal

import can
import pytest

GROUP = "239.74.163.2"  # python-can's own choice for IPv4
SYNC = 0x080
FRAMES = 10_000
"""More than the run has; a bound on what is listened to."""


def missing(port: int) -> str | None:
    """Why udp_multicast does not work here."""
    try:
        with can.Bus(interface="udp_multicast", channel=GROUP, port=port, hop_limit=0) as bus:
            bus.send(can.Message(arbitration_id=0x7DF, is_extended_id=False))
    except Exception as error:  # msgpack is not installed, there is no route, the system forbids it
        return f"udp_multicast: {' '.join(str(error).split())}"
    return None


@pytest.mark.slow
def test_the_loop_closes_over_multicast_on_the_wall_clock(canarm):
    port = random.SystemRandom().randrange(20_000, 60_000)  # any number of programs may share a group's port
    if reason := missing(port):
        pytest.skip(reason)
    buses = ["-i", "udp_multicast", "-c", GROUP, "--bus-kwargs", f"port={port}", "hop_limit=0"]
    emulator = canarm.emulator("wall", *buses)
    emulator.wait_for(rf"^can0 +--bus-kwargs port={port} hop_limit=0 -i udp_multicast -c {GROUP}$")
    with can.Bus(interface="udp_multicast", channel=GROUP, port=port, hop_limit=0) as listener:
        arguments = [*canarm.for_clock("wall"), "--seconds", "1", "--json"]
        controller = canarm("controller", *buses, *arguments)
        assert controller.wait() == 0, controller
        assert controller.json["state"] == "done"
        assert controller.json["ticks"] == 400
        expected, heard = {SYNC, 0x701, 0x712, 0x713, 0x714}, set()
        for _ in range(FRAMES):  # the cards' heartbeats go on: the bus never falls silent
            message = listener.recv(1.0)
            if message is None or heard > expected:
                break
            heard.add(message.arbitration_id)
        assert heard > expected
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0, emulator
