"""Folders of results: complete or absent, and no folder of somebody else is written to."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamgauge.compare.storage import staged_folder as folders
from slamgauge.compare.storage.staged_folder import MARK, begin_folder, decorate, staged_files, staged_folder
from slamgauge.errors import UserError

FILES = ("estimates/ekf.npz", "a.txt", "metrics.json", "z.txt")
MAIN = "metrics.json"


def fill(stage: Path, text: str, *names: str) -> None:
    for name in names:
        (stage / name).parent.mkdir(parents=True, exist_ok=True)
        (stage / name).write_text(text)


def publish(out: Path, text: str, *names: str, main: str = MAIN, adds: bool = False) -> None:
    with staged_folder(out, main, adds=adds) as stage:
        fill(stage, text, *(names or FILES))


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
    with staged_folder(out, MAIN) as stage:
        fill(stage, "new", *FILES)
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
    with pytest.raises((RuntimeError, KeyboardInterrupt, OSError)), staged_folder(out, MAIN) as stage:
        fill(stage, "new", *FILES)
        raise error
    assert sorted(tmp_path.rglob("*")) == before
    assert not existing or texts(out) == dict.fromkeys(FILES, "old")


@pytest.mark.parametrize("moves", range(6))
def test_an_interrupt_while_files_are_replaced_leaves_no_complete_mixture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: int
):
    """The main file is there only if all files are of one command."""
    publish(tmp_path, "old")
    move, moved = Path.replace, list[Path]()

    def interrupted(self: Path, target: Path) -> Path:
        if len(moved) == moves:
            raise KeyboardInterrupt
        moved.append(self)
        return move(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", interrupted)
        if moves < len((MARK, *FILES)):
            with pytest.raises(KeyboardInterrupt):
                publish(tmp_path, "new")
        else:
            publish(tmp_path, "new")
    assert (tmp_path / MAIN).exists() == (moves == 5)
    assert not [*tmp_path.glob(".slamgauge.*.partial")]
    publish(tmp_path, "newer")
    assert texts(tmp_path) == dict.fromkeys(FILES, "newer")


def test_files_of_an_earlier_command_are_removed_and_other_files_are_kept(tmp_path: Path):
    """Estimates and pictures of an earlier run would look like results of the later one."""
    publish(tmp_path, "old", "estimates/ekf.npz", "rays.png", MAIN)
    publish(tmp_path, "old", "animation.gif", adds=True)
    publish(tmp_path, "old", "budget.json", main="budget.json")
    (tmp_path / "rays.py").write_text("mine")
    others = {"rays.py": "mine", "budget.json": "old"}
    publish(tmp_path, "new", "estimates/riekf.npz", MAIN)
    assert texts(tmp_path) == others | {"estimates/riekf.npz": "new", MAIN: "new"}
    publish(tmp_path, "new", "report.html", adds=True)
    assert texts(tmp_path) == others | {"estimates/riekf.npz": "new", MAIN: "new", "report.html": "new"}


def test_no_list_of_files_removes_a_file_outside_its_folder(tmp_path: Path):
    """Somebody else may have written the list."""
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "sent").mkdir()
    (tmp_path / "sent" / MARK).write_text(json.dumps({MAIN: ["../thesis.tex", str(tmp_path / "thesis.tex")]}))
    publish(tmp_path / "sent", "new", MAIN)
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    (tmp_path / "sent" / MARK).write_text("mine")
    with pytest.raises(UserError, match="changed by hand"):
        publish(tmp_path / "sent", "new", MAIN)


def test_folders_of_others_and_places_that_cannot_be_written_are_refused_before_any_work(tmp_path: Path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis/thesis.tex").write_text("mine")
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to("nowhere")
    refused = dict.fromkeys(("file", "file/run", "link", "n" * 300), r": cannot be written \(.+\); check the path")
    refused["thesis"] = ": exists already, and slamgauge has not made it .*; move it away or give another --out$"
    for name, message in refused.items():
        with pytest.raises(UserError, match=name + message), staged_folder(tmp_path / name, MAIN):
            pytest.fail("the block must not run")
        with pytest.raises(UserError, match=name + message):
            begin_folder(tmp_path / name)
    assert texts(tmp_path) == {"thesis/thesis.tex": "mine", "file": ""}
    (tmp_path / "empty").mkdir()
    begin_folder(tmp_path / "begun")
    for name in ("empty", "begun"):
        publish(tmp_path / name, "new")
        assert texts(tmp_path / name) == dict.fromkeys(FILES, "new")
    folders.require_ours(tmp_path / "empty", tmp_path / "begun", tmp_path / "none")


def test_single_files_never_replace_others(tmp_path: Path):
    with staged_files(tmp_path, ["table.tex"]) as stage:
        fill(stage, "new", "table.tex")
        assert not (tmp_path / "table.tex").exists()
    expected = rf"^{tmp_path}/table.tex: exists already; move it away or give another name$"
    with pytest.raises(UserError, match=expected), staged_files(tmp_path, ["table.tex"]):
        pytest.fail("the block must not run")
    assert texts(tmp_path) == {"table.tex": "new"}


def draws(name: str, then: BaseException | None = None) -> folders.Drawing:
    def draw(stage: Path) -> None:
        fill(stage, "drawn", name)
        if then is not None:
            raise then

    return draw


def test_a_failed_drawing_is_reported_and_the_others_are_published(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    publish(tmp_path, "old", MAIN)
    lost = draws("a.png", OSError(28, "No space left"))
    assert not decorate(tmp_path, {"a": lost, "b": draws("b.png"), "pages/c": draws("pages/c")}, MAIN)
    assert texts(tmp_path) == {MAIN: "old", "b.png": "drawn", "pages/c": "drawn"}
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"slamgauge: {tmp_path / 'a'}: not written (OSError: [Errno 28] No space left")
    with pytest.raises(KeyboardInterrupt):
        decorate(tmp_path, {"a": draws("a.png", KeyboardInterrupt())}, MAIN)


def test_a_refused_command_leaves_no_folder(tmp_path: Path):
    with pytest.raises(UserError), staged_folder(tmp_path / "results/new", "main.json"):
        raise UserError("seed: -1 is negative")
    assert not any(tmp_path.iterdir())
