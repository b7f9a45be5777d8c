"""Files of results: round trips, and one-line errors."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.storage.files import (
    explained,
    load_estimate,
    load_recording,
    load_truth,
    override,
    read_csv,
    read_toml,
    save,
    write_csv,
    write_toml,
)
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.errors import UserError
from tests.reference import example_records as examples

RECORDING, TRUTH, ESTIMATE = examples.recording(), examples.truth(), examples.estimate()


def error_message(load: Callable[[Path], object], path: Path) -> str:
    with pytest.raises(ValueError, match=r"^[^\n]+$") as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    return message.removeprefix(str(path))


# --- npz ---------------------------------------------------------------------------------------


def test_round_trip_of_records_inside_an_estimate(tmp_path: Path):
    rays, history = examples.rays(), examples.history()
    save(tmp_path / "record.npz", replace(ESTIMATE, rays=rays, history=history))
    loaded = load_estimate(tmp_path / "record.npz")
    assert (loaded.rays, loaded.history) == (rays, history)
    with np.load(tmp_path / "record.npz") as archive:
        arrays = {name: archive[name] for name in archive if name != "rays_birth"}
    np.savez(tmp_path / "part.npz", **arrays)
    message = error_message(load_estimate, tmp_path / "part.npz")
    assert message.startswith(": not a whole Estimate: ")
    assert message.endswith("missing 1 required positional argument: 'birth'; give another file")


OPTIMA = [replace(ESTIMATE, chi_square=1 / 3, chi_square_dof=4, optimum_check=check) for check in (None, np.inf)]


@pytest.mark.parametrize(
    ("record", "load"),
    [
        *((RECORDING, load_recording), (replace(RECORDING, landmark=None), load_recording), (TRUTH, load_truth)),
        *((each, load_estimate) for each in (ESTIMATE, *OPTIMA)),
    ],
)
def test_round_trip(tmp_path: Path, record: Any, load: Callable[[Path], Any]):
    save(tmp_path / "record.npz", record)
    assert load(tmp_path / "record.npz") == record


def test_damaged_and_foreign_files_are_an_error(tmp_path: Path):
    path = tmp_path / "r.npz"
    save(path, RECORDING)
    whole = path.read_bytes()
    for damaged in (b"", whole[:10], whole[:200], whole[:-30], b"stamps,x,y\n", whole.replace(b"PK", b"QK")):
        path.write_bytes(damaged)
        assert "not a whole npz file of plain arrays; write it again" in error_message(load_recording, path)
    np.save(tmp_path / "r.npy", np.zeros(3))
    assert "not a whole npz file of plain arrays" in error_message(load_recording, tmp_path / "r.npy")


@pytest.mark.parametrize(
    ("fields", "load", "message"),
    [
        ({"kind": "filtered", "poses": np.zeros((2, 3))}, load_recording, "not a whole Recording: "),
        ({"pozes": np.zeros((2, 3))}, load_truth, "unexpected keyword argument 'pozes'"),
        ({"kind": "guessed", "poses": np.zeros((2, 3))}, load_estimate, "kind: 'guessed' is not known"),
        ({"kind": "filtered", "poses": np.full((2, 3), np.nan)}, load_estimate, "poses[0]"),
        ({"kind": "filtered", "poses": np.zeros((2, 3)), "optimum_check": "far"}, load_estimate, "optimum_check: "),
        ({"stamps": np.array([{"a": 1}], dtype=object)}, load_recording, "not a whole npz file of plain arrays"),
    ],
)
def test_wrong_fields_and_values_are_an_error(tmp_path: Path, fields: Any, load: Callable[[Path], Any], message: str):
    np.savez(tmp_path / "e.npz", **fields)
    assert message in error_message(load, tmp_path / "e.npz")


def test_paths_that_cannot_be_read_or_written_are_an_error(tmp_path: Path):
    assert "cannot be read (No such file or directory)" in error_message(load_recording, tmp_path / "none.npz")
    assert "cannot be read (Is a directory)" in error_message(load_recording, tmp_path)
    assert "cannot be written" in error_message(lambda path: save(path, RECORDING), tmp_path / "none" / "r.npz")
    full = r"^r\.npz: cannot be written \(No space left on device\); make room, and give the same command again$"
    with pytest.raises(UserError, match=full), explained("r.npz", "written"):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_tum_lines_have_full_precision_and_skip_gaps(tmp_path: Path):
    poses = np.array([[1 / 3, -2.0, np.pi / 3], [np.nan] * 3, [500_000.1, 1e-17, np.pi]])
    write_tum(tmp_path / "t.tum", np.array([0.0, 0.1, 1.7e9 + 0.2]), poses)
    rows = np.loadtxt(tmp_path / "t.tum")
    np.testing.assert_array_equal(rows[:, 0], [0.0, 1.7e9 + 0.2])
    np.testing.assert_array_equal(rows[:, 1:3], poses[[0, 2], :2])
    np.testing.assert_array_equal(rows[:, 3:6], 0.0)
    np.testing.assert_allclose(2 * np.arctan2(rows[:, 6], rows[:, 7]), [np.pi / 3, np.pi], rtol=1e-15)


def test_formulas_have_an_apostrophe_in_front(tmp_path: Path):
    cells = ['=HYPERLINK("http://a")', "+1+1", "-x", "@SUM(1)", "'=x", "-1.5e-3", "'quoted'", "a=b"]
    written = ['"\'=HYPERLINK(""http://a"")"', "'+1+1", "'-x", "'@SUM(1)", "''=x", "-1.5e-3", "'quoted'", "a=b"]
    path = tmp_path / "table.csv"
    with path.open("w", newline="") as file:
        write_csv(file, [["name", "value"], *([cell, -0.5] for cell in cells)])
    assert path.read_text().splitlines() == ["name,value", *(f"{cell},-0.5" for cell in written)]
    assert read_csv(path) == [{"name": cell, "value": "-0.5"} for cell in cells]


# --- TOML -----------------------------------------------------------------------------------------


def test_a_toml_file_is_read_as_it_was_written(tmp_path: Path):
    sections = {
        "one": {"text": 'a "quoted" \\ é\n', "number": 1e-9, "whole": 3, "list": [1.0, -2.5, 3.0], "none": None},
        "two": {"table": {"a b": "c", "d": 4}, "empty": {}},
    }
    write_toml(tmp_path / "file.toml", sections)
    del sections["one"]["none"]
    assert read_toml(tmp_path / "file.toml") == sections


def test_overrides_create_missing_sections():
    table = {"a": {"b": 1}, "c": 2}
    for text in ("a.b=3", "a.d = [1, 2]", "c.e=a bare text", "f=true", f"g={'1' * 5000}"):
        override(table, text)
    assert table == {"a": {"b": 3, "d": [1, 2]}, "c": {"e": "a bare text"}, "f": True, "g": "1" * 5000}
    with pytest.raises(UserError, match=r"^=1{99}: not an override; write dotted.key=value$"):
        override({}, "=" + "1" * 5000)


@pytest.mark.parametrize(
    ("content", "message"), [(b"a = \n", "not valid TOML: .*line 1"), (b"a = '\xff'", "line 1: not a text in UTF-8")]
)
def test_invalid_toml_is_an_error(tmp_path: Path, content: bytes, message: str):
    (tmp_path / "file.toml").write_bytes(content)
    with pytest.raises(UserError, match=message):
        read_toml(tmp_path / "file.toml")
