"""The robot as a serial CAN adapter: emulator and controller as processes, python-can's stock slcan driver in between.

The driver waits 2 s after it has opened its port.
"""

import os
import signal

import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="this system has no pseudo-terminals")


def channel_of(emulator) -> str:
    """What the emulator says is the adapter's channel."""
    return str(emulator.wait_for(r"^can0 +-i slcan -c (\S+)$").group(1))


def over_slcan(canarm, emulator, *arguments: str):
    """A controller on the adapter, judged by the bench on the virtual bus."""
    bench = ["--bench-interface", "canarm", "--bench-channel", "bench", "--bench-bus-kwargs", f"port={emulator.port}"]
    robot = ["-i", "slcan", "-c", channel_of(emulator), *bench]
    return canarm("controller", *robot, "--clock", "sync", "--json", "--progress", *arguments)


@pytest.mark.slow
def test_the_loop_closes_over_a_serial_adapter_as_it_does_over_the_virtual_bus(canarm):
    logs = []
    for place in ("can0", "socket://127.0.0.1:0", None):
        folder = f"run{len(logs)}"
        adapter = [] if place is None else ["--slcan", place]
        emulator = canarm.emulator("sync", *adapter, "--out", folder, "--json")
        if adapter:
            controller = over_slcan(canarm, emulator, "--seconds", "1")
        else:
            controller = canarm.controller(emulator, "sync", "--seconds", "1")
        assert controller.wait() == 0, controller
        assert controller.json["state"] == "done"
        assert (controller.json["ticks"], controller.json["missed"]) == (400, 0)
        emulator.send(signal.SIGTERM)
        assert emulator.wait() == 0, emulator
        assert emulator.json["dropped_frames"] == 0
        logs.append((canarm.folder / folder / "can0.log").read_bytes())
    assert logs[0] == logs[1] == logs[2]
    assert logs[0].count(b"\n") > 400 * 6  # SYNC, two RPDOs, two TPDOs, TIME


@pytest.mark.slow
def test_the_terminal_outlives_its_clients_and_goes_with_the_emulator(canarm):
    emulator = canarm.emulator("sync", "--slcan", "can0", "--sync-timeout", "0.5")
    link = canarm.folder / "can0"
    assert channel_of(emulator) == str(link)
    killed = over_slcan(canarm, emulator)
    killed.wait_for("1 s, ")
    killed.send(signal.SIGKILL)
    emulator.wait_for(r"no SYNC for 0.5 s: virtual time ran on by \d+ ms")
    following = over_slcan(canarm, emulator, "--seconds", "1")
    assert following.wait() == 0, following
    assert following.json["state"] == "done"
    assert link.is_char_device()
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0, emulator
    assert not link.is_symlink()


@pytest.mark.parametrize(
    ("place", "status", "message"),
    [
        ("missing/can0", 1, r"missing/can0: No such file or directory; choose another PATH"),
        ("taken", 1, r"taken: that name is taken"),
        ("socket://0.0.0.0:0", 2, r"can be reached from the network"),
        ("socket://127.0.0.1", 2, r"--slcan socket://127\.0\.0\.1: write socket://HOST:PORT"),
    ],
)
def test_an_adapter_that_cannot_be_offered_says_why(canarm, place, status, message):
    (canarm.folder / "taken").touch()
    emulator = canarm("emulator", "--serve", "127.0.0.1:0", "--slcan", place)
    assert emulator.wait() == status, emulator
    emulator.wait_for(message)
    assert len(emulator.complaint.splitlines()) == 1
