"""Driving the cards by hand, without any input or output: commands and frames go in, frames and lines of text come out.

`Jog` is the CANopen master of a bus that has no other. It owns what is wanted of every output and what the cards said
last; the bus, the wall clock and the prompt belong to `canarm.commands.jog`.
"""

import contextlib
from collections.abc import Generator, Sequence

from canarm_controller.controller import STANDSTILL_RAD_S  # noqa: F401
from canarm_controller.errors import ControllerError
from canarm_controller.master import Ask, Conversation, Silence, bring_up, read_input, start_frames, stop_frames
from canarm_controller.pacing import Pacer
from canarm_controller.supervisor import Supervisor, Verdict
from canarm_protocol.cell import Cell, Quantity
