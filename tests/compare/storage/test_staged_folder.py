"""Folders of results: whole or not there, and nothing of anybody else's is touched, whatever ends the process."""

from __future__ import annotations

import json
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

from slamgauge.compare.storage import manifest, partial_folder
from slamgauge.compare.storage.manifest import MANIFEST, begin_file, owned, require_free, write_manifest
from slamgauge.compare.storage.staged_folder import staged_folder

FILES = ("estimates/ekf.npz", "a.txt", "metrics.json", "z.txt")
LAST = "metrics.json"


def fill(stage: Path, text: str, names: tuple[str, ...] = FILES) -> None:
    for name in names:
        (stage / name).parent.mkdir(exist_ok=True)
        (stage / name).write_text(text)


def publish(out: Path, text: str, names: tuple[str, ...] = FILES, outdated: tuple[str, ...] = ()) -> None:
    with staged_folder(out, names, LAST, outdated) as stage:
        fill(stage, text, names)


def texts(folder: Path) -> dict[str, str]:
    """Every file below a folder but the manifest."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_text() for name, path in found.items() if name != MANIFEST}


# --- whole or not there ------------------------------------------------------------------------


def test_a_new_folder_appears_at_the_end(tmp_path: Path):
    out = tmp_path / "deep" / "run"
    with staged_folder(out, FILES, LAST) as stage:
        fill(stage, "new")
        assert not out.exists()
    assert texts(out) == dict.fromkeys(FILES, "new")
    assert owned(out) == {*FILES}
    assert [path.name for path in out.parent.iterdir()] == ["run"]


def test_an_existing_folder_is_updated(tmp_path: Path):
    out = tmp_path / "run"
    publish(out, "old")
    (out / "notes.txt").write_text("mine")
    with staged_folder(out, FILES, LAST) as stage:
        fill(stage, "new")
        assert (out / LAST).read_text() == "old"
    assert texts(out) == dict.fromkeys(FILES, "new") | {"notes.txt": "mine"}


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_leaves_everything_as_it_was(tmp_path: Path, existing: bool, error: type[BaseException]):
    out = tmp_path / "run"
    if existing:
        publish(out, "old")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(error), staged_folder(out, FILES, LAST) as stage:
        fill(stage, "new")
        raise error
    assert sorted(tmp_path.rglob("*")) == before
    assert not existing or texts(out) == dict.fromkeys(FILES, "old")


def test_a_block_without_the_last_file_leaves_that_of_another_command(tmp_path: Path):
    publish(tmp_path, "old")
    with staged_folder(tmp_path, ["report.html"], LAST) as stage:
        (stage / "report.html").write_text("new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "old") | {"report.html": "new"}
    assert owned(tmp_path) == {*FILES, "report.html"}


def test_an_unusable_place_is_refused_on_entry(tmp_path: Path):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to("nowhere")
    for out in (tmp_path / "file", tmp_path / "file" / "run", tmp_path / "link"):
        expected = r"(run|file|link): cannot be written \(.+\); check the path"
        with pytest.raises(ValueError, match=expected), staged_folder(out, FILES, LAST):
            pytest.fail("the block must not run")


# --- what goes ---------------------------------------------------------------------------------


def test_old_files_of_ours_go_and_others_stay(tmp_path: Path):
    """What an earlier run left there would be taken for a result of the later one."""
    publish(tmp_path, "old", ("estimates/ekf.npz", "rays.png", "animation.gif", "budget.json", LAST))
    foreign = {"estimates/mine.npz": "mine", "rays.svg": "mine", "rays.py": "mine", "animation.mp4": "mine"}
    for name, text in foreign.items():
        (tmp_path / name).write_text(text)
    with staged_folder(
        tmp_path, ("estimates/riekf.npz", "rays.png", LAST), LAST, ("estimates/*", "animation.*")
    ) as stage:
        fill(stage, "new", ("estimates/riekf.npz", LAST))
    assert texts(tmp_path) == foreign | {"estimates/riekf.npz": "new", LAST: "new", "budget.json": "old"}
    assert owned(tmp_path) == {"estimates/riekf.npz", LAST, "budget.json"}


def test_an_empty_folder_of_ours_goes(tmp_path: Path):
    publish(tmp_path, "old")
    publish(tmp_path, "new", (LAST,), outdated=("estimates/*",))
    assert not (tmp_path / "estimates").exists()


def test_a_failure_removes_no_outdated_file(tmp_path: Path):
    publish(tmp_path, "old")
    with pytest.raises(KeyError), staged_folder(tmp_path, (), LAST, ("*",)):
        raise KeyError
    assert texts(tmp_path) == dict.fromkeys(FILES, "old")


# --- what is in the way ------------------------------------------------------------------------


def in_the_way(path: Path) -> str:
    return f"^{path}: exists already, and slamgauge has not written it; move it away or give another --out$"


@pytest.mark.parametrize("name", FILES)
def test_files_of_others_are_refused_on_entry(tmp_path: Path, name: str):
    fill(tmp_path, "mine", (name,))
    with pytest.raises(ValueError, match=in_the_way(tmp_path / name)), staged_folder(tmp_path, FILES, LAST):
        pytest.fail("the block must not run")
    assert texts(tmp_path) == {name: "mine"}


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("name", FILES)
def test_files_of_others_that_appear_meanwhile_are_refused_at_the_end(tmp_path: Path, name: str, existing: bool):
    out = tmp_path / "out"
    if existing:
        publish(out, "old", ("other.txt",))
    before = texts(out)
    with pytest.raises(ValueError, match=in_the_way(out / name)), staged_folder(out, FILES, LAST) as stage:
        fill(stage, "new")
        out.mkdir(exist_ok=True)
        fill(out, "mine", (name,))
    assert texts(out) == before | {name: "mine"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_for_a_file_and_a_file_for_a_folder_are_in_the_way(tmp_path: Path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(ValueError, match=in_the_way(tmp_path / "a.txt")):
        publish(tmp_path, "new")
    (tmp_path / "a.txt").rmdir()
    (tmp_path / "estimates").write_text("mine")
    with pytest.raises(ValueError, match=in_the_way(tmp_path / "estimates")):
        publish(tmp_path, "new")
    assert texts(tmp_path) == {"estimates": "mine"}


@pytest.mark.parametrize("name", ["metrics.json", "a.txt", "estimates"])
@pytest.mark.parametrize("dangling", [False, True])
def test_nothing_is_written_or_removed_through_links(tmp_path: Path, name: str, dangling: bool):
    """A link in the place of a file or folder that was ours."""
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    publish(out, "old")
    (out / name).rename(elsewhere)
    (out / name).symlink_to(tmp_path / "nowhere" if dangling else elsewhere)
    before = texts(tmp_path)
    with pytest.raises(ValueError, match=in_the_way(out / name)):
        publish(out, "new")
    assert texts(tmp_path) == before
    publish(out, "new", ("z.txt",), outdated=("estimates/*", "a.txt", "metrics.json"))
    assert (out / name).is_symlink()
    assert not (tmp_path / "nowhere").exists()
    moved = elsewhere / "ekf.npz" if name == "estimates" else elsewhere
    assert moved.read_text() == "old"


# --- killed ------------------------------------------------------------------------------------

MOVES = ("replace", "unlink", "rmdir")


def killed_at(monkeypatch: pytest.MonkeyPatch, count: int, action: Callable[[], None]) -> bool:
    """Whether `action` was ended at its `count`-th change of a folder; what cleans up is ended, too."""
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
        patch.setattr("shutil.rmtree", lambda *_, **__: None)  # pyright: ignore[reportUnknownLambdaType]
        try:
            action()
        except KeyboardInterrupt:
            return True
    return False


def test_whenever_it_is_killed_ours_stays_ours_and_a_folder_that_looks_whole_is(
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
        left = {name: text for name, text in texts(out).items() if ".partial" not in name}
        assert owned(out) == left.keys() - {"estimates/mine.npz"}
        if LAST in left:
            expected = dict.fromkeys(old, "old") if left[LAST] == "old" else dict.fromkeys(new, "new")
            assert left == expected | {"estimates/mine.npz": "mine"}
        publish(out, "newer", new, ("estimates/*",))  # goes on where that one was ended
        left = {name: text for name, text in texts(out).items() if ".partial" not in name}
        assert left == dict.fromkeys(new, "newer") | {"estimates/mine.npz": "mine"}
    assert kills > 8


def test_an_interrupt_while_files_are_put_in_place_says_so_and_leaves_no_other_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    publish(tmp_path, "old")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt, match=f"^{tmp_path} is written in part; the same command makes it whole"):
            publish(tmp_path, "new")
    assert not [*tmp_path.glob(".slamgauge.*.partial")]
    publish(tmp_path, "new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "new")


def test_what_somebody_puts_in_the_place_of_a_file_that_was_on_its_way_is_theirs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The killed command had said that it would write, replace or remove files of these names."""
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


def test_a_file_in_place_stays_ours_as_it_grows(tmp_path: Path):
    for text in ("", "more", "and more"):
        begin_file(tmp_path / "new", "study.sqlite")
        assert owned(tmp_path / "new") == {"study.sqlite"}
        (tmp_path / "new/study.sqlite").write_text(text)
    (tmp_path / "new/study.sqlite-wal").write_text("of SQLite")
    assert owned(tmp_path / "new") == {"study.sqlite", "study.sqlite-wal"}


def test_a_file_of_somebody_else_is_not_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "study.sqlite").touch()
    with pytest.raises(ValueError, match=in_the_way(tmp_path / "study.sqlite")):
        begin_file(tmp_path, "study.sqlite")

    def appears(*arguments: Any) -> None:
        write_manifest(*arguments)
        (tmp_path / "other.sqlite").write_text("mine")

    monkeypatch.setattr(manifest, "write_manifest", appears)
    with pytest.raises(ValueError, match=r"cannot be written \(File exists\)"):
        begin_file(tmp_path, "other.sqlite")
    assert owned(tmp_path) == set()
    assert (tmp_path / "other.sqlite").read_text() == "mine"


# --- manifests of others -----------------------------------------------------------------------

DIGEST = "0" * 64


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "\x00",
        "[]",
        "{}",
        '{"files": []}',
        '{"files": {}, "moving": {}}',
        '{"files": "thesis.tex", "moving": {}}',
        '{"files": [1], "moving": {}}',
        '{"files": [null], "moving": {}}',
        '{"files": [["a.txt"]], "moving": {}}',
        '{"files": [], "moving": []}',
        '{"files": [], "moving": {"a.txt": null}}',
        f'{{"files": [], "moving": {{"a.txt": "{DIGEST}"}}}}',
        '{"files": [], "moving": {"a.txt": [1]}}',
        '{"files": [], "moving": {"a.txt": ["0"]}}',
        f'{{"files": [], "moving": {{"../thesis.tex": ["{DIGEST}"]}}}}',
        '{"files": [], "moving": {}, "more": []}',
        "[" * 100_000,
    ],
)
def test_what_is_no_manifest_is_refused_in_one_line(tmp_path: Path, text: str):
    out = tmp_path / "out"
    out.mkdir()
    (out / MANIFEST).write_text(text)
    with (
        pytest.raises(
            ValueError, match=rf"^{out / MANIFEST}: is no list of files that slamgauge has written; move it [^\n]+$"
        ),
        staged_folder(out, FILES, LAST),
    ):
        pytest.fail("the block must not run")
    assert {path.name: path.read_text() for path in out.iterdir()} == {MANIFEST: text}


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        "../thesis.tex",
        "/etc/passwd",
        "a/../../b",
        "a/./b",
        "./a",
        "a//b",
        "a/",
        "a\0",
        "a\nb",
        "\ud800",
        MANIFEST,
    ],
)
def test_names_that_lead_elsewhere_are_refused(tmp_path: Path, name: str):
    (tmp_path / MANIFEST).write_text(json.dumps({"files": ["a.txt", name], "moving": {}}))
    with pytest.raises(ValueError, match=r"is no list of files that slamgauge has written; move it away"):
        owned(tmp_path)


def test_a_manifest_that_names_everything_costs_only_what_is_written(tmp_path: Path):
    foreign = {"thesis.tex": "mine", "rays.py": "mine", "deep/notes.txt": "mine"}
    (tmp_path / "deep").mkdir()
    for name, text in foreign.items():
        (tmp_path / name).write_text(text)
    (tmp_path / MANIFEST).write_text(json.dumps({"files": [*foreign, "no/such/file"], "moving": {}}))
    publish(tmp_path, "new", FILES, ("estimates/*", "rays.png"))
    assert texts(tmp_path) == foreign | dict.fromkeys(FILES, "new")


@pytest.mark.parametrize("kind", ["folder", "link", "dangling link"])
def test_a_manifest_that_is_no_file_is_refused(tmp_path: Path, kind: str):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere.json"
    out.mkdir()
    if kind == "folder":
        (out / MANIFEST).mkdir()
    else:
        (out / MANIFEST).symlink_to(elsewhere)
    if kind == "link":
        elsewhere.write_text('{"files": [], "moving": {}}')
    with pytest.raises(ValueError, match="is no list of files that slamgauge has written"):
        publish(out, "new")
    assert [path.name for path in out.iterdir()] == [MANIFEST]


# --- several commands, and what killed ones leave ----------------------------------------------


def beside(out: Path) -> list[Path]:
    """Partial folders in the folder and next to it."""
    return [*out.parent.glob(".slamgauge.*.partial"), *out.glob(".slamgauge.*.partial")]


@pytest.mark.parametrize("existing", [False, True])
def test_what_a_killed_command_left_is_swept_by_the_next_one(tmp_path: Path, existing: bool):
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


def test_partial_folders_in_use_and_those_of_others_are_not_swept(tmp_path: Path):
    """Whatever lies in a folder of that name: a copy of one of ours is not ours."""
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


def test_commands_that_publish_into_one_folder_at_once_leave_one_whole_result(tmp_path: Path):
    """Threads take locks from each other as processes do: each opens the folder itself."""
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


def test_pictures_of_results_that_have_been_replaced_are_not_published(tmp_path: Path):
    publish(tmp_path, "old")
    with (
        pytest.raises(ValueError, match=rf"^{tmp_path / LAST}: another command has replaced it meanwhile$"),
        staged_folder(tmp_path, ["figure.png"], last="", beside=LAST) as stage,
    ):
        (stage / "figure.png").write_text("old")
        publish(tmp_path, "new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "new")


def test_a_command_that_does_not_end_does_not_make_others_wait_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    publish(tmp_path, "old")
    monkeypatch.setattr(partial_folder, "PATIENCE", 0.1)
    with (
        partial_folder.publishing(tmp_path),
        pytest.raises(ValueError, match=rf"^{tmp_path}: another command has been writing there for 0.1 s; wait for it"),
    ):
        publish(tmp_path, "new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "old")


def test_a_name_that_is_too_long_is_refused_on_entry(tmp_path: Path):
    with (
        pytest.raises(ValueError, match=r"cannot be (read|written) \(File name too long\)"),
        staged_folder(tmp_path / ("n" * 300), FILES, LAST),
    ):
        pytest.fail("the block must not run")
