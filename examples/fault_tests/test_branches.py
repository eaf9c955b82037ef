"""Several futures of one run: a long beginning is run once."""


def latency_ms(rig, fault):
    """From one moment on: how long the fault is unnoticed; None if it stays so."""

    def broken(copy):
        begin_s = copy.time_s
        copy.inject("joint2.tachometer", fault)
        copy.run(0.2)
        return 1e3 * (copy.noticed[0].time_s - begin_s) if copy.noticed else None

    return rig.branch(broken)


def test_no_fault_of_a_tachometer_stays_unnoticed_for_50_ms(canarm_rig):
    rig = canarm_rig(law="mras")
    rig.run(seconds=3.0)
    latencies = {fault: latency_ms(rig, fault) for fault in ("stuck", "open-load", "short-to-supply")}
    assert all(each is not None and each <= 50.0 for each in latencies.values()), latencies
