"""Random damage of bytes, of words and lines, and of arrays."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

Mutation = Callable[[bytes, np.random.Generator], bytes]
Arrays = dict[str, NDArray[Any]]

WORDS = (
    *("nan", "inf", "-inf", "1e400", "1e49", "-1e49", "1e-320", "", "-1", "0", "9007199254740993", "1" * 5000, "0x10"),
    *("word", '"', ",", ";", "#", "\t", "é", "\u2028", "1_0", "=", "[", "]", "\x1a", "VERTEX_SE2", "-0.0", "1e15"),
    *("1e20", "1" + "0" * 20, "1e-9", "[" * 3000, "true", "0.5", "3", "1e308", "\x00", "18446744073709551616"),
)


def changed_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Flip bits, replace bytes, remove or repeat a piece, or cut off the end."""
    damaged = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        at, length = int(rng.integers(len(damaged) + 1)), int(rng.integers(1, 40))
        match int(rng.integers(6)):
            case 0:
                del damaged[at:]
            case 1:
                del damaged[at : at + length]
            case 2:
                damaged[at:at] = damaged[at : at + length]
            case 3:
                damaged[at : at + length] = rng.bytes(length)
            case _:
                if at < len(damaged):
                    damaged[at] ^= 1 << rng.integers(8)
    return bytes(damaged)


def changed_pages(content: bytes, rng: np.random.Generator) -> bytes:
    """Change bytes, or whole pages as a file system does that loses power: zeros, another page, or no end."""
    if rng.integers(2):
        return changed_bytes(content, rng)
    size = int(rng.choice([512, 4096]))
    at, other = (size * int(rng.integers(-(-len(content) // size))) for _ in range(2))
    match int(rng.integers(3)):
        case 0:
            return content[:at]
        case 1:
            return content[:at] + bytes(len(content[at : at + size])) + content[at + size :]
        case _:
            return content[:at] + content[other : other + size] + content[at + size :]


def changed_text(content: bytes, rng: np.random.Generator) -> bytes:
    """Change a word, a line or a byte, up to three times."""
    for _ in range(rng.integers(1, 4)):
        content = _changed_once(content, rng) or b"\n"
    return content


def _changed_once(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    at = int(rng.integers(len(lines)))
    match int(rng.integers(8)):
        case 0:
            return content[: rng.integers(len(content))]
        case 1:
            lines[at] = lines[int(rng.integers(len(lines)))]
        case 2:
            del lines[at]
        case 3:
            lines = [lines[int(each)] for each in rng.permutation(len(lines))]
        case 4:
            return b"".join([content[:at], bytes([int(rng.integers(256))]), content[at + int(rng.integers(2)) :]])
        case _:
            separator = next((each for each in (b",", b" = ") if each in lines[at]), b" ")
            words = lines[at].split(separator)
            words[int(rng.integers(len(words)))] = str(rng.choice(WORDS)).encode()
            lines[at] = separator.join(words)
    return b"\n".join(lines)


def changed_npz(content: bytes, rng: np.random.Generator) -> bytes:
    """Write another valid npz file with one array changed, removed or added."""
    with np.load(io.BytesIO(content)) as archive:
        arrays = {name: archive[name] for name in archive}
    file = io.BytesIO()
    np.savez_compressed(file, **_changed_arrays(arrays, rng))  # pyrefly: ignore[bad-argument-type]
    return file.getvalue()


def changed_mat(content: bytes, rng: np.random.Generator) -> bytes:
    """Write another valid MATLAB file with one array changed, removed or added."""
    arrays = {name: array for name, array in loadmat(io.BytesIO(content)).items() if not name.startswith("_")}
    changed = {name: array for name, array in _changed_arrays(arrays, rng).items() if array.dtype.kind in "biufcU"}
    file = io.BytesIO()
    savemat(file, changed, do_compression=bool(rng.integers(2)))
    return file.getvalue()


def _changed_arrays(arrays: Arrays, rng: np.random.Generator) -> Arrays:
    """Change numbers, type or shape of an array, remove it, or add another."""
    name = str(rng.choice([*arrays]))
    array = arrays[name]
    match int(rng.integers(8)):
        case 0:
            return {key: value for key, value in arrays.items() if key != name}
        case 1:
            return arrays | {str(rng.choice(["more", "landmark", "kind", "rays_birth", "x.y"])): array}
        case 2:
            return arrays | {name: arrays[str(rng.choice([*arrays]))]}
        case 3:
            shape = [array[None], array[:-1] if array.ndim else array, np.zeros(0), array.ravel(), array.T]
            return arrays | {name: shape[int(rng.integers(len(shape)))]}
        case 4:
            types = ["f4", ">f8", "c16", "i1", "u8", "U5", "S5", "O", "?", "f2", "V3", "M8[s]", "f8"]
            with np.errstate(all="ignore"):
                try:
                    return arrays | {name: array.astype(str(rng.choice(types)))}
                except (TypeError, ValueError):  # numpy has no such conversion
                    return arrays
        case _:
            return arrays | {name: _other_numbers(array, rng)}


def _other_numbers(array: NDArray[Any], rng: np.random.Generator) -> NDArray[Any]:
    """Replace some numbers of an array."""
    if array.dtype.kind not in "iuf" or not array.size:
        return np.array(str(rng.choice(["", "bearing", "position", "smoothed", "\x00"])))
    odd = [np.nan, np.inf, -1.0, 0.0, 1e308, 1e160, 1e50, 1e-300, 1e-9, 0.5, 2.0**53, 2.0**63, 1e20, 7.0, -7.0]
    changed = array.astype(np.float64)
    at = rng.integers(changed.size, size=int(rng.integers(1, 3)))
    changed.ravel()[at] = rng.choice(odd, size=len(at))
    with np.errstate(all="ignore"):
        return changed * rng.choice(odd) if rng.random() < 0.1 else changed
