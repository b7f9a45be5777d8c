"""Folders of results: complete or absent, and no folder of somebody else is written to."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.storage.best_effort import Drawing, decorate
from slamgauge.compare.storage.staged_folder import MARK, begin_folder, staged_files, staged_folder
from slamgauge.errors import UserError

FILES = ("estimates/ekf.npz", "a.txt", "metrics.json", "z.txt")
LAST = "metrics.json"


def fill(stage: Path, text: str, names: tuple[str, ...] = FILES) -> None:
    for name in names:
        (stage / name).parent.mkdir(parents=True, exist_ok=True)
        (stage / name).write_text(text)


def publish(out: Path, text: str, names: tuple[str, ...] = FILES, outdated: tuple[str, ...] = ()) -> None:
    with staged_folder(out, names, LAST, outdated) as stage:
        fill(stage, text, names)


def texts(folder: Path) -> dict[str, str]:
    """Return the text of every file below a folder except its mark."""
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_text() for name, path in found.items() if name != MARK}


@pytest.mark.parametrize("existing", [False, True])
def test_files_appear_at_the_end(tmp_path: Path, existing: bool):
    out = tmp_path / "deep" / "run"
    if existing:
        publish(out, "old")
        (out / "notes.txt").write_text("mine")
    before = texts(out)
    with staged_folder(out, FILES, LAST) as stage:
        fill(stage, "new")
        left = {name: text for name, text in texts(out).items() if ".partial" not in name}
        assert (left, out.exists()) == (before, existing)
    assert texts(out) == before | dict.fromkeys(FILES, "new")
    assert [path.name for path in out.parent.iterdir()] == ["run"]


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, OSError(28, "No space left on device")])
def test_a_failure_changes_nothing(tmp_path: Path, existing: bool, error: BaseException):
    out = tmp_path / "run"
    if existing:
        publish(out, "old")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises((RuntimeError, KeyboardInterrupt, OSError)), staged_folder(out, FILES, LAST, ("*",)) as stage:
        fill(stage, "new")
        raise error
    assert sorted(tmp_path.rglob("*")) == before
    assert not existing or texts(out) == dict.fromkeys(FILES, "old")


@pytest.mark.parametrize("moves", range(5))
def test_an_interrupt_while_files_are_replaced_leaves_no_complete_mixture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: int
):
    """The file that marks a complete folder is there only if all files are of one command."""
    publish(tmp_path, "old")
    move, moved = Path.replace, list[Path]()

    def interrupted(self: Path, target: Path) -> Path:
        if len(moved) == moves:
            raise KeyboardInterrupt
        moved.append(self)
        return move(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", interrupted)
        if moves < len(FILES):
            with pytest.raises(KeyboardInterrupt, match=f"^{tmp_path} is written in part; the same command makes it"):
                publish(tmp_path, "new")
        else:
            publish(tmp_path, "new")
    assert (tmp_path / LAST).exists() == (moves == len(FILES))
    assert not [*tmp_path.glob(".slamgauge.*.partial")]
    publish(tmp_path, "newer")
    assert texts(tmp_path) == dict.fromkeys(FILES, "newer")


def test_outdated_files_are_removed_and_other_files_are_kept(tmp_path: Path):
    """Files of an earlier run would look like results of the later one."""
    publish(tmp_path, "old", ("estimates/ekf.npz", "rays.png", "animation.gif", "budget.json", LAST))
    (tmp_path / "rays.py").write_text("mine")
    with staged_folder(tmp_path, ("estimates/riekf.npz", "rays.png", LAST), LAST, ("estimates/*", "animation.*")) as at:
        fill(at, "new", ("estimates/riekf.npz", LAST))
    expected = {"rays.py": "mine", "estimates/riekf.npz": "new", LAST: "new", "budget.json": "old"}
    assert texts(tmp_path) == expected
    with staged_folder(tmp_path, ["report.html"], LAST) as stage:
        fill(stage, "new", ("report.html",))
    assert texts(tmp_path) == expected | {"report.html": "new"}


def test_folders_of_others_are_refused_before_any_work(tmp_path: Path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis/thesis.tex").write_text("mine")
    remedy = (
        rf"^{tmp_path}/thesis: exists already, and slamgauge has not made it .*; move it away or give another --out$"
    )
    with pytest.raises(UserError, match=remedy), staged_folder(tmp_path / "thesis", FILES, LAST):
        pytest.fail("the block must not run")
    with pytest.raises(UserError, match=remedy):
        begin_folder(tmp_path / "thesis")
    assert texts(tmp_path) == {"thesis/thesis.tex": "mine"}
    (tmp_path / "empty").mkdir()
    publish(tmp_path / "empty", "new")
    begin_folder(tmp_path / "begun")
    publish(tmp_path / "begun", "new")
    assert texts(tmp_path / "empty") == texts(tmp_path / "begun") == dict.fromkeys(FILES, "new")


def test_places_that_cannot_be_written_are_refused_before_any_work(tmp_path: Path):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("file", "file/run", "link", "n" * 300):
        expected = rf"{name}: cannot be written \(.+\); check the path"
        with pytest.raises(UserError, match=expected), staged_folder(tmp_path / name, FILES, LAST):
            pytest.fail("the block must not run")


def test_single_files_never_replace_others(tmp_path: Path):
    with staged_files(tmp_path, ["table.tex"]) as stage:
        fill(stage, "new", ("table.tex",))
        assert not (tmp_path / "table.tex").exists()
    expected = rf"^{tmp_path}/table.tex: exists already; move it away or give another name$"
    with pytest.raises(UserError, match=expected), staged_files(tmp_path, ["table.tex"]):
        pytest.fail("the block must not run")
    assert texts(tmp_path) == {"table.tex": "new"}


def draws(*names: str, then: BaseException | None = None) -> Drawing:
    def draw(stage: Path) -> None:
        fill(stage, "drawn", names)
        if then is not None:
            raise then

    return draw


def test_a_failed_drawing_is_reported_and_the_others_are_published(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    publish(tmp_path, "old", (LAST, "a.svg"))
    drawings = {
        "a": draws("a.png", then=OSError(28, "No space left")),
        "b": draws("b.png"),
        "pages/c": draws("pages/c"),
    }
    assert not decorate(tmp_path, drawings, ("a.png", "a.svg", "b.png", "pages/c"))
    assert texts(tmp_path) == {LAST: "old", "b.png": "drawn", "pages/c": "drawn"}
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"slamgauge: {tmp_path / 'a'}: not written (OSError: [Errno 28] No space left")
    with pytest.raises(KeyboardInterrupt, match=f"^the results are in {tmp_path}, without pictures$"):
        decorate(tmp_path, {"a": draws("a.png", then=KeyboardInterrupt())}, ("a.png",))
