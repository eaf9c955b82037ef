"""Errors of the contract between the programs: every message says what is wrong, where, and what would be right."""


class ProtocolError(Exception):
    """Base of every error raised by `canarm_protocol`."""


class CellError(ProtocolError):
    """A cell file, or a key laid over it, is wrong."""


class DictionaryError(ProtocolError):
    """An EDS file or a PDO mapping in it cannot be used."""


class FrameError(ProtocolError):
    """A frame or a line of text does not follow its protocol."""


class BusError(ProtocolError):
    """A CAN bus cannot be opened, or is lost."""


class FaultError(ProtocolError):
    """A fault file, a set of faults or one of their conditions is wrong, or not supported where it is to act."""
