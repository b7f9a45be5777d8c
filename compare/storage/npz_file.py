"""npz files that anybody may have written: what is in them is known from their headers before room is made for it.

Read is what `numpy.savez` and `numpy.savez_compressed` write of plain arrays: numbers, truth values and texts. Their
sums of check are the zip file's own; a damaged array is never returned.
"""

from __future__ import annotations

import errno
import io
import math
import os
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from slamgauge.arrays import CHUNK, freeze
from slamgauge.errors import UserError
from slamgauge.memory import require_memory

PLAIN = "biufU"  # kinds of numpy types: truth values, whole numbers, real ones, texts
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what numpy writes
LONGEST_HEADER = 10_000  # bytes of what stands before the numbers
TOGETHER = 1 << 20  # bytes that are unpacked at a time
LAST_RECORD = 22  # bytes
MANY = 0xFFFF  # members, or more: then another record counts them
COPIES = 3.0  # of the arrays, alive at once while a record of them is checked

NONE_KNOWN: Mapping[str, NDArray[Any]] = {}

_BROKEN = (  # what a damaged or foreign file raises
    ValueError,
    EOFError,
    KeyError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


class _Header(NamedTuple):
    """What is said of an array before its numbers begin at `start`."""

    start: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    is_fortran: bool

    @property
    def size(self) -> int:
        """Bytes of the numbers."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def may_be_one(self) -> bool:
        """Whether it may be a matrix that stands for all rows, which needs no room for all of them."""
        return len(self.shape) == 3 and self.shape[0] > 1 and not self.is_fortran

    def may_be(self, array: NDArray[Any] | None) -> bool:
        """Whether it may be one that is there already, which needs no room either."""
        if array is None or self.is_fortran or not array.flags.c_contiguous:
            return False
        return (array.dtype, array.shape) == (self.dtype, self.shape) and array.size > 0


def read_npz(path: Path, known: Mapping[str, NDArray[Any]] = NONE_KNOWN) -> dict[str, NDArray[Any]]:
    """The arrays of an npz file by name, read-only.

    Args:
        path: of the file.
        known: arrays that are there already, by the names under which the file may have the same: then they are
            returned themselves.

    Raises:
        UserError: no such file, a damaged one, one of other things than plain arrays, or one that memory cannot hold.
        OSError: the system cannot read it.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _require_whole_directory(path, members)
            if len({member.filename for member in members}) < len(members):
                raise _OddError("a name stands in it twice")
            headers = {member.filename.removesuffix(".npy"): _header(archive, member) for member in members}
            spared = {name for name, head in headers.items() if head.may_be_one or head.may_be(known.get(name))}
            arrays, size = {}, sum(head.size for name, head in headers.items() if name not in spared)
            for member, (name, head) in zip(members, headers.items(), strict=True):
                _require_room(path, size)
                array = _spared(archive, member, head, known.get(name)) if name in spared else None
                if array is None:
                    size += head.size if name in spared else 0
                    _require_room(path, size)
                    array = _array(archive, member, head)
                arrays[name] = array
            return arrays
    except (UserError, OSError) as error:
        if not isinstance(error, OSError) or error.errno != errno.EINVAL:  # that is a place which no file has
            raise
        why = ""
    except _BROKEN as error:
        why = f" ({error})" if isinstance(error, _OddError) else ""
    raise UserError(f"{path}: not a whole npz file of plain arrays{why}; write it again with numpy.savez")


class _OddError(ValueError):
    """What about the file is no business of `numpy.savez`."""


def _require_whole_directory(path: Path, members: list[zipfile.ZipInfo]) -> None:
    """Refuse a file whose last record counts more members than were found, which `zipfile` does not look at."""
    with path.open("rb") as file:
        file.seek(-LAST_RECORD, os.SEEK_END)
        last = file.read(LAST_RECORD)
    count = struct.unpack_from("<H", last, 10)[0]
    if not last.startswith(b"PK\5\6") or count not in (len(members), MANY):
        raise _OddError("its directory is not whole")


def _header(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> _Header:
    """What the file says of an array, if that is true and the array plain."""
    name = member.filename.removesuffix(".npy")
    if name == member.filename:
        raise _OddError(f"{name[:40]!r} is no array")
    if member.compress_type not in METHODS:
        raise _OddError(f"{name[:40]!r} is not compressed as numpy does it")
    with archive.open(member) as stream:
        begin = io.BytesIO(stream.read(LONGEST_HEADER))
    read_header = npy.read_array_header_1_0 if npy.read_magic(begin) == (1, 0) else npy.read_array_header_2_0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about Python 2
        try:
            shape, is_fortran, dtype = read_header(begin, max_header_size=LONGEST_HEADER)
        except (MemoryError, TypeError) as error:  # what is nested too deeply for Python, or no type
            raise ValueError from error
    if dtype.kind not in PLAIN:
        raise _OddError(f"{name[:40]!r} is of type {dtype.name}")
    if min(shape, default=0) < 0 or begin.tell() + math.prod(shape) * dtype.itemsize != member.file_size:
        raise _OddError(f"{name[:40]!r} has not the size that it says")
    return _Header(begin.tell(), dtype, shape, is_fortran)


def _require_room(path: Path, size: int) -> None:
    """Refuse arrays of so many bytes if memory does not hold what is made of them."""
    require_memory(COPIES * size, f"{path}: reading it", "close other programs, or give a part of it")


def _spared(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, header: _Header, known: NDArray[Any] | None
) -> NDArray[Any] | None:
    """The array if it needs no room of its own, else None."""
    if known is None or not header.may_be(known):
        return _one_for_all(archive, member, header)
    return known if _is_the_same(archive, member, header, known) else None


def _is_the_same(archive: zipfile.ZipFile, member: zipfile.ZipInfo, header: _Header, array: NDArray[Any]) -> bool:
    """Whether the file has the numbers of an array of that type and shape."""
    numbers = array.reshape(-1).view(np.uint8).data
    with archive.open(member) as stream:
        stream.read(header.start)
        for first in range(0, len(numbers), TOGETHER):
            if stream.read(TOGETHER) != bytes(numbers[first : first + TOGETHER]):
                return False
        return not stream.read()  # to the end, where its sum is checked


def _one_for_all(archive: zipfile.ZipFile, member: zipfile.ZipInfo, header: _Header) -> NDArray[Any] | None:
    """The array as views of its first matrix if all are equal to that; None if one is not."""
    row = header.size // header.shape[0]
    with archive.open(member) as stream:
        stream.read(header.start)
        first = stream.read(row)
        together = first * max(CHUNK // max(row, 1), 1)
        while content := stream.read(len(together)):
            if content != together[: len(content)]:
                return None
    return np.broadcast_to(np.frombuffer(first, header.dtype).reshape(header.shape[1:]), header.shape)


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, header: _Header) -> NDArray[Any]:
    flat = np.empty(math.prod(header.shape), header.dtype)
    room = flat.view(np.uint8).data if flat.size and header.dtype.itemsize else memoryview(b"")
    with archive.open(member) as stream:
        stream.read(header.start)
        for first in range(0, len(room), TOGETHER):
            part = room[first : first + TOGETHER]
            part[:] = stream.read(len(part))
        stream.read()  # to the end, where its sum is checked
    freeze(flat)
    return flat.reshape(header.shape, order="F" if header.is_fortran else "C")
