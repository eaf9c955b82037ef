"""The objects of one node and their rules: existence, access, size, limits.

The node and its SDO servers read and write here; the node knows what a value means.
"""

from collections.abc import Callable

from canopen.objectdictionary import INTEGER_TYPES, ODVariable
from canopen.objectdictionary.datatypes import SIGNED_TYPES

from canarm_protocol.canopen.dictionary import Dictionary, variable_at
from canarm_protocol.canopen.sdo import AbortCode

from ..errors import EmulatorError

ReadHook = Callable[[int, int], bytes | None]
WriteHook = Callable[[int, int, bytes], bool]


class SdoRefused(EmulatorError):
    """A client's access to an object is refused with an abort code of CiA 301."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


class ObjectStore:
    """Values of a node's objects, on top of the defaults of its dictionary.

    `on_read(index, subindex)` may supply a live value. `on_write(index, subindex, data)` sees every permitted write
    first, and returns True if it has passed the value on to its owner; it refuses by raising `SdoRefused`.
    """

    def __init__(self, dictionary: Dictionary, on_read: ReadHook, on_write: WriteHook) -> None:
        self.dictionary = dictionary
        self._on_read = on_read
        self._on_write = on_write
        self._values: dict[tuple[int, int], bytes] = {}
        self._saved: dict[tuple[int, int], bytes] = {}

    def read(self, index: int, subindex: int) -> bytes:
        """The object's bytes, for a client. Raises `SdoRefused`."""
        variable = self.variable(index, subindex)
        if not variable.readable:
            raise SdoRefused(AbortCode.WRITE_ONLY)
        return self._data(variable)

    def check_writable(self, index: int, subindex: int) -> None:
        """Raises `SdoRefused` where a client can write nothing at all."""
        if not self.variable(index, subindex).writable:
            raise SdoRefused(AbortCode.READ_ONLY)

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object on behalf of a client. Raises `SdoRefused`."""
        self.check_writable(index, subindex)
        variable = self.variable(index, subindex)
        if variable.fixed_size and 8 * len(data) != len(variable):
            raise SdoRefused(AbortCode.LENGTH)
        if variable.data_type in INTEGER_TYPES:
            value = int.from_bytes(data, "little", signed=variable.data_type in SIGNED_TYPES)
            if variable.max is not None and value > variable.max:
                raise SdoRefused(AbortCode.TOO_HIGH)
            if variable.min is not None and value < variable.min:
                raise SdoRefused(AbortCode.TOO_LOW)
        if not self._on_write(index, subindex, data):
            self._values[index, subindex] = data

    def number(self, index: int, subindex: int = 0) -> int:
        """The value of an integer object, for the node itself. Raises `SdoRefused` where there is none."""
        variable = self.variable(index, subindex)
        return int(variable.decode_raw(self._data(variable)))

    def optional(self, index: int, subindex: int = 0, default: int = 0) -> int:
        """The value of an integer object, or `default` where the dictionary has none."""
        return default if variable_at(self.dictionary, index, subindex) is None else self.number(index, subindex)

    def put(self, index: int, subindex: int, value: int) -> None:
        """Set an object from inside the node, bypassing access rights and hooks."""
        self._values[index, subindex] = bytes(self.variable(index, subindex).encode_raw(value))

    def reset(self, keep: Callable[[int], bool] = lambda index: False) -> None:
        """Restore saved values and defaults, except for objects whose index `keep` accepts."""
        kept = {key: value for key, value in self._values.items() if keep(key[0])}
        self._values = {key: value for key, value in self._saved.items() if not keep(key[0])} | kept

    def save(self, is_meant: Callable[[int], bool]) -> None:
        """Let the values of the objects whose index `is_meant` outlast resets."""
        self.forget_saved(is_meant)
        self._saved |= {key: value for key, value in self._values.items() if is_meant(key[0])}

    def forget_saved(self, is_meant: Callable[[int], bool]) -> None:
        """Let the next reset give those objects their defaults again."""
        self._saved = {key: value for key, value in self._saved.items() if not is_meant(key[0])}

    def variable(self, index: int, subindex: int) -> ODVariable:
        """The dictionary's entry. Raises `SdoRefused`."""
        variable = variable_at(self.dictionary, index, subindex)
        if variable is None:
            raise SdoRefused(AbortCode.NO_SUBINDEX if index in self.dictionary else AbortCode.NO_OBJECT)
        return variable

    def _data(self, variable: ODVariable) -> bytes:
        index, subindex = variable.index, variable.subindex
        live = self._on_read(index, subindex)
        if live is not None:
            return live
        stored = self._values.get((index, subindex))
        if stored is not None:
            return stored
        if variable.default is None:
            raise SdoRefused(AbortCode.NO_DATA)
        return bytes(variable.encode_raw(variable.default))
