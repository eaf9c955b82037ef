"""The bench node's object dictionary: what the test bench knows of a run, on its own bus.

One node, built for the number of joints of a cell. It sends truth and assessment. The controller writes reference,
measurements and the law's internals; any client writes faults and the emergency stop, and may read everything by SDO.
The COB-IDs here belong to the bench bus alone.
"""

from dataclasses import dataclass
from typing import Any

from canopen import ObjectDictionary
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes

from ..canopen.dictionary import CLOCK_MODE, Dictionary, default_value
from ..canopen.pdo import MappedObject, PdoLayout, read_layouts
from .model import Cell

CYCLE, TRUE_ANGLE, TRUE_SPEED, TRUE_CURRENT, TRUE_COMMAND = 0x2001, 0x2100, 0x2101, 0x2102, 0x2103
TICK, LATE, CONTROLLER_STATE, LAW_NAME, OUTCOME, RUN_TICKS, PACE = range(0x2110, 0x2117)
REFERENCE, MEASURED_ANGLE, MEASURED_SPEED, CURRENT_COMMAND, FEED_FORWARD = 0x2120, 0x2121, 0x2122, 0x2123, 0x2124
INTERNAL_NAME, INTERNAL = 0x2130, 0x2131
DETECTION_PIECE, DETECTIONS, DETECTION_EVENTS, PACKED_DETECTIONS, BROKEN_DETECTIONS = range(0x2140, 0x2145)
"""Of the controller's detections: eight bytes of text, how many so far, the last ones, the same packed with zlib, and
texts that could not be put together."""
RMS_ERROR, MAX_ERROR, PEAK_CURRENT, SATURATED_CYCLES, SPEED_RIPPLE = 0x2200, 0x2201, 0x2202, 0x2203, 0x2204
REFUSED_DIRECTIONS = 0x2205
ASSESSED_CYCLES = 0x2210
BUS_LOAD, TOTAL_BUS_LOAD, WORST_RESPONSE, WORST_COB_ID, ERROR_FRAMES, LOST_FRAMES = range(0x2300, 0x2306)
TRANSMIT_ERRORS, RECEIVE_ERRORS, ERROR_STATE = 0x2310, 0x2311, 0x2312
DROPPED_FRAMES, ATTACHED_CLIENTS = 0x2320, 0x2321
FAULT_SET, FAULT_RESULT, FAULT_STATUS, FAULT_CATALOGUE, FAULT_EVENTS = range(0x2400, 0x2405)
ACTIVE_FAULTS, BEGUN_FAULTS = 0x2405, 0x2406
PACKED_CATALOGUE, PACKED_EVENTS = 0x2407, 0x2408
"""FAULT_CATALOGUE and FAULT_EVENTS packed with zlib: reading them during a run takes a tenth of the frames."""
EMERGENCY_STOP, POWER_CYCLE, RECORDING, RECORD_PLACE = range(0x2410, 0x2414)
CHANNEL_OWNER = 0x2420
"""Sub-index n holds the token of the client that has claimed SDO channel n; 0 for none."""
BUSES = "can0", "bench"
"""The sub-indices 1 and 2 of DROPPED_FRAMES and ATTACHED_CLIENTS."""
HOMING = 6
CONTROLLER_STATES: dict[int, str] = {
    0: "idle",
    1: "bringing up",
    2: "running",
    3: "stopping",
    4: "done",
    5: "failed",
    HOMING: "homing",
}
"""The values of CONTROLLER_STATE in words."""
ENDED = ("done", "failed")
LONGEST_OUTCOME = 4000
"""Bytes that OUTCOME takes."""
INTERNALS = 4
"""Internal quantities of a law per joint: 0x2131 to 0x2134, named in 0x2130."""
SDO_CHANNELS = 9
"""SDO channels besides the default one (0x1201 and up), one per client: two clients on one channel collide."""
CONTROLLER_CHANNEL = 1
CLIENT_CHANNELS = range(2, 9)
"""The channels that clients claim: a client writes its token to CHANNEL_OWNER over CLAIM_CHANNEL and reads it back."""
CLAIM_CHANNEL = 9
"""Carries claims only. They are expedited, so any number of clients may use it at the same time."""
CLAIM_S = 10.0
"""A client that has been silent for this long (wall clock) loses its channel to the next one that claims it."""
MOST_EVENTS = 100
"""FAULT_EVENTS and DETECTION_EVENTS show the last this many."""
SETTLING_CYCLES = 1024
"""Cycles at the start of a run that its assessment leaves out, while the motion blends in."""
DIVIDER = 4
"""Telemetry goes out every 4th cycle (100 Hz at 2.5 ms) while somebody listens."""

_U8, _U16, _U32, _U64 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32, datatypes.UNSIGNED64
_F32 = datatypes.REAL32
_TEXT = datatypes.VISIBLE_STRING
_EVENT_DRIVEN = 255
_JOINT_OBJECTS = (
    (TRUE_ANGLE, "True joint angle, rad", "ro", _F32),
    (TRUE_SPEED, "True joint speed, rad/s", "ro", _F32),
    (TRUE_CURRENT, "Motor current, A", "ro", _F32),
    (TRUE_COMMAND, "Amplifier command, A", "ro", _F32),
    (REFERENCE, "Reference angle, rad", "rw", _F32),
    (MEASURED_ANGLE, "Measured joint angle, rad", "rw", _F32),
    (MEASURED_SPEED, "Measured joint speed, rad/s", "rw", _F32),
    (CURRENT_COMMAND, "Current asked for by the law, A", "rw", _F32),
    (FEED_FORWARD, "Feed-forward torque, N m", "rw", _F32),
    *((INTERNAL + k, f"Internal quantity {k + 1} of the law", "rw", _F32) for k in range(INTERNALS)),
    (RMS_ERROR, "RMS of true minus reference, LSB", "ro", _F32),
    (MAX_ERROR, "Greatest true minus reference, LSB", "ro", _F32),
    (PEAK_CURRENT, "Peak of motor current, A", "ro", _F32),
    (SATURATED_CYCLES, "Cycles in which the amplifier was at its limit", "ro", _U32),
    (REFUSED_DIRECTIONS, "How often the bridge was asked for both directions at once", "ro", _U32),
    (SPEED_RIPPLE, "Speed ripple on stretches of constant reference speed, standard deviation over mean", "ro", _F32),
)
_BUS_OBJECTS = (
    (BUS_LOAD, "Load of the robot's bus in the last second (0 to 1)", _F32),
    (TOTAL_BUS_LOAD, "Load of the robot's bus since start (0 to 1)", _F32),
    (WORST_RESPONSE, "Longest time from offer to last bit of a frame, us", _F32),
    (WORST_COB_ID, "COB-ID of the frame that took longest", _U32),
    (ERROR_FRAMES, "Error frames so far", _U32),
    (LOST_FRAMES, "Frames lost in bus-off so far", _U32),
)
_CARD_OBJECTS = (
    (TRANSMIT_ERRORS, "Transmit error counter of a card", _U16),
    (RECEIVE_ERRORS, "Receive error counter of a card", _U16),
    (ERROR_STATE, "Error state of a card (0 error-active / 1 error-passive / 2 bus-off)", _U8),
)
_FAULT_OBJECTS = (
    (FAULT_SET, "Fault set to be done, as TOML", "wo", datatypes.DOMAIN),
    (FAULT_RESULT, "What became of the last fault set that came on the same SDO channel", "ro", _TEXT),
    (FAULT_STATUS, "Fault sets and active faults, as JSON", "ro", _TEXT),
    (FAULT_CATALOGUE, "Taps and the faults that each supports, as JSON", "ro", _TEXT),
    (FAULT_EVENTS, f"Last {MOST_EVENTS} beginnings and ends of faults, a line of JSON each", "ro", _TEXT),
    (PACKED_CATALOGUE, "0x2403 packed with zlib", "ro", datatypes.DOMAIN),
    (PACKED_EVENTS, "0x2404 packed with zlib", "ro", datatypes.DOMAIN),
)
_DETECTION_OBJECTS = (
    (DETECTION_EVENTS, f"Last {MOST_EVENTS} detections, a line of JSON each", "ro", _TEXT),
    (PACKED_DETECTIONS, "0x2142 packed with zlib", "ro", datatypes.DOMAIN),
)
_CLIENT_OBJECTS = (
    (DROPPED_FRAMES, "Frames dropped for slow clients of a bus", _U32),
    (ATTACHED_CLIENTS, "Clients attached to a bus", _U16),
)


def sdo_channel(node_id: int, channel: int) -> tuple[int, int]:
    """COB-IDs (client to server, server to client) of an SDO channel of the bench node; 0 is the default one."""
    if channel == 0:
        return 0x600 + node_id, 0x580 + node_id
    if not 1 <= channel <= SDO_CHANNELS:
        raise ValueError(f"SDO channel {channel}: the bench has channels 0 to {SDO_CHANNELS}")
    return 0x630 + channel, 0x5B0 + channel


def bench_dictionary(cell: Cell) -> Dictionary:
    """The dictionary of the bench node for the joints of `cell`, with the defaults of its PDOs."""
    dictionary: Dictionary = ObjectDictionary()
    node_id = cell.bus.bench_node_id
    _variable(dictionary, 0x1000, "Device type", _U32, "ro", 0)
    _variable(dictionary, 0x1001, "Error register", _U8, "ro", 0)
    _array(dictionary, 0x1003, "Pre-defined error field", _U32, "ro", 4)
    dictionary[0x1003][0].default, dictionary[0x1003][0].access_type = 0, "rw"
    _array(dictionary, 0x1016, "Consumer heartbeat time", _U32, "rw", 1)
    _variable(dictionary, 0x1017, "Producer heartbeat time", _U16, "rw", 0)
    _array(dictionary, 0x1018, "Identity object", _U32, "ro", 4)
    dictionary[0x1018][2].default = 0xBE7C
    _array(dictionary, 0x1029, "Error behaviour", _U8, "rw", 1, default=1)
    dictionary[0x1029][1].max = 2
    for channel in range(SDO_CHANNELS + 1):
        record = _array(dictionary, 0x1200 + channel, "SDO server parameter", _U32, "ro", 2)
        record[1].default, record[2].default = sdo_channel(node_id, channel)
    _variable(dictionary, CLOCK_MODE, "Clock of the emulated world (0 wall, 1 lockstep)", _U8, "ro", 0)
    _variable(dictionary, CYCLE, "Cycles since NMT start", _U32, "ro", 0, mappable=True)
    _variable(dictionary, TICK, "Controller's tick", _U32, "rw", 0, mappable=True)
    _variable(dictionary, LATE, "Controller's late and missed cycles", _U16, "rw", 0, mappable=True)
    _variable(dictionary, CONTROLLER_STATE, "Controller's state", _U8, "rw", 0, mappable=True)
    _variable(dictionary, LAW_NAME, "Name of the controller's law", _TEXT, "rw", "")
    _variable(dictionary, OUTCOME, "How the controller's run has ended, as text", datatypes.DOMAIN, "rw", None)
    _variable(dictionary, RUN_TICKS, "Ticks that the controller's run is to last, 0 if not known", _U32, "rw", 0)
    _variable(dictionary, PACE, "Pace set for lockstep, times real time, 0 if none is set", _F32, "rw", 0)
    _array(dictionary, INTERNAL_NAME, "Name of an internal quantity of the law", _TEXT, "rw", INTERNALS)
    joints = len(cell.joints)
    for index, name, access, data_type in _JOINT_OBJECTS:
        _array(dictionary, index, name, data_type, access, joints, mappable=True)
    _variable(
        dictionary, DETECTION_PIECE, "Next 8 bytes of a detection of the controller", _U64, "wo", 0, mappable=True
    )
    _variable(
        dictionary, DETECTIONS, "Detections of the controller so far, 65535 for more", _U16, "ro", 0, mappable=True
    )
    for index, name, access, data_type in _DETECTION_OBJECTS:
        _variable(dictionary, index, name, data_type, access, None if data_type == datatypes.DOMAIN else "")
    _variable(dictionary, BROKEN_DETECTIONS, "Detections that could not be put together", _U16, "ro", 0)
    _variable(dictionary, ASSESSED_CYCLES, "Cycles assessed", _U32, "ro", 0)
    for index, name, data_type in _BUS_OBJECTS:
        _variable(dictionary, index, name, data_type, "ro", 0, mappable=True)
    for index, name, data_type in _CARD_OBJECTS:
        _array(dictionary, index, name, data_type, "ro", len(cell.card), mappable=True)
    for index, name, data_type in _CLIENT_OBJECTS:
        _array(dictionary, index, name, data_type, "ro", len(BUSES), mappable=True)
    for index, name, access, data_type in _FAULT_OBJECTS:
        _variable(dictionary, index, name, data_type, access, None if data_type == datatypes.DOMAIN else "")
    _variable(dictionary, ACTIVE_FAULTS, "Faults that act now, 255 for more", _U8, "ro", 0, mappable=True)
    _variable(dictionary, BEGUN_FAULTS, "Faults that have begun so far", _U32, "ro", 0, mappable=True)
    _variable(
        dictionary, EMERGENCY_STOP, "Emergency stop (1 opens all amplifiers' supply)", _U8, "rw", 0, mappable=True
    )
    dictionary[EMERGENCY_STOP].max = 1
    _variable(dictionary, POWER_CYCLE, "Power cycle (1 switches the robot off and on again)", _U8, "rw", 0)
    dictionary[POWER_CYCLE].max = 1
    _variable(dictionary, RECORDING, "Recording of frames and signals (1 on, 0 off)", _U8, "rw", 0)
    dictionary[RECORDING].max = 1
    _variable(dictionary, RECORD_PLACE, "Folder of the record, or why there is none", _TEXT, "ro", "")
    _array(dictionary, CHANNEL_OWNER, "Token of the client that has claimed the SDO channel", _U32, "rw", SDO_CHANNELS)
    for channel in (CONTROLLER_CHANNEL, CLAIM_CHANNEL):
        dictionary[CHANNEL_OWNER][channel].access_type = "ro"
    _add_pdos(dictionary, node_id, joints)
    return dictionary


def _add_pdos(dictionary: Dictionary, node_id: int, joints: int) -> None:
    transmit = [(0x180 + node_id, [(CYCLE, 0)])]
    receive = [
        (0x200 + node_id, [(TICK, 0), (LATE, 0), (CONTROLLER_STATE, 0)]),
        (0x300 + node_id, [(DETECTION_PIECE, 0)]),
    ]
    for joint in range(1, joints + 1):
        pair = 2 * (joint - 1)
        transmit.append((0x200 + pair, [(TRUE_ANGLE, joint), (TRUE_SPEED, joint)]))
        transmit.append((0x201 + pair, [(TRUE_CURRENT, joint), (TRUE_COMMAND, joint)]))
        receive.append((0x240 + joint - 1, [(TICK, 0), (REFERENCE, joint)]))
        receive.append((0x280 + pair, [(MEASURED_ANGLE, joint), (MEASURED_SPEED, joint)]))
        receive.append((0x281 + pair, [(CURRENT_COMMAND, joint), (FEED_FORWARD, joint)]))
        receive.append((0x2C0 + pair, [(INTERNAL, joint), (INTERNAL + 1, joint)]))
        receive.append((0x2C1 + pair, [(INTERNAL + 2, joint), (INTERNAL + 3, joint)]))
    transmit.append((0x380 + node_id, [(BUS_LOAD, 0), (ERROR_FRAMES, 0)]))
    transmit.append((0x480 + node_id, [(ACTIVE_FAULTS, 0), (EMERGENCY_STOP, 0), (BEGUN_FAULTS, 0), (DETECTIONS, 0)]))
    for communication, mapping, pdos in ((0x1800, 0x1A00, transmit), (0x1400, 0x1600, receive)):
        for number, (cob_id, objects) in enumerate(pdos):
            record = _array(dictionary, communication + number, "PDO communication parameter", _U32, "ro", 2)
            record[1].default, record[2].default = cob_id, _EVENT_DRIVEN
            record[2].data_type = _U8
            entries = _array(dictionary, mapping + number, "PDO mapping parameter", _U32, "ro", len(objects))
            for position, (index, subindex) in enumerate(objects, start=1):
                bits = len(dictionary.get_variable(index, subindex))
                entries[position].default = index << 16 | subindex << 8 | bits


@dataclass(frozen=True)
class BenchPdos:
    """The bench node's PDOs by what they carry, in lists with one per joint where they belong to a joint."""

    status: PdoLayout
    truth: tuple[PdoLayout, ...]
    drive: tuple[PdoLayout, ...]
    bus: PdoLayout
    """Sent if the wire model runs."""
    faults: PdoLayout
    """Number of active faults, emergency stop, faults begun and detections so far."""
    controller: PdoLayout
    reference: tuple[PdoLayout, ...]
    measured: tuple[PdoLayout, ...]
    command: tuple[PdoLayout, ...]
    internals: tuple[tuple[PdoLayout, PdoLayout], ...]
    detection: PdoLayout


def bench_pdos(cell: Cell) -> BenchPdos:
    """The bench node's PDO layouts, looked up by their first object (the controller's report by its last)."""
    dictionary = bench_dictionary(cell)

    def read(index: int, subindex: int) -> int:
        return default_value(dictionary, index, subindex)

    transmit = {_key(layout.objects[0]): layout for layout in read_layouts(dictionary, "tpdo", read)}
    receive = {_key(layout.objects[-1]): layout for layout in read_layouts(dictionary, "rpdo", read)}
    joints = range(1, len(cell.joints) + 1)
    return BenchPdos(
        status=transmit[CYCLE, 0],
        truth=tuple(transmit[TRUE_ANGLE, joint] for joint in joints),
        drive=tuple(transmit[TRUE_CURRENT, joint] for joint in joints),
        bus=transmit[BUS_LOAD, 0],
        faults=transmit[ACTIVE_FAULTS, 0],
        controller=receive[CONTROLLER_STATE, 0],
        reference=tuple(receive[REFERENCE, joint] for joint in joints),
        measured=tuple(receive[MEASURED_SPEED, joint] for joint in joints),
        command=tuple(receive[FEED_FORWARD, joint] for joint in joints),
        internals=tuple((receive[INTERNAL + 1, joint], receive[INTERNAL + 3, joint]) for joint in joints),
        detection=receive[DETECTION_PIECE, 0],
    )


def _key(mapped: MappedObject) -> tuple[int, int]:
    return mapped.index, mapped.subindex


def _variable(
    dictionary: Dictionary,
    index: int,
    name: str,
    data_type: int,
    access: str,
    default: int | str | None,
    mappable: bool = False,
) -> None:
    dictionary.add_object(_make(name, index, 0, data_type, access, default, mappable))


def _array(
    dictionary: Dictionary,
    index: int,
    name: str,
    data_type: int,
    access: str,
    count: int,
    default: int = 0,
    mappable: bool = False,
) -> Dictionary:
    entry = (ODRecord if index < 0x2000 else ODArray)(name, index)
    entry.add_member(_make("Highest sub-index supported", index, 0, _U8, "ro", count, False))
    for subindex in range(1, count + 1):
        initial = "" if data_type == datatypes.VISIBLE_STRING else default
        entry.add_member(_make(f"{name} {subindex}", index, subindex, data_type, access, initial, mappable))
    dictionary.add_object(entry)
    return entry


def _make(
    name: str, index: int, subindex: int, data_type: int, access: str, default: int | str | None, mappable: bool
) -> Any:
    variable: Any = ODVariable(name, index, subindex)
    variable.data_type, variable.access_type, variable.pdo_mappable = data_type, access, mappable
    variable.default = default
    return variable
