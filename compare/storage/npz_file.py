"""Safe reader of npz files from untrusted sources: it loads no pickles, and checks the free memory first."""

from __future__ import annotations

import errno
import lzma
import os
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import freeze
from slamgauge.compare.storage.regular_files import require_regular
from slamgauge.errors import UserError
from slamgauge.memory import require_memory

PLAIN = "biufU"  # kinds of numpy types: booleans, integers, floats, texts
LAST_RECORD = 22  # bytes
MANY = 0xFFFF  # stands for 65535 members or more, which a zip64 record counts
COPIES = 2.0  # copies of the arrays in memory while a record is validated

DAMAGED_PLACES = (errno.EINVAL, None)  # error numbers caused by a damaged offset and a damaged bz2 stream

NONE_KNOWN: Mapping[str, NDArray[Any]] = {}

_BROKEN = (  # errors of zipfile and numpy at damaged or foreign files
    ValueError,
    TypeError,
    EOFError,
    KeyError,
    OverflowError,
    MemoryError,  # a header that states more than the file contains
    RuntimeError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
)


def read_npz(path: Path, known: Mapping[str, NDArray[Any]] = NONE_KNOWN) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz file by name, read-only.

    Args:
        path: The file.
        known: Arrays in memory by name. If the array of the file is equal, the array in memory is returned instead.

    Raises:
        UserError: If the file is damaged, contains anything but plain arrays, or does not fit into memory.
        OSError: If the system cannot read the file.
    """
    try:
        _require_whole(path)
        with warnings.catch_warnings(), np.load(path, allow_pickle=False) as archive:
            warnings.simplefilter("ignore")  # warnings about files of Python 2
            return {name: _kept(name, archive[name], known.get(name)) for name in archive.files}
    except (UserError, OSError) as error:
        if not isinstance(error, OSError) or error.errno not in DAMAGED_PLACES:
            raise
        why = ""
    except _BROKEN as error:
        why = f" ({error})" if isinstance(error, _OddError) else ""
    raise UserError(f"{path}: not a whole npz file of plain arrays{why}; write it again with numpy.savez")


class _OddError(ValueError):
    """The file has a property that files of `numpy.savez` never have."""


def _require_whole(path: Path) -> None:
    """Check that the directory of the zip file is complete, and that its arrays fit into memory."""
    require_regular(path)
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    with path.open("rb") as file:
        file.seek(-LAST_RECORD, os.SEEK_END)
        last = file.read(LAST_RECORD)
    count = struct.unpack_from("<H", last, 10)[0]
    if not last.startswith(b"PK\5\6") or count not in (len(members), MANY):
        raise _OddError("its directory is not whole")  # zipfile reads a truncated directory without an error
    if len({member.filename for member in members}) < len(members):
        raise _OddError("a name appears twice")
    size = sum(member.file_size for member in members)  # zipfile unpacks no more than this
    require_memory(COPIES * size, f"{path}: reading it", "close other programs, or give a part of it")


def _kept(name: str, array: object, known: NDArray[Any] | None) -> NDArray[Any]:
    """Return the array, or an equal array that needs less memory.

    This is `known` if it is equal, or a broadcast view if all matrices of a 3-D array are equal.

    Raises:
        _OddError: not an array, or of a type that is not in PLAIN.
    """
    if not isinstance(array, np.ndarray):
        raise _OddError(f"{name[:40]!r} is not an array")
    if array.dtype.kind not in PLAIN:
        raise _OddError(f"{name[:40]!r} is of type {array.dtype.name}")
    if known is not None and known.dtype == array.dtype and np.array_equal(array, known):
        return known
    if array.ndim == 3 and len(array) > 1 and bool((array == array[0]).all()):  # the same covariance in all rows
        return np.broadcast_to(array[0].copy(), array.shape)
    freeze(array)
    return array
