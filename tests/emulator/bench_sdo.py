"""SDO clients of a bench node in this process, for tests."""

import json
import struct
from typing import Any

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import SdoAborted, Transfer, download, upload
from canarm_protocol.cell import bench_objects as objects

NODE = 0x70


class Client:
    """A client of the bench node's on one SDO channel, as one of several on the bus."""

    def __init__(self, bench: FaultBench, channel: int, origin: object) -> None:
        self.bench, self.channel, self.origin = bench, channel, origin

    def request(self, data: bytes, channel: int | None = None) -> bytes | None:
        """The answer to one request; None if there is none."""
        request_id, answer_id = objects.sdo_channel(NODE, self.channel if channel is None else channel)
        before = len(self.bench.bench_records)
        self.bench.receive_bench(Frame(request_id, data), self.origin)
        answers = [each.frame for each in self.bench.bench_records[before:] if each.frame.can_id == answer_id]
        assert len(answers) <= 1
        return answers[0].data if answers else None

    def run(self, transfer: Transfer, channel: int | None = None) -> bytes:
        return self.go_on(transfer, next(transfer), channel)

    def go_on(self, transfer: Transfer, data: bytes, channel: int | None = None) -> bytes:
        while True:
            answer = self.request(data, channel)
            assert answer is not None, "no answer"
            try:
                data = transfer.send(answer)
            except StopIteration as done:
                return bytes(done.value)

    def inject(self, text: str) -> None:
        self.run(download(objects.FAULT_SET, 0, text.encode()))

    def read(self, index: int, subindex: int = 0) -> bytes:
        return self.run(upload(index, subindex))

    def text(self, index: int) -> str:
        return self.read(index).decode("ascii")

    def status(self) -> dict[str, Any]:
        return dict(json.loads(self.text(objects.FAULT_STATUS)))

    def claim(self, channel: int, token: int) -> int:
        """The abort code of a claim, 0 where it was granted."""
        try:
            self.run(download(objects.CHANNEL_OWNER, channel, struct.pack("<I", token)), objects.CLAIM_CHANNEL)
        except SdoAborted as error:
            return error.code
        self.channel = channel
        return 0
