"""`canarm reset`: the robot of a running bench, off and on again."""

from canarm_protocol.faults.bench_client import BenchClient

from ..options import BenchAttachOptions, CellOptions


def reset(*, cell: CellOptions = CellOptions(), bench: BenchAttachOptions = BenchAttachOptions()) -> int:
    """Switch the robot of a running bench off and on again.

    Faults and emergency stop are gone, the arms parked and at rest, and every card has booted. A controller that runs
    loses its cards; the emulator, and who is attached to it, stay.
    """
    nominal, named = cell.load(), bench.named()
    with named.open() as port, BenchClient(port, nominal) as client:
        client.power_cycle()
    print("the robot was switched off and on again")
    return 0
