"""A foreign controller: python-canopen drives the cards, which protect themselves when it is gone."""

import subprocess
import sys
from pathlib import Path

import pytest

from canarm_protocol.canopen import NmtCommand, NmtState

MASTER = Path(__file__).parents[1] / "canopen_master.py"
DAC, LATCH, ADC = 0x12, 0x13, 0x14
HEARTBEAT_LOST = 0x8130
PATIENCE_S = 60.0


@pytest.fixture
def start_master(canarm_bench, tmp_path):
    """Start the examples' master for a number of seconds of robot time."""
    export = [sys.executable, "-m", "canarm", "export", "dcf", "--out", tmp_path / "dcf"]
    subprocess.run(export, check=True, timeout=PATIENCE_S)

    def start(seconds):
        words = [tmp_path / "dcf", "--port", str(canarm_bench.port), "--seconds", str(seconds)]
        return canarm_bench.start_controller([sys.executable, MASTER, *words])

    return start


def test_the_cards_are_safe_when_the_master_dies(canarm_bench, start_master):
    master = start_master(seconds=600)
    canarm_bench.wait_for(lambda: canarm_bench.time_s > 0.5, PATIENCE_S)
    assert canarm_bench.heartbeat_state(1) is NmtState.OPERATIONAL
    assert not canarm_bench.outputs_are_zero()
    master.kill()
    canarm_bench.wait_for(canarm_bench.outputs_are_zero, PATIENCE_S)

    def lost():
        return {each.node_id for each in canarm_bench.emergencies if each.code == HEARTBEAT_LOST}

    canarm_bench.wait_for(lambda: lost() == {DAC, LATCH, ADC}, PATIENCE_S)


@pytest.mark.xfail(strict=True, reason="the example is small: it does not watch the heartbeats of the cards")
def test_the_master_stops_within_100_ms_when_the_adc_hangs(canarm_bench, start_master):
    canarm_bench.inject(f"node.0x{ADC:02X}", "hang", at=1.0)
    start_master(seconds=2).wait(PATIENCE_S)

    def stops():
        return [each.time_s for each in canarm_bench.nmt_commands if each.command is NmtCommand.STOP]

    canarm_bench.wait_for(stops, PATIENCE_S)
    assert canarm_bench.heartbeat_age_s(ADC) > 0.9
    assert stops()[0] <= 1.1
