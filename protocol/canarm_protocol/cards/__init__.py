"""The kinds of cards that a cell may hold: one descriptor each, and the registry of them."""

from .kind import CardKind, Codec, Place, Settings, Wire
from .registry import KINDS

__all__ = ["KINDS", "CardKind", "Codec", "Place", "Settings", "Wire"]
