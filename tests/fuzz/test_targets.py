"""A few thousand mutated inputs at every door; `make fuzz` does the same with millions, guided by coverage."""

import importlib.util
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

_spec = importlib.util.spec_from_file_location("fuzz_targets", Path(__file__).parent / "targets.py")
assert _spec is not None
assert _spec.loader is not None
targets = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(targets)

INPUTS = 1500


def mutated(seeds: list[bytes], count: int, seed: int) -> Iterator[bytes]:
    """Seeds with bytes changed, cut, repeated and joined; and noise."""
    choose = random.Random(seed)
    for _ in range(count):
        data = bytearray(choose.choice(seeds))
        for _ in range(choose.randint(0, 6)):
            at = choose.randint(0, len(data))
            match choose.randint(0, 4):
                case 0:
                    data[at:at] = choose.randbytes(choose.randint(1, 8))
                case 1:
                    del data[at : at + choose.randint(1, 16)]
                case 2:
                    data[at:at] = data[choose.randint(0, at) : at]
                case 3:
                    data[at : at + 1] = bytes((choose.randint(0, 255),))
                case _:
                    data += choose.choice(seeds)
        yield bytes(data) if choose.random() < 0.9 else choose.randbytes(choose.randint(0, 64))


@pytest.mark.parametrize("name", targets.TARGETS)
def test_nothing_that_a_stranger_says_escapes(name: str) -> None:
    for data in mutated(targets.SEEDS[name], INPUTS, seed=1):
        targets.TARGETS[name](data)
