"""Matrices of real numbers in a MATLAB 5 file, which anybody may have written: every size is checked before it is used.

`scipy.io.loadmat` is compiled code that ends the interpreter at some damaged files. Form: *MAT-File Format*, The
MathWorks, chapter 1, *Level 5*: a header of 128 bytes, then elements of a tag (type, bytes) and their content, padded
to 8 bytes, or as a stream of zlib that holds an element, with its sum of check.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError
from slamgauge.memory import require_memory

BEGINNING = b"MATLAB 5.0 MAT-file"
HEADER, TAG = 128, 8  # bytes
ORDERS = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}  # the version and the order of bytes, which end the header
INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
FULL = range(6, 16)  # classes of matrices: double, single and whole numbers
OTHERS = {1: "a cell array", 2: "a struct", 4: "text", 5: "sparse"}
IS_COMPLEX = 0x08  # of the flags
PARTS = 5  # of a matrix: flags, dimensions, name, numbers, and those below the axis of the complex plane
COPIES = 4.0  # of a matrix, alive at once


class _DamagedError(Exception):
    """The file is not as its form has it."""


class _Element(NamedTuple):
    """What follows a tag, and where the next one begins."""

    kind: int
    content: memoryview
    end: int


def read_mat(path: Path, names: Collection[str]) -> dict[str, Float]:
    """The matrices of those names that a file has, (rows, columns).

    Raises:
        UserError: no such file, a damaged one, or a matrix that is not full and real.
    """
    with explained(path, "read"):
        whole = memoryview(path.read_bytes())
    if bytes(whole[: len(BEGINNING)]) != BEGINNING:
        raise UserError(f"{path}: not a MATLAB 5 file; save it with -v7")
    matrices: dict[str, Float] = {}
    try:
        order = ORDERS.get(bytes(whole[HEADER - 4 : HEADER]), "")
        for content in _matrices(path, whole, order):
            parts = list(islice(_elements(content, order), PARTS))
            name = _name(parts)
            if name in matrices:
                raise UserError(f"{path}: field {name} stands in it twice; save it again")
            if name in names:
                matrices[name] = _matrix(path, name, parts, order)
    except (_DamagedError, zlib.error):
        raise UserError(f"{path}: damaged or cut short; copy the file again") from None
    return matrices


def _matrices(path: Path, whole: memoryview, order: str) -> Iterator[memoryview]:
    """The contents of the file's matrices, one after the other."""
    at = HEADER
    if not order or len(whole) < HEADER:
        raise _DamagedError
    while at < len(whole):
        element = _element(whole, at, order)
        at = element.end
        if element.kind == COMPRESSED:
            element = _decompressed(path, element.content, order)
        if element.kind == MATRIX:
            yield element.content


def _decompressed(path: Path, content: memoryview, order: str) -> _Element:
    """The element that a stream of zlib holds, and nothing else."""
    stream = zlib.decompressobj()
    tag = stream.decompress(content, TAG)
    if len(tag) < TAG:
        raise _DamagedError
    kind, size = struct.unpack(f"{order}II", tag)
    require_memory(COPIES * size, f"{path}: reading it", "close other programs, or give a part of it")
    inner = stream.decompress(stream.unconsumed_tail, size) if size else b""
    rest = stream.decompress(stream.unconsumed_tail, 1)  # looks at the sum, too
    if len(inner) < size or rest or not stream.eof or stream.unused_data:
        raise _DamagedError
    return _Element(kind, memoryview(inner), size)


def _elements(content: memoryview, order: str) -> Iterator[_Element]:
    """The elements of a matrix."""
    at = 0
    while at < len(content):
        yield (element := _element(content, at, order))
        at = element.end


def _element(content: memoryview, at: int, order: str) -> _Element:
    """The element at a place; one of up to 4 bytes may share its tag's."""
    if len(content) - at < TAG:
        raise _DamagedError
    first, size = struct.unpack_from(f"{order}II", content, at)
    kind, short = first & 0xFFFF, first >> 16
    if short:
        start, size, end = at + 4, short, at + TAG
    else:
        start = at + TAG
        end = start + size if kind == COMPRESSED else start + -(-size // 8) * 8
    if size > len(content) - start or short > 4:
        raise _DamagedError
    return _Element(kind, content[start : start + size], end)


def _name(parts: list[_Element]) -> str:
    """The name of a matrix of flags, dimensions, name and numbers."""
    kinds = [part.kind for part in parts[:3]]
    if kinds != [UINT32, INT32, INT8] or len(parts[0].content) != 8 or len(parts[1].content) % 4:
        raise _DamagedError
    return bytes(parts[2].content).decode("latin-1")


def _matrix(path: Path, name: str, parts: list[_Element], order: str) -> Float:
    flags = struct.unpack_from(f"{order}I", parts[0].content)[0]
    held = OTHERS.get(flags & 0xFF, "no matrix of numbers") if flags & 0xFF not in FULL else ""
    if held or flags >> 8 & IS_COMPLEX:
        raise UserError(f"{path}: field {name} is {held or 'complex'}; save a full matrix of real numbers")
    shape = tuple(np.frombuffer(parts[1].content, f"{order}i4").tolist())
    if len(shape) != 2 or min(shape) < 0:
        raise UserError(f"{path}: field {name} has shape {shape[:8]}; save a matrix of rows and columns")
    if len(parts) != 4 or parts[3].kind not in NUMBERS:
        raise _DamagedError
    dtype = np.dtype(order + NUMBERS[parts[3].kind])
    if len(parts[3].content) != math.prod(shape) * dtype.itemsize:
        raise _DamagedError
    return np.frombuffer(parts[3].content, dtype).astype(np.float64).reshape(shape, order="F")
