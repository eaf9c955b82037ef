"""Frames in words: which message of which node, its signals in units, and the bits that they take.

What is known of a bus is a `Book`: of a cell, of EDS files, of DBC files. Nothing here is ever sent.
"""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .book import Book
    from .decoder import Decoder, raw_text
    from .meaning import Field, Meaning, Sort
    from .of_cell import bench_book, robot_book

__all__ = ["Book", "Decoder", "Field", "Meaning", "Sort", "bench_book", "raw_text", "robot_book"]

__getattr__ = loader(__name__, __all__, ".meaning", ".book", ".decoder", ".of_cell")
