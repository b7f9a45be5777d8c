"""Folders of results: complete or absent, without changes to other files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamgauge.compare.storage.manifest import MANIFEST, owned
from slamgauge.compare.storage.staged_folder import staged_folder
from tests.reference.staged_files import FILES, LAST, fill, in_the_way, publish, texts

# --- complete or absent ------------------------------------------------------------------------


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
    assert owned(out) == {*FILES}
    assert [path.name for path in out.parent.iterdir()] == ["run"]


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_changes_nothing(tmp_path: Path, existing: bool, error: type[BaseException]):
    out = tmp_path / "run"
    if existing:
        publish(out, "old")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(error), staged_folder(out, FILES[:2], LAST, ("*",)) as stage:
        fill(stage, "new")
        raise error
    assert sorted(tmp_path.rglob("*")) == before
    assert not existing or texts(out) == dict.fromkeys(FILES, "old")


def test_a_block_that_does_not_write_the_last_file_keeps_the_old_one(tmp_path: Path):
    publish(tmp_path, "old")
    with staged_folder(tmp_path, ["report.html"], LAST) as stage:
        (stage / "report.html").write_text("new")
    assert texts(tmp_path) == dict.fromkeys(FILES, "old") | {"report.html": "new"}
    assert owned(tmp_path) == {*FILES, "report.html"}


def test_a_path_that_cannot_be_written_is_an_error_on_entry(tmp_path: Path):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to("nowhere")
    written = r"(run|file|link): cannot be written \(.+\); check the path"
    too_long = r"cannot be (read|written) \(File name too long\)"
    for name, expected in (("file", written), ("file/run", written), ("link", written), ("n" * 300, too_long)):
        with pytest.raises(ValueError, match=expected), staged_folder(tmp_path / name, FILES, LAST):
            pytest.fail("the block must not run")


# --- removed files -----------------------------------------------------------------------------


def test_outdated_files_are_removed_and_other_files_are_kept(tmp_path: Path):
    """Files of an earlier run would look like results of the later one."""
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


def test_an_emptied_folder_is_removed(tmp_path: Path):
    publish(tmp_path, "old")
    publish(tmp_path, "new", (LAST,), outdated=("estimates/*",))
    assert not (tmp_path / "estimates").exists()


# --- files of another origin -------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_files_of_another_origin_are_an_error_on_entry(tmp_path: Path, name: str):
    fill(tmp_path, "mine", (name,))
    with pytest.raises(ValueError, match=in_the_way(tmp_path / name)), staged_folder(tmp_path, FILES, LAST):
        pytest.fail("the block must not run")
    assert texts(tmp_path) == {name: "mine"}


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("name", FILES)
def test_files_of_another_origin_that_appear_later_are_an_error_at_the_end(tmp_path: Path, name: str, existing: bool):
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


def test_a_folder_instead_of_a_file_and_a_file_instead_of_a_folder_are_errors(tmp_path: Path):
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
    """A link has replaced a file or folder that slamgauge wrote."""
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


# --- invalid manifests -------------------------------------------------------------------------

INVALID = "not a list of files that slamgauge has written; move it "
DIGEST = "0" * 64


def content_of(files: object, moving: object, **more: object) -> str:
    return json.dumps({"files": files, "moving": moving, **more})


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "\x00", "[]", "{}", '{"files": []}', "[" * 100_000),
        *(content_of(files, {}) for files in ({}, "thesis.tex", [1], [None], [["a.txt"]])),
        *(content_of([], {"a.txt": digests}) for digests in (None, DIGEST, [1], ["0"])),
        content_of([], []),
        content_of([], {"../thesis.tex": [DIGEST]}),
        content_of([], {}, more=[]),
    ],
)
def test_an_invalid_manifest_is_an_error(tmp_path: Path, text: str):
    out = tmp_path / "out"
    out.mkdir()
    (out / MANIFEST).write_text(text)
    with pytest.raises(ValueError, match=rf"^{out / MANIFEST}: {INVALID}[^\n]+$"), staged_folder(out, FILES, LAST):
        pytest.fail("the block must not run")
    assert {path.name: path.read_text() for path in out.iterdir()} == {MANIFEST: text}


@pytest.mark.parametrize(
    "name",
    [
        *("", ".", "..", "../thesis.tex", "/etc/passwd", "a/../../b", "a/./b", "./a", "a//b", "a/"),
        *("a\0", "a\nb", "\ud800", MANIFEST),
    ],
)
def test_paths_outside_the_folder_are_an_error(tmp_path: Path, name: str):
    (tmp_path / MANIFEST).write_text(content_of(["a.txt", name], {}))
    with pytest.raises(ValueError, match=f"{INVALID}away"):
        owned(tmp_path)


def test_a_manifest_with_names_of_other_files_does_not_remove_them(tmp_path: Path):
    foreign = {"thesis.tex": "mine", "rays.py": "mine", "deep/notes.txt": "mine"}
    (tmp_path / "deep").mkdir()
    for name, text in foreign.items():
        (tmp_path / name).write_text(text)
    (tmp_path / MANIFEST).write_text(content_of([*foreign, "no/such/file"], {}))
    publish(tmp_path, "new", FILES, ("estimates/*", "rays.png"))
    assert texts(tmp_path) == foreign | dict.fromkeys(FILES, "new")


@pytest.mark.parametrize("kind", ["folder", "link", "dangling link"])
def test_a_manifest_that_is_a_folder_or_a_link_is_an_error(tmp_path: Path, kind: str):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere.json"
    out.mkdir()
    if kind == "folder":
        (out / MANIFEST).mkdir()
    else:
        (out / MANIFEST).symlink_to(elsewhere)
    if kind == "link":
        elsewhere.write_text('{"files": [], "moving": {}}')
    with pytest.raises(ValueError, match="not a list of files that slamgauge has written"):
        publish(out, "new")
    assert [path.name for path in out.iterdir()] == [MANIFEST]
