"""From damaged files, an import makes a recording or refuses them in one line, without a traceback."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.mrclam import read_mrclam
from slamgauge.compare.storage.csv_folder import read_recording_csv
from slamgauge.errors import UserError
from tests.reference.damage import changed_text
from tests.reference.robot_logs import CSV, G2O, MRCLAM, TORO

OWN = {  # files of `slamgauge export csv`
    "start.csv": "stamp,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\n0,0,0,0,0.1,0,0,0.1,0,0.01\n",
    "odometry.csv": "step,stamp,dx,dy,dtheta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\n"
    "1,0.1,1,0,0.1,0.01,0.001,0,0.02,0,0.01\n2,0.2,1,0,0.1,0.01,0,0,0,0,0.01\n",
    "observations.csv": "step,landmark,range,bearing,cov_rr,cov_rb,cov_bb\n0,3,2,0.1,0.01,0,0.1\n2,3,1,0,0.01,0,0.1\n",
}
Reader = Callable[[Path], Any]
FORMATS: dict[str, tuple[dict[str, str], Reader]] = {
    "csv": (CSV, read_csv_log),
    "own": (OWN, read_recording_csv),
    "g2o": (G2O, lambda folder: read_g2o(folder / "graph.g2o")),
    "toro": (TORO, lambda folder: read_g2o(folder / "graph.toro", isam=True, drop_loop_edges=True)),
    "mrclam": (MRCLAM, read_mrclam),
}
FILES = [(name, file) for name, (files, _) in FORMATS.items() for file in files]


def written(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).write_bytes(text.encode())
    return folder


def read_or_refused(read: Reader, folder: Path) -> str:
    """Read a folder; return the refusal, empty without one."""
    try:
        with np.errstate(all="raise", under="ignore"):
            read(folder)
    except UserError as error:
        assert str(error)
        assert len(str(error).splitlines()) == 1
        assert str(error).startswith(str(folder))
        return str(error)
    return ""


@pytest.mark.parametrize("name", FORMATS)
def test_whole_logs_are_read(name: str, tmp_path: Path):
    files, read = FORMATS[name]
    assert read_or_refused(read, written(tmp_path, files)) == ""


@pytest.mark.parametrize(("name", "file"), FILES)
def test_mutations_are_read_or_refused_in_one_line(name: str, file: str, tmp_path: Path):
    files, read = FORMATS[name]
    path = written(tmp_path, files) / file
    whole, rng = path.read_bytes(), np.random.default_rng(15)
    refused = 0
    for _ in range(150):
        path.write_bytes(changed_text(whole, rng))
        refused += bool(read_or_refused(read, tmp_path))
    assert refused > 20


@pytest.mark.parametrize(("name", "file"), FILES)
@pytest.mark.parametrize(
    "content", [b"", b"\n\n", b"\x00\x01\x02\xff" * 100, "café\n".encode("latin-1"), "stamp,v\n".encode("utf-16")]
)
def test_files_without_text_are_refused(name: str, file: str, content: bytes, tmp_path: Path):
    files, read = FORMATS[name]
    (written(tmp_path, files) / file).write_bytes(content)
    refusal = read_or_refused(read, tmp_path)
    if file != "recording.toml" or content.strip():  # without that file the noise is missing
        assert refusal.startswith(str(tmp_path / file))


@pytest.mark.parametrize(("name", "file"), FILES)
def test_line_ends_and_byte_order_marks_make_no_difference(name: str, file: str, tmp_path: Path):
    files, read = FORMATS[name]
    path = written(tmp_path, files) / file
    for text in (path.read_bytes().replace(b"\n", b"\r\n"), b"\xef\xbb\xbf" + path.read_bytes()):
        path.write_bytes(text)
        assert read_or_refused(read, tmp_path) == ""


@pytest.mark.parametrize("name", ["csv", "g2o", "mrclam"])
def test_commands_refuse_missing_files(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["import", name, str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "none" in error
    assert not (tmp_path / "out").exists()


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


@pytest.mark.parametrize(("name", "files", "steps"), [("csv", CSV_LINES, 199_998), ("g2o", G2O_LINES, 50_000)])
def test_a_hundred_thousand_lines_take_seconds(name: str, files: dict[str, str], steps: int, tmp_path: Path):
    """No loop is quadratic; the bound is ten times the usual time."""
    written(tmp_path, files)
    begin = perf_counter()
    assert FORMATS[name][1](tmp_path).recording.steps == steps
    assert perf_counter() - begin < 30.0
