"""Folders of results after killed commands, and with several commands at once."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from slamgauge.compare.storage.manifest import owned, require_free, write_manifest
from slamgauge.compare.storage.staged_folder import PUBLISHING, begin_file, publishing, staged_folder
from tests.reference.staged_files import FILES, LAST, fill, in_the_way, publish, texts

# --- killed ------------------------------------------------------------------------------------

MOVES = ("replace", "unlink", "rmdir")


def killed_at(monkeypatch: pytest.MonkeyPatch, count: int, action: Callable[[], None]) -> bool:
    """Run `action`, end it at its `count`-th change of a folder without clean-up, and return whether it was ended."""
    changes = list[Path]()

    def patched(name: str) -> Callable[..., Any]:
        original = getattr(Path, name)

        def change(self: Path, *arguments: Any, **options: Any) -> Any:
            changes.append(self)
            if len(changes) > count:
                raise KeyboardInterrupt
            return original(self, *arguments, **options)

        return change

    with monkeypatch.context() as patch:
        for name in MOVES:
            patch.setattr(Path, name, patched(name))
        patch.setattr("shutil.rmtree", lambda *_, **__: None)
        try:
            action()
        except KeyboardInterrupt:
            return True
    return False


def finished(out: Path) -> dict[str, str]:
    return {name: text for name, text in texts(out).items() if ".partial" not in name}


def test_after_a_kill_the_manifest_is_right_and_a_folder_with_the_last_file_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    old, new = ("estimates/ekf.npz", "a.txt", LAST), ("estimates/riekf.npz", "a.txt", "b.txt", LAST)
    kills = 0
    for count in range(100):
        out = tmp_path / str(count)
        publish(out, "old", old)
        (out / "estimates/mine.npz").write_text("mine")
        if not killed_at(monkeypatch, count, lambda out=out: publish(out, "new", new, ("estimates/*",))):
            break
        kills += 1
        left = {name: text for name, text in finished(out).items() if name != PUBLISHING}
        assert owned(out) == left.keys() - {"estimates/mine.npz"}
        if LAST in left:
            expected = dict.fromkeys(old, "old") if left[LAST] == "old" else dict.fromkeys(new, "new")
            assert left == expected | {"estimates/mine.npz": "mine"}
        publish(out, "newer", new, ("estimates/*",))  # completes the interrupted publication
        assert finished(out) == dict.fromkeys(new, "newer") | {"estimates/mine.npz": "mine"}
    assert kills > 8


def test_an_interrupt_while_publishing_has_a_message_and_leaves_no_partial_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    publish(tmp_path, "old")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", Mock(side_effect=[KeyboardInterrupt, None]))
        with pytest.raises(KeyboardInterrupt, match=f"^{tmp_path} is written in part; the same command makes it whole"):
            publish(tmp_path, "new")
    assert not [*tmp_path.glob(".slamgauge.*.partial")]
    publish(tmp_path, "new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "new")


def test_a_file_that_replaces_an_unpublished_one_after_a_kill_is_of_another_origin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The manifest of the killed command lists these names under `moving`."""
    old, new = ("estimates/ekf.npz", "a.txt", LAST), ("a.txt", "b.txt", LAST)
    gaps = 0
    for count in range(100):
        out = tmp_path / str(count)
        publish(out, "old", old)
        if not killed_at(monkeypatch, count, lambda out=out: publish(out, "new", new, ("estimates/*",))):
            break
        for name in {*old, *new}:
            if not (out / name).exists() and (out / name).parent.exists():
                gaps += 1
                (out / name).write_text("mine")
                assert name not in owned(out)
                with pytest.raises(ValueError, match=in_the_way(out / name)):
                    require_free(out, [name])
                publish(out, "other", ("other.txt",), ("*",))
                assert (out / name).read_text() == "mine"
                (out / name).unlink()
    assert gaps > 8


def test_a_file_written_in_place_stays_in_the_manifest(tmp_path: Path):
    for text in ("", "more", "and more"):
        begin_file(tmp_path / "new", "study.sqlite")
        assert owned(tmp_path / "new") == {"study.sqlite"}
        (tmp_path / "new/study.sqlite").write_text(text)
    (tmp_path / "new/study.sqlite-wal").write_text("of SQLite")
    assert owned(tmp_path / "new") == {"study.sqlite", "study.sqlite-wal"}


def test_begin_file_does_not_take_over_a_file_of_another_origin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "study.sqlite").touch()
    with pytest.raises(ValueError, match=in_the_way(tmp_path / "study.sqlite")):
        begin_file(tmp_path, "study.sqlite")

    def appears(*arguments: Any) -> None:
        write_manifest(*arguments)
        (tmp_path / "other.sqlite").write_text("mine")

    monkeypatch.setattr("slamgauge.compare.storage.staged_folder.write_manifest", appears)
    with pytest.raises(ValueError, match=r"cannot be written \(File exists\)"):
        begin_file(tmp_path, "other.sqlite")
    assert owned(tmp_path) == set()
    assert (tmp_path / "other.sqlite").read_text() == "mine"


# --- partial folders and several commands ------------------------------------------------------


def beside(out: Path) -> list[Path]:
    """Return partial folders in the folder and next to it."""
    return [*out.parent.glob(".slamgauge.*.partial"), *out.glob(".slamgauge.*.partial")]


@pytest.mark.parametrize("existing", [False, True])
def test_the_next_command_removes_the_partial_folder_of_a_killed_one(tmp_path: Path, existing: bool):
    out = tmp_path / "out"
    if existing:
        publish(out, "old")
    staged = "from slamgauge.compare.storage.staged_folder import staged_folder\nimport os, signal, sys\n"
    killed = "with staged_folder(sys.argv[1], ['a.txt'], 'a.txt') as stage:\n    (stage / 'a.txt').write_text('x')\n"
    program = f"{staged}{killed}    os.kill(os.getpid(), signal.SIGKILL)\n"
    assert subprocess.run([sys.executable, "-c", program, out], check=False).returncode == -signal.SIGKILL
    assert len(beside(out)) == 1
    publish(out, "new")
    assert beside(out) == []
    assert texts(out) == dict.fromkeys(FILES, "new")


def test_partial_folders_in_use_and_of_another_origin_are_kept(tmp_path: Path):
    """A copy of a partial folder counts as of another origin."""
    publish(tmp_path, "old")
    foreign = tmp_path / ".slamgauge.0badcafe.partial"
    foreign.mkdir()
    (foreign / "owner").write_text("mine")
    (tmp_path / ".slamgauge.1badcafe.partial").write_text("mine")
    (tmp_path / ".slamgauge.2badcafe.partial").symlink_to(foreign)
    with staged_folder(tmp_path, FILES, LAST) as stage:
        fill(stage, "slow")
        shutil.copytree(stage.parent, tmp_path / ".slamgauge.3badcafe.partial")
        publish(tmp_path, "quick")
        assert texts(stage) == dict.fromkeys(FILES, "slow")
    assert {path.name[11] for path in beside(tmp_path)} == {*"0123"}
    assert (foreign / "owner").read_text() == "mine"
    assert (tmp_path / LAST).read_text() == "slow"


def test_commands_that_publish_at_once_leave_one_complete_result(tmp_path: Path):
    """Threads lock each other like processes, because each opens the folder itself."""
    for attempt in range(10):
        out = tmp_path / str(attempt)
        names = [(f"estimates/{text}.npz", "a.txt", *(f"{text}{n}.txt" for n in range(5)), LAST) for text in "abcd"]
        gate = threading.Barrier(len(names))

        def one(text: str, mine: tuple[str, ...], out: Path = out, gate: threading.Barrier = gate) -> None:
            with staged_folder(out, mine, LAST, ("estimates/*", "*.txt")) as stage:
                fill(stage, text, mine)
                gate.wait()

        with ThreadPoolExecutor(len(names)) as pool:
            for done in [pool.submit(one, text, mine) for text, mine in zip("abcd", names, strict=True)]:
                done.result()
        winner = (out / LAST).read_text()
        assert texts(out) == dict.fromkeys(names["abcd".index(winner)], winner)
        assert owned(out) == {*names["abcd".index(winner)]}
        assert beside(out) == []


def test_pictures_of_replaced_results_are_not_published(tmp_path: Path):
    publish(tmp_path, "old")
    with (
        pytest.raises(ValueError, match=rf"^{tmp_path / LAST}: another command has replaced it meanwhile$"),
        staged_folder(tmp_path, ["figure.png"], last="", beside=LAST) as stage,
    ):
        (stage / "figure.png").write_text("old")
        publish(tmp_path, "new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "new")


def test_waiting_for_another_command_has_a_time_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    publish(tmp_path, "old")
    monkeypatch.setattr("slamgauge.compare.storage.staged_folder.PATIENCE", 0.1)
    with (
        publishing(tmp_path),
        pytest.raises(ValueError, match=rf"^{tmp_path}: another command has been writing there for 0.1 s; wait for it"),
    ):
        publish(tmp_path, "new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "old")
