"""npz files from untrusted sources: read, or a one-line error before they fill the memory."""

from __future__ import annotations

import io
import resource
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.lib import format as npy

from slamgauge.compare.storage.npz_file import read_npz
from slamgauge.errors import UserError

MESSAGE = r"not a whole npz file of plain arrays( \([^\n]+\))?; write it again with numpy.savez$"


def member(header: bytes | tuple[str, tuple[int, ...]], content: bytes) -> bytes:
    """Return an npy file with a header (raw, or made from type and shape) and content."""
    if isinstance(header, bytes):
        return b"\x93NUMPY\x02\x00" + len(header).to_bytes(4, "little") + header + content
    begin = io.BytesIO()
    npy.write_array_header_1_0(begin, {"descr": header[0], "fortran_order": False, "shape": header[1]})
    return begin.getvalue() + content


def require_error(path: Path, content: bytes, times: int = 1) -> None:
    """Write an npz file whose member `poses` has this content, and read it."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for _ in range(times):
            archive.writestr("poses.npy", content)
    with pytest.raises(UserError, match=MESSAGE) as caught:
        read_npz(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_plain_arrays_are_read_as_numpy_reads_them(tmp_path: Path):
    arrays: dict[str, Any] = {
        "c": np.arange(6.0).reshape(2, 3),
        "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "big": np.arange(4, dtype=">i4"),
        "word": np.array("filtered"),
        "mark": np.array([True, False]),
        "empty": np.zeros((0, 3)),
        "number": np.float64(2.5),
    }
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **arrays)
        read = read_npz(tmp_path / "a.npz")
        assert [*read] == [*arrays]
        for name, array in arrays.items():
            np.testing.assert_array_equal(read[name], array)
            assert (read[name].dtype, read[name].shape) == (np.asarray(array).dtype, np.shape(array))


@pytest.mark.parametrize(
    "array", [np.ones(2) * 1j, np.zeros(2, "f8, f8"), np.array([{}]), np.zeros(2, "V8"), np.zeros(2, "M8[s]"), b"ab"]
)
def test_other_types_than_plain_arrays_are_an_error(tmp_path: Path, array: Any):
    np.savez(tmp_path / "a.npz", poses=array)
    with pytest.raises(UserError, match=MESSAGE):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize("shape", [(10**12, 3), (10**30, 3), (-1, 3), (-2, -2), (2**62, 2**62), (3, 1)])
def test_shapes_larger_than_the_content_are_an_error(tmp_path: Path, shape: tuple[int, ...]):
    require_error(tmp_path / "a.npz", member(("<f8", shape), bytes(16)))


@pytest.mark.parametrize(
    "header",
    [
        *(b"(" * 5000, b"{'descr': '<f8', 'shape': (2,)}", b" " * 20_000, b"1" * 5000, b"\xff\x00", b""),
        b"{'descr': 'no type', 'fortran_order': False, 'shape': (2,)}",
        b"{'descr': '|O', 'fortran_order': False, 'shape': (2,)}",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (2,)" + b" " * 60_000 + b"}",
    ],
)
def test_invalid_headers_are_an_error(tmp_path: Path, header: bytes):
    require_error(tmp_path / "a.npz", member(header, bytes(16)))


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_duplicate_names_are_an_error(tmp_path: Path):
    require_error(tmp_path / "a.npz", member(("<f8", (2,)), bytes(16)), times=2)


def test_encrypted_arrays_are_an_error(tmp_path: Path):
    path = tmp_path / "a.npz"
    np.savez(path, poses=np.ones(3))
    content = bytearray(path.read_bytes())
    for start, flags in ((content.find(b"PK\x03\x04"), 6), (content.find(b"PK\x01\x02"), 8)):
        content[start + flags] |= 1
    path.write_bytes(content)
    with pytest.raises(UserError, match=MESSAGE):
        read_npz(path)


def test_arrays_larger_than_the_memory_are_an_error_before_unpacking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The file of half a megabyte contains 400 MB of zeros."""
    path = tmp_path / "a.npz"
    zeros = io.BytesIO(member(("<f8", (50_000_000,)), b""))
    archive = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with archive, archive.open("poses.npy", "w") as stream:
        stream.write(zeros.getvalue())
        for _ in range(400):
            stream.write(bytes(1_000_000))
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 7e8)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(UserError, match=rf"^{path}: reading it needs 0.8 GB of memory, and 0.7 GB are free; [^\n]+$"):
        read_npz(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # KB


def test_a_truncated_directory_is_an_error(tmp_path: Path):
    """After a flipped bit in the size of the directory `zipfile` reads only its first half."""
    path = tmp_path / "a.npz"
    np.savez(path, poses=np.ones(3), rays=np.ones(3))
    content = bytearray(path.read_bytes())
    size = struct.unpack_from("<L", content, len(content) - 10)[0]
    first = content.find(b"PK\x01\x02")
    second = content.find(b"PK\x01\x02", first + 1)
    content = content[:second] + content[first + size :]  # removes the second member
    struct.pack_into("<L", content, len(content) - 10, second - first)
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"not a whole npz file of plain arrays \(its directory is not whole\)"):
        read_npz(path)


def test_an_equal_array_in_memory_is_returned_instead_of_a_copy(tmp_path: Path):
    ids = np.arange(300_000)  # more than one chunk
    np.savez_compressed(tmp_path / "a.npz", ids=ids, other=ids + 1, fortran=np.asfortranarray(np.ones((2, 2))))
    read = read_npz(tmp_path / "a.npz", {"ids": ids, "fortran": np.ones((2, 2))})
    assert read["ids"] is ids
    np.testing.assert_array_equal(read["fortran"], np.ones((2, 2)))
    for unlike in (np.append(ids[:-1], 0), ids[:-1], ids.astype(np.int32), ids.astype(np.float64)):
        np.testing.assert_array_equal(read_npz(tmp_path / "a.npz", {"ids": unlike})["ids"], ids)


def test_flipped_bits_in_arrays_are_found(tmp_path: Path):
    """Bits of other entries (dates, versions) may change without an error."""
    path, rng, refusals = tmp_path / "a.npz", np.random.default_rng(0), 0
    array = rng.normal(size=(30, 3))
    np.savez_compressed(path, poses=array)
    whole = path.read_bytes()
    for _ in range(500):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            read = read_npz(path)
        except UserError as error:
            refusals += 1
            assert "\n" not in str(error)
        else:
            np.testing.assert_array_equal(read.get("poses", array), array)
    assert refusals > 400


def test_a_matrix_repeated_in_all_rows_is_stored_once(tmp_path: Path):
    covs = np.tile(np.diag([1.0, 2.0, 3.0]), (50_000, 1, 1))
    np.savez_compressed(tmp_path / "a.npz", same=covs, one=covs[:1], turned=np.asfortranarray(covs[:3]), none=covs[:0])
    found = read_npz(tmp_path / "a.npz")
    assert found["same"].strides[0] == 0
    np.testing.assert_array_equal(found["same"], covs)
    assert [found[name].shape for name in ("one", "turned", "none")] == [(1, 3, 3), (3, 3, 3), (0, 3, 3)]
