"""From damaged files every reader makes a record or refuses them in one line, and leaves them as they are."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from slamgauge.compare.datasets.bag_log import read_bag
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.published import read_lost_in_the_woods, read_mrclam
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.storage.csv_folder import write_recording_csv
from slamgauge.compare.storage.files import load_recording, save
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.errors import UserError
from slamgauge.se2 import chain
from tests.marks import in_full
from tests.reference.bags import Bags, detection, in_order, odometry_messages, scan_messages
from tests.reference.random_recordings import random_recording
from tests.reference.robot_logs import CSV, G2O, MRCLAM, TORO, WOODS

RECORDING = random_recording(3, steps=4)[1]
PATH = chain(RECORDING.prior_mean, RECORDING.odometry)
WORDS = (
    *("nan", "inf", "-inf", "1e400", "1e49", "-1e49", "1e-320", "", "-1", "0", "9007199254740993", "1" * 5000, "0x10"),
    *("word", '"', ",", ";", "#", "\t", "é", "\u2028", "1_0", "=", "[", "]", "\x1a", "VERTEX_SE2", "-0.0", "1e15"),
    *("1e20", "1" + "0" * 20, "1e-9", "[" * 3000, "true", "0.5", "3", "1e308", "\x00", "2024-13-01T12:00:00", "²"),
)


Files = Callable[[Path], object]


def texts(files: dict[str, str]) -> Files:
    return lambda folder: [(folder / name).write_bytes(text.encode()) for name, text in files.items()]


def tum(folder: Path) -> None:
    write_tum(folder / "path.tum", RECORDING.stamps, PATH, np.tile(np.eye(3), (len(PATH), 1, 1)))


def bag(folder: Path, kind: str) -> None:
    recording = random_recording(3, steps=4, sensor="position")[1]
    seen = scan_messages(recording, "/seen", "vision_msgs/msg/Detection3DArray", detection, "detections")
    Bags(kind).write(folder / "run", in_order(odometry_messages(recording), seen))


TEXTS: dict[str, tuple[Files, Callable[[Path], Any]]] = {
    "tum": (tum, lambda folder: load_stored(folder / "path.tum", RECORDING)),
    "csv recording": (lambda folder: write_recording_csv(folder, RECORDING), read_csv_log),
    "csv log": (texts(CSV), read_csv_log),
    "g2o": (texts(G2O), lambda folder: read_g2o(folder / "graph.g2o")),
    "toro": (texts(TORO), lambda folder: read_g2o(folder / "graph.toro", isam=True, drop_loop_edges=True)),
    "mrclam": (texts(MRCLAM), read_mrclam),
}
FORMATS = TEXTS | {
    "npz": (lambda folder: save(folder / "recording.npz", RECORDING), lambda it: load_recording(it / "recording.npz")),
    "woods": (
        lambda folder: savemat(folder / "woods.mat", WOODS, do_compression=True),
        lambda folder: read_lost_in_the_woods(folder / "woods.mat"),
    ),
    "ros1 bag": (partial(bag, kind="ros1"), lambda folder: read_bag(folder / "run.bag")),
    "mcap bag": (partial(bag, kind="mcap"), lambda folder: read_bag(folder / "run")),
    "sqlite3 bag": (partial(bag, kind="sqlite3"), lambda folder: read_bag(folder / "run")),
}


def content_of(folder: Path) -> dict[Path, bytes]:
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@cache
def whole_files(name: str) -> dict[Path, bytes]:
    """Return the files of a format by their places in a folder."""
    with tempfile.TemporaryDirectory() as folder:
        FORMATS[name][0](Path(folder))
        return content_of(Path(folder))


@st.composite
def mutated(draw: st.DrawFn, content: bytes) -> bytes:
    """Cut a file, change a byte or a word, or drop, repeat or exchange lines; up to three times."""
    for _ in range(draw(st.integers(1, 3))):
        lines = content.split(b"\n")
        at, other = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
        byte = draw(st.integers(0, len(content)))
        match draw(st.sampled_from(["cut", "byte", "drop", "exchange", "repeat", "word", "word", "word"])):
            case "cut":
                content = content[:byte]
                continue
            case "byte":
                content = content[:byte] + draw(st.binary(min_size=1, max_size=2)) + content[byte + 1 :]
                continue
            case "drop":
                del lines[at]
            case "exchange":
                lines[at], lines[other] = lines[other], lines[at]
            case "repeat":
                lines[at] = lines[other]
            case _:
                separator = next((each for each in (b",", b" = ") if each in lines[at]), b" ")
                words = lines[at].split(separator)
                words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(WORDS)).encode()
                lines[at] = separator.join(words)
        content = b"\n".join(lines)
    return content


def attempts(name: str, data: st.DataObject) -> str:
    """Read a format with one of its files mutated; return the refusal, empty without one."""
    with tempfile.TemporaryDirectory() as where:
        folder, files = Path(where), dict(whole_files(name))
        changed = data.draw(st.sampled_from([*files]))
        files[changed] = data.draw(mutated(files[changed]))
        for path, content in files.items():
            (folder / path).parent.mkdir(exist_ok=True)
            (folder / path).write_bytes(content)
        try:
            with np.errstate(all="raise", under="ignore"):
                FORMATS[name][1](folder)
        except UserError as error:
            assert len(str(error).splitlines()) == 1
            assert str(error).startswith(where)
            return str(error)
        finally:
            assert content_of(folder) == files
    return ""


@pytest.mark.parametrize("name", [name for name in FORMATS if "bag" not in name])  # bags take 3 s each
@given(data=st.data())
@settings(max_examples=100, deadline=10_000)
def test_mutated_files_are_read_or_refused_in_one_line(name: str, data: st.DataObject):
    attempts(name, data)


@pytest.mark.parametrize("name", in_full(FORMATS))
@given(data=st.data())
@settings(max_examples=2000, deadline=10_000)
def test_two_thousand_mutated_files(name: str, data: st.DataObject):
    attempts(name, data)


@pytest.mark.parametrize("name", FORMATS)
def test_whole_files_are_read_and_cut_ones_are_refused(name: str, tmp_path: Path):
    """A mutation that damages a file is noticed: half a file is not read."""
    write, read = FORMATS[name]
    write(tmp_path)
    read(tmp_path)
    path = max((tmp_path / each for each in whole_files(name)), key=lambda each: each.stat().st_size)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 5])
    with pytest.raises(UserError):
        read(tmp_path)


@pytest.mark.parametrize("name", TEXTS)
def test_byte_order_marks_and_line_ends_make_no_difference_and_files_without_text_are_named(name: str, tmp_path: Path):
    """Each text file of a format is changed in turn."""
    write, read = TEXTS[name]
    write(tmp_path)
    for path in sorted(tmp_path.iterdir()):
        whole = path.read_bytes()
        for same in (whole.replace(b"\n", b"\r\n"), b"\xef\xbb\xbf" + whole):
            path.write_bytes(same)
            read(tmp_path)
        for other in (b"\x00\x01\x02\xff" * 100, "café\n".encode("latin-1"), "stamp,v\n".encode("utf-16")):
            path.write_bytes(other)
            with pytest.raises(UserError, match=rf"^{re.escape(str(path))}[^\n]+$"):
                read(tmp_path)
        path.write_bytes(whole)


CSV_LINES = {
    "odometry.csv": "stamp,v,omega\n" + "".join(f"{0.1 * k:.1f},0.5,0.01\n" for k in range(100_000)),
    "observations.csv": "stamp,landmark,range,bearing\n"
    + "".join(f"{0.1 * k + 0.03:.2f},{k % 97},2.0,0.1\n" for k in range(99_999)),
    "recording.toml": CSV["recording.toml"],
}
G2O_LINES = {
    "graph.g2o": "".join(f"EDGE_SE2 {k} {k + 1} 1 0 0.1 1 0 0 1 0 1\n" for k in range(50_000))
    + "".join(f"EDGE_SE2_XY {k} {100_000 + k % 99} 1 0 1 0 1\n" for k in range(50_000))
}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "files", "steps"), [("csv log", CSV_LINES, 199_998), ("g2o", G2O_LINES, 50_000)])
def test_a_hundred_thousand_lines_are_read(name: str, files: dict[str, str], steps: int, tmp_path: Path):
    """No loop is quadratic: the test would take minutes."""
    texts(files)(tmp_path)
    assert FORMATS[name][1](tmp_path).recording.steps == steps
