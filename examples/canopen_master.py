"""A foreign master: python-canopen's stock library drives the cards from the DCFs of the cell.

    canarm emulator --clock sync                     (or --clock wall)
    canarm export dcf --out dcf
    python examples/canopen_master.py dcf

moves joint 2 to 40 degrees and holds joint 3, for 2 s, and ends with status 0 when joint 2 has arrived.
"""

import argparse
import math
import queue
import sys
import time
from pathlib import Path

import canopen

CARDS = ("dac", "latch", "adc")
GOALS_RAD = [math.radians(40.0), 0.0]
TOLERANCE_RAD = math.radians(5.0)
STIFFNESS_A_RAD, DAMPING_A_S_RAD = (12.0, 5.0), (0.8, 0.3)
CYCLE_S, HEARTBEAT_CYCLES = 0.0025, 8
POT_RAD, TACHO_RAD_S, AMPLIFIER_A = math.radians(270.0) / 255, 2.5 / 127.5, 1.5 / 255  # of one code


def drive(network: canopen.Network, folder: Path, seconds: float) -> float:
    """Joint 2 in rad after `seconds`."""
    dac, latch, adc = (
        network.add_node(canopen.RemoteNode(None, str(folder / f"konkuk1_{card}.dcf"))) for card in CARDS
    )
    for node in (dac, latch, adc):
        with node.nmt.state_update:  # held until the wait begins: the boot-up comes at once
            node.nmt.state = "RESET"
            node.nmt.wait_for_bootup(5.0)
        node.load_configuration()  # PDOs, heartbeat monitoring, error values: all of it stands in the DCF
    is_lockstep = adc.sdo[0x2000].raw == 1
    time_objects: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    network.subscribe(0x100, lambda can_id, data, timestamp: time_objects.put(data))
    network.nmt.state = "OPERATIONAL"
    next_s = time.monotonic()
    for tick in range(round(seconds / CYCLE_S)):
        if tick % HEARTBEAT_CYCLES == 0:
            network.send_message(0x701, b"\x05")
        network.sync.transmit()
        if is_lockstep:
            time_objects.get(timeout=5.0)  # TIME ends the cycle: every input is here
        else:
            next_s = max(next_s + CYCLE_S, time.monotonic())
            time.sleep(max(next_s - time.monotonic(), 0.0))
        codes = [variable.raw >> 7 for variable in adc.tpdo[2]]  # two potentiometers, two tachometers
        directions = 0
        for joint, goal in enumerate(GOALS_RAD):
            angle, speed = (codes[joint] - 127.5) * POT_RAD, (codes[joint + 2] - 127.5) * TACHO_RAD_S
            current = STIFFNESS_A_RAD[joint] * (goal - angle) - DAMPING_A_S_RAD[joint] * speed
            dac.rpdo[2][joint].raw = min(round(abs(current) / AMPLIFIER_A), 255) << 7
            directions |= (0b10 if current > 0.0 else 0b01) << 2 * joint
        latch.rpdo[1][0].raw = directions
        dac.rpdo[2].transmit()
        latch.rpdo[1].transmit()
    return (adc.tpdo[2][0].raw / 128 - 127.5) * POT_RAD


def main() -> int:
    parser = argparse.ArgumentParser(description="Drive the cards of konkuk1 with python-canopen.")
    parser.add_argument("folder", type=Path, help="where `canarm export dcf --out FOLDER` has written")
    parser.add_argument("--interface", default="canarm", help="python-can's: canarm, socketcand, socketcan, ...")
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=29536)
    parser.add_argument("--seconds", type=float, default=2.0)
    given = parser.parse_args()
    missing = [name for name in (f"konkuk1_{card}.dcf" for card in CARDS) if not (given.folder / name).is_file()]
    if missing:
        parser.error(f"{given.folder} has no {missing[0]}; write it with: canarm export dcf --out {given.folder}")
    where = {} if given.interface == "socketcan" else {"host": given.host, "port": given.port}
    with canopen.Network().connect(interface=given.interface, channel=given.channel, **where) as network:
        try:
            angle = drive(network, given.folder, given.seconds)
        finally:
            network.nmt.state = "STOPPED"  # outputs take their error values: current 0, direction off
            network.nmt.state = "PRE-OPERATIONAL"
    print(f"joint 2 is at {math.degrees(angle):.1f} deg")
    return 0 if abs(angle - GOALS_RAD[0]) < TOLERANCE_RAD else 1


if __name__ == "__main__":
    sys.exit(main())
