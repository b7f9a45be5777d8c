"""Files: round trips, refusals in one line, and folders that are whole or not there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth, save, staged_folder, write_tum

from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.recording import Recording
from slamgauge.truth import Truth

RECORDING = Recording(
    stamps=np.arange(3.0),
    prior_mean=np.zeros(3),
    prior_cov=np.eye(3),
    odometry=np.full((2, 3), 0.1),
    odometry_cov=np.tile(np.eye(3), (2, 1, 1)),
    sensor="range-bearing",
    observation_step=np.array([0, 2]),
    observation=np.array([[1.0, 2.0], [3.0, -0.5]]),
    observation_cov=np.tile(np.eye(2), (2, 1, 1)),
    landmark=np.array([4, 4]),
)
TRUTH = Truth(
    poses=np.ones((3, 3)), landmark_ids=np.array([4]), landmarks=np.ones((1, 2)), association=np.array([4, 4])
)
ESTIMATE = Estimate(
    kind="filtered", poses=np.ones((3, 3)), landmark_ids=np.array([4]), landmarks=np.ones((1, 2)), seconds=np.ones(3)
)


def refusal(load: Callable[[Path], object], path: Path) -> str:
    with pytest.raises(ValueError, match=r"^[^\n]+$") as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    return message.removeprefix(str(path))


# --- npz ---------------------------------------------------------------------------------------


def test_records_within_an_estimate_come_back(tmp_path: Path):
    row = np.zeros(1, dtype=np.int64)
    rays = RayLog(row, row, row, row, np.array([[1.0, 2.0, np.nan]]), np.zeros(3, dtype=np.int64))
    history = MapHistory(row, row, row, np.ones(1), np.ones((1, 2)), np.eye(2)[None])
    save(tmp_path / "record.npz", replace(ESTIMATE, rays=rays, history=history))
    loaded = load_estimate(tmp_path / "record.npz")
    for name, record in (("rays", rays), ("history", history)):
        for field in record.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(getattr(loaded, name), field), getattr(record, field))
    with np.load(tmp_path / "record.npz") as archive:
        arrays = {name: archive[name] for name in archive if name != "rays_birth"}
    np.savez(tmp_path / "part.npz", **arrays)
    assert refusal(load_estimate, tmp_path / "part.npz") == ": not a RayLog, it lacks rays_birth; give another file"


@pytest.mark.parametrize(
    ("record", "load"), [(RECORDING, load_recording), (TRUTH, load_truth), (ESTIMATE, load_estimate)]
)
def test_round_trip(tmp_path: Path, record: Any, load: Callable[[Path], Any]):
    save(tmp_path / "record.npz", record)
    loaded = load(tmp_path / "record.npz")
    for name in record.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(loaded, name), getattr(record, name))


def test_unknown_association_stays_unknown(tmp_path: Path):
    save(tmp_path / "r.npz", replace(RECORDING, landmark=None))
    assert load_recording(tmp_path / "r.npz").landmark is None
    with np.load(tmp_path / "r.npz", allow_pickle=False) as archive:
        assert "landmark" not in archive
        assert archive["sensor"][()] == "range-bearing"


def test_truncated_and_foreign_files(tmp_path: Path):
    path = tmp_path / "r.npz"
    save(path, RECORDING)
    whole = path.read_bytes()
    for damaged in (b"", whole[:10], whole[:200], whole[:-30], b"stamps,x,y\n", whole.replace(b"PK", b"QK")):
        path.write_bytes(damaged)
        assert "not a whole npz file of plain arrays; write it again" in refusal(load_recording, path)


def test_pickled_objects_are_never_loaded(tmp_path: Path):
    path = tmp_path / "r.npz"
    np.savez(path, stamps=np.array([{"a": 1}], dtype=object))
    assert "not a whole npz file of plain arrays" in refusal(load_recording, path)


def test_a_single_array_is_not_an_npz_file(tmp_path: Path):
    np.save(tmp_path / "r.npy", np.zeros(3))
    assert "not a whole npz file of plain arrays" in refusal(load_recording, tmp_path / "r.npy")


def test_missing_and_unexpected_fields(tmp_path: Path):
    path = tmp_path / "r.npz"
    save(path, ESTIMATE)
    assert "not a Recording, it lacks observation, observation_cov" in refusal(load_recording, path)
    np.savez(path, poses=np.zeros((2, 3)), pozes=np.zeros((2, 3)))
    assert "not a Truth, it has the unknown pozes; give another file" in refusal(load_truth, path)


def test_values_that_do_not_fit(tmp_path: Path):
    path = tmp_path / "e.npz"
    np.savez(path, kind="guessed", poses=np.zeros((2, 3)))
    assert "kind: 'guessed' is not known" in refusal(load_estimate, path)
    np.savez(path, kind=np.zeros((2, 2)), poses=np.zeros((2, 3)))
    assert "is not known" in refusal(load_estimate, path)
    np.savez(path, kind="filtered", poses=np.full((2, 3), np.nan))
    assert "poses[0]" in refusal(load_estimate, path)


def test_files_that_are_not_there(tmp_path: Path):
    assert "cannot be read (No such file or directory)" in refusal(load_recording, tmp_path / "none.npz")
    assert "cannot be read (Is a directory)" in refusal(load_recording, tmp_path)
    assert "cannot be written" in refusal(lambda path: save(path, RECORDING), tmp_path / "none" / "r.npz")


# --- TUM ---------------------------------------------------------------------------------------


def test_tum_lines_hold_full_precision_and_skip_gaps(tmp_path: Path):
    poses = np.array([[1 / 3, -2.0, np.pi / 3], [np.nan] * 3, [0.1, 1e-17, np.pi]])
    write_tum(tmp_path / "t.tum", np.array([0.0, 0.1, 0.1 + 0.2]), poses)
    rows = np.loadtxt(tmp_path / "t.tum")
    np.testing.assert_array_equal(rows[:, 0], [0.0, 0.1 + 0.2])
    np.testing.assert_array_equal(rows[:, 1:3], poses[[0, 2], :2])
    np.testing.assert_array_equal(rows[:, 3:6], 0.0)
    np.testing.assert_allclose(2 * np.arctan2(rows[:, 6], rows[:, 7]), [np.pi / 3, np.pi], rtol=1e-15)


# --- folders -----------------------------------------------------------------------------------


def fill(stage: Path, text: str) -> None:
    (stage / "estimates").mkdir()
    for name in ("estimates/ekf.npz", "a.txt", "metrics.json", "z.txt"):
        (stage / name).write_text(text)


def test_a_new_folder_appears_at_the_end(tmp_path: Path):
    out = tmp_path / "deep" / "run"
    with staged_folder(out) as stage:
        fill(stage, "new")
        assert not out.exists()
    assert (out / "estimates" / "ekf.npz").read_text() == "new"
    assert [path.name for path in out.parent.iterdir()] == ["run"]


def test_an_existing_folder_is_updated(tmp_path: Path):
    out = tmp_path / "run"
    with staged_folder(out) as stage:
        fill(stage, "old")
    (out / "notes.txt").write_text("mine")
    with staged_folder(out) as stage:
        fill(stage, "new")
        assert (out / "metrics.json").read_text() == "old"
    assert {path.name for path in out.iterdir()} == {"estimates", "a.txt", "metrics.json", "z.txt", "notes.txt"}
    assert (out / "metrics.json").read_text() == (out / "estimates" / "ekf.npz").read_text() == "new"


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_leaves_everything_as_it_was(tmp_path: Path, existing: bool, error: type[BaseException]):
    out = tmp_path / "run"
    if existing:
        out.mkdir()
        (out / "metrics.json").write_text("old")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(error), staged_folder(out) as stage:
        fill(stage, "new")
        raise error
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("moves", [0, 1, 2, 3])
def test_a_crash_while_publishing_never_leaves_a_folder_that_looks_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: int
):
    out = tmp_path / "run"
    with staged_folder(out) as stage:
        fill(stage, "old")
    move, moved = Path.replace, list[Path]()

    def crashing_move(self: Path, target: Path) -> Path:
        if len(moved) == moves:
            raise KeyboardInterrupt
        moved.append(target)
        return move(self, target)

    monkeypatch.setattr(Path, "replace", crashing_move)
    with pytest.raises(KeyboardInterrupt), staged_folder(out) as stage:
        fill(stage, "new")
    assert not (out / "metrics.json").exists()


def test_a_block_without_the_last_file_leaves_the_old_one(tmp_path: Path):
    (tmp_path / "metrics.json").write_text("old")
    with staged_folder(tmp_path) as stage:
        (stage / "report.html").write_text("new")
    assert (tmp_path / "metrics.json").read_text() == "old"


def test_an_unusable_place_is_refused_on_entry(tmp_path: Path):
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(ValueError, match=r"run|file: cannot be written \(.+\); check the path"), staged_folder(out):
            pytest.fail("the block must not run")


def test_a_folder_inside_is_replaced_as_a_whole(tmp_path: Path) -> None:
    """What an earlier run left there would be taken for a result of the later one."""
    out = tmp_path / "run"
    for name in ("ekf", "riekf"):
        with staged_folder(out) as stage:
            (stage / "estimates").mkdir()
            (stage / "estimates" / f"{name}.npz").touch()
            (stage / "metrics.json").write_text(name)
    assert [file.name for file in (out / "estimates").iterdir()] == ["riekf.npz"]
    assert (out / "metrics.json").read_text() == "riekf"


def test_files_that_the_block_outdates_go_with_it(tmp_path: Path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("rays.png", "rays.svg", "notes.txt"):
        (out / name).write_text("old")
    with pytest.raises(KeyError), staged_folder(out, outdated=("rays.*",)):
        raise KeyError
    assert (out / "rays.png").read_text() == "old"
    with staged_folder(out, outdated=("rays.*",)) as folder:
        (folder / "rays.svg").write_text("new")
    assert {path.name: path.read_text() for path in out.iterdir()} == {"rays.svg": "new", "notes.txt": "old"}
