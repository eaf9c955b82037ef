"""The objects of one node and their rules: existence, access, size, limits. SDO server and slave read and write through it.

It has the face that `canopen.sdo.SdoServer` expects of its node.
"""

from collections.abc import Callable

from canarm_protocol.dictionary import Dictionary
from canopen import SdoAbortedError
from canopen.objectdictionary import INTEGER_TYPES, NUMBER_TYPES, ODVariable

UNSUPPORTED_READ, UNSUPPORTED_WRITE, NO_OBJECT, NO_SUBINDEX = 0x0601_0001, 0x0601_0002, 0x0602_0000, 0x0609_0011
WRONG_LENGTH, TOO_HIGH, TOO_LOW, NO_DATA = 0x0607_0010, 0x0609_0031, 0x0609_0032, 0x0800_0024

ReadHook = Callable[[int, int], bytes | None]
WriteHook = Callable[[int, int, bytes], bool]


class ObjectStore:
    """Values of a node's objects, on top of the defaults of its dictionary.

    `on_read(index, subindex)` may supply a live value. `on_write(index, subindex, data)` sees every permitted write first and
    returns True when it has taken the value away to its owner; it refuses with `SdoAbortedError`.
    """

    def __init__(self, dictionary: Dictionary, on_read: ReadHook, on_write: WriteHook) -> None:
        self.object_dictionary = dictionary
        self._on_read = on_read
        self._on_write = on_write
        self._values: dict[tuple[int, int], bytes] = {}

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """The object's bytes. Raises `SdoAbortedError` with the abort code of CiA 301."""
        variable = self._variable(index, subindex)
        if check_readable and not variable.readable:
            raise SdoAbortedError(UNSUPPORTED_READ)
        live = self._on_read(index, subindex)
        if live is not None:
            return live
        stored = self._values.get((index, subindex))
        if stored is not None:
            return stored
        if variable.default is None:
            raise SdoAbortedError(NO_DATA)
        return bytes(variable.encode_raw(variable.default))

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """Write an object on behalf of a client. Raises `SdoAbortedError` with the abort code of CiA 301."""
        variable = self._variable(index, subindex)
        data = bytes(data)
        if check_writable and not variable.writable:
            raise SdoAbortedError(UNSUPPORTED_WRITE)
        if variable.data_type in NUMBER_TYPES and 8 * len(data) != len(variable):
            raise SdoAbortedError(WRONG_LENGTH)
        if variable.data_type in INTEGER_TYPES:
            value = variable.decode_raw(data)
            if variable.max is not None and value > variable.max:
                raise SdoAbortedError(TOO_HIGH)
            if variable.min is not None and value < variable.min:
                raise SdoAbortedError(TOO_LOW)
        if not self._on_write(index, subindex, data):
            self._values[index, subindex] = data

    def number(self, index: int, subindex: int = 0) -> int:
        """The value of an integer object."""
        variable = self._variable(index, subindex)
        return int(variable.decode_raw(self.get_data(index, subindex)))

    def put(self, index: int, subindex: int, value: int) -> None:
        """Set an object from inside the node, past access rights and hooks."""
        self._values[index, subindex] = bytes(self._variable(index, subindex).encode_raw(value))

    def reset(self, keep: Callable[[int], bool] = lambda index: False) -> None:
        """Back to the defaults, but for the objects whose index is to `keep`."""
        self._values = {key: value for key, value in self._values.items() if keep(key[0])}

    def _variable(self, index: int, subindex: int) -> ODVariable:
        if index not in self.object_dictionary:
            raise SdoAbortedError(NO_OBJECT)
        entry = self.object_dictionary[index]
        if isinstance(entry, ODVariable):
            if subindex:
                raise SdoAbortedError(NO_SUBINDEX)
            return entry
        if subindex not in entry.subindices:
            raise SdoAbortedError(NO_SUBINDEX)
        return entry[subindex]
