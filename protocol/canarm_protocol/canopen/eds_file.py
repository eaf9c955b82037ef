"""Electronic data sheets and device configuration files (CiA 306), made from a dictionary or from another EDS.

Texts only. The line ends are LF and the date is fixed, so that the same input gives the same bytes.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from canopen.objectdictionary import ODArray, ODVariable, datatypes

from .dictionary import IDENTITY, Dictionary, default_value
from .pdo import pdo_numbers

Section = tuple[str, list[str]]
"""Name of a section and its `key=value` lines."""

BIT_RATES_KBIT_S = (10, 20, 50, 125, 250, 500, 800, 1000)
MANDATORY = (0x1000, 0x1001, 0x1018)
MANUFACTURER = range(0x2000, 0x6000)
DOMAIN, VAR, ARRAY, RECORD = 0x2, 0x7, 0x8, 0x9
"""Object codes (CiA 301, table 42)."""
COMMUNICATION_PROFILE = range(0x1000, 0x2000)
COMMUNICATION_ARRAYS = frozenset({0x1003, 0x1010, 0x1011, 0x1016, 0x1023, 0x1028, 0x1029})
"""The arrays among the objects of CiA 301; the others with sub-indices are records."""
_TEXT_TYPES = (datatypes.VISIBLE_STRING, datatypes.UNICODE_STRING)
_HEX_TYPES = (datatypes.UNSIGNED32,)
"""Types written in hexadecimal: COB-IDs and mapping entries are read that way."""
_DATE, _TIME = "01-01-2026", "12:00AM"


@dataclass(frozen=True, slots=True)
class DeviceText:
    """What an EDS says about a device apart from its objects."""

    file_name: str
    product_name: str
    order_code: str
    description: str


@dataclass(frozen=True, slots=True)
class Commissioning:
    """The place of one device in one network (CiA 306, [DeviceComissioning])."""

    file_name: str
    node_id: int
    node_name: str
    bitrate: int
    network_name: str
    serial_number: int


def eds_of(dictionary: Dictionary, device: DeviceText) -> str:
    """The EDS of `dictionary`. Its PDO mapping is fixed: granularity 0."""
    indices = sorted(dictionary)
    mandatory = [index for index in indices if index in MANDATORY]
    manufacturer = [index for index in indices if index in MANUFACTURER]
    optional = [index for index in indices if index not in MANDATORY and index not in MANUFACTURER]
    return _joined(
        [
            ("FileInfo", _file_info(device)),
            ("DeviceInfo", _device_info(dictionary, device)),
            ("DummyUsage", [f"Dummy{number:04d}=0" for number in range(1, 8)]),
            ("Comments", ["Lines=1", f"Line1={device.description}"]),
            ("MandatoryObjects", _object_list(mandatory)),
            ("OptionalObjects", _object_list(optional)),
            ("ManufacturerObjects", _object_list(manufacturer)),
            *(section for index in indices for section in _object_sections(index, dictionary[index])),
        ]
    )


def dcf_of(eds: str, commissioning: Commissioning, values: Mapping[tuple[int, int], int]) -> str:
    """The DCF of a device with the data sheet `eds`, set up with `values` by index and sub-index."""
    left = dict(values)
    sections: list[Section] = []
    for name, lines in _sections(eds):
        if name == "FileInfo":
            sections.append((name, _dcf_file_info(lines, commissioning.file_name)))
        elif name == "DeviceInfo":
            sections += [(name, lines), ("DeviceComissioning", _commissioning(commissioning))]
        else:
            sections.append((name, [*lines, *_parameter_value(name, lines, left)]))
    if left:
        index, subindex = min(left)
        raise ValueError(f"{commissioning.file_name}: the EDS has no object 0x{index:04X}:{subindex:02X} to be set")
    return _joined(sections)


def _file_info(device: DeviceText) -> list[str]:
    return [
        f"FileName={device.file_name}",
        "FileVersion=1",
        "FileRevision=0",
        "EDSVersion=4.0",
        f"Description={device.description}",
        f"CreationTime={_TIME}",
        f"CreationDate={_DATE}",
        "CreatedBy=canarm",
        f"ModificationTime={_TIME}",
        f"ModificationDate={_DATE}",
        "ModifiedBy=canarm",
    ]


def _device_info(dictionary: Dictionary, device: DeviceText) -> list[str]:
    vendor, product, revision = (default_value(dictionary, IDENTITY, subindex) for subindex in (1, 2, 3))
    return [
        "VendorName=canarm",
        f"VendorNumber=0x{vendor:X}",
        f"ProductName={device.product_name}",
        f"ProductNumber=0x{product:X}",
        f"RevisionNumber=0x{revision:X}",
        f"OrderCode={device.order_code}",
        *(f"BaudRate_{rate}=1" for rate in BIT_RATES_KBIT_S),
        "SimpleBootUpMaster=0",
        "SimpleBootUpSlave=1",
        "Granularity=0",
        "DynamicChannelsSupported=0",
        "GroupMessaging=0",
        f"NrOfRXPDO={len(list(pdo_numbers(dictionary, 'rpdo')))}",
        f"NrOfTXPDO={len(list(pdo_numbers(dictionary, 'tpdo')))}",
        "LSS_Supported=0",
    ]


def _object_list(indices: list[int]) -> list[str]:
    return [f"SupportedObjects={len(indices)}", *(f"{place}=0x{index:04X}" for place, index in enumerate(indices, 1))]


def _object_sections(index: int, entry: Dictionary) -> Iterator[Section]:
    if isinstance(entry, ODVariable):
        yield f"{index:04X}", _variable_lines(entry)
        return
    if index in COMMUNICATION_PROFILE:
        object_type = ARRAY if index in COMMUNICATION_ARRAYS else RECORD
    else:
        object_type = ARRAY if isinstance(entry, ODArray) else RECORD
    members = sorted(entry.subindices.items())
    yield (
        f"{index:04X}",
        [f"ParameterName={entry.name}", f"ObjectType=0x{object_type:X}", f"SubNumber={len(members)}"],
    )
    for subindex, member in members:
        yield f"{index:04X}sub{subindex:X}", _variable_lines(member)


def _variable_lines(variable: Dictionary) -> list[str]:
    is_domain = variable.data_type == datatypes.DOMAIN
    lines = [
        f"ParameterName={variable.name}",
        f"ObjectType=0x{DOMAIN if is_domain else VAR:X}",
        f"DataType=0x{variable.data_type:04X}",
        f"AccessType={variable.access_type}",
    ]
    if variable.default is not None and not is_domain:
        lines.append(f"DefaultValue={_value(variable.data_type, variable.default)}")
    lines += [
        f"{key}={limit}"
        for key, limit in (("LowLimit", variable.min), ("HighLimit", variable.max))
        if limit is not None
    ]
    # Readers refuse PDOMapping for a DOMAIN, which cannot be mapped (CiA 306).
    return lines if is_domain else [*lines, f"PDOMapping={int(variable.pdo_mappable)}"]


def _value(data_type: int, value: int | float | str) -> str:
    if data_type in _TEXT_TYPES:
        return str(value)
    if data_type in _HEX_TYPES:
        return f"0x{value:08X}"
    return f"{value:g}" if data_type in datatypes.FLOAT_TYPES else f"{int(value)}"


def _dcf_file_info(lines: list[str], file_name: str) -> list[str]:
    entries = dict(line.split("=", 1) for line in lines)
    last_eds = entries["FileName"]
    return [f"{key}={value}" for key, value in {**entries, "FileName": file_name, "LastEDS": last_eds}.items()]


def _commissioning(commissioning: Commissioning) -> list[str]:
    """The standard spells the section's name with one m."""
    return [
        f"NodeID={commissioning.node_id}",
        f"NodeName={commissioning.node_name}",
        f"Baudrate={commissioning.bitrate // 1000}",
        "NetNumber=0",
        f"NetworkName={commissioning.network_name}",
        "CANopenManager=0",
        f"LSS_SerialNumber={commissioning.serial_number}",
    ]


def _parameter_value(name: str, lines: list[str], values: dict[tuple[int, int], int]) -> Iterator[str]:
    """The ParameterValue line of section `name`, if it is a variable with a value; the value leaves `values`."""
    entries = dict(line.split("=", 1) for line in lines)
    if "DataType" in entries:
        index, _, subindex = name.partition("sub")
        value = values.pop((int(index, 16), int(subindex or "0", 16)), None)
        if value is not None:
            yield f"ParameterValue={_value(int(entries['DataType'], 0), value)}"


def _sections(text: str) -> list[Section]:
    sections: list[Section] = []
    for line in text.splitlines():
        if line.startswith("["):
            sections.append((line.strip("[]"), []))
        elif line:
            sections[-1][1].append(line)
    return sections


def _joined(sections: list[Section]) -> str:
    return "\n".join("\n".join((f"[{name}]", *lines, "")) for name, lines in sections)
