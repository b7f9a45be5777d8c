"""Pictures next to results: a failure does not affect the others."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.storage.best_effort import Drawing, decorate
from slamgauge.compare.storage.manifest import owned
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError

RESULT = "metrics.json"
WRITES = ("a.png", "a.svg", "b.png", "pages/c.md")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder of results."""
    with staged_folder(tmp_path / "out", [RESULT], RESULT) as stage:
        (stage / RESULT).write_text("{}")
    return tmp_path / "out"


def draws(*names: str, then: BaseException | None = None) -> Drawing:
    def draw(stage: Path) -> None:
        for name in names:
            (stage / name).parent.mkdir(exist_ok=True)
            (stage / name).write_text(name)
        if then is not None:
            raise then

    return draw


def test_all_drawings_are_published(out: Path, capsys: pytest.CaptureFixture[str]):
    assert decorate(out, RESULT, {"a": draws("a.png", "a.svg"), "pages/c": draws("pages/c.md")}, WRITES)
    assert owned(out) == {RESULT, "a.png", "a.svg", "pages/c.md"}
    assert decorate(out, RESULT, {"b": draws("b.png")}, WRITES)
    assert owned(out) == {RESULT, "b.png"}
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(28, "No space left on device"), "OSError: [Errno 28] No space left on device"),
        (MemoryError(), "MemoryError: "),
        (UserError("too many"), "too many"),
        (ValueError("\n\\frac\n ^"), "ValueError: \\frac ^ (test_best_effort.py, line "),
    ],
)
def test_a_failed_drawing_is_reported_and_the_others_are_published(
    out: Path, capsys: pytest.CaptureFixture[str], error: Exception, reason: str
):
    drawings = {"a": draws("a.png", then=error), "b": draws("b.png"), "pages/c": draws("pages/c.md", then=error)}
    assert not decorate(out, RESULT, drawings, WRITES)
    assert owned(out) == {RESULT, "b.png"}
    assert {path.name for path in out.rglob("*")} == {RESULT, "b.png", ".slamgauge.json"}
    lines = capsys.readouterr().err.splitlines()
    for name, line in zip(("a", "pages/c"), lines, strict=True):
        assert line.startswith(f"slamgauge: {out / name}: not written ({reason}")


def test_a_file_of_another_origin_prevents_the_pictures_only(out: Path, capsys: pytest.CaptureFixture[str]):
    def other_program(_: Path) -> None:
        (out / "a.png").write_text("mine")

    assert not decorate(out, RESULT, {"a": draws("a.png"), "b": other_program}, WRITES)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"slamgauge: {out / 'a.png'}: exists already, and slamgauge has not written it")
    assert (out / "a.png").read_text() == "mine"
    assert owned(out) == {RESULT}


def test_the_message_of_an_interrupt_names_the_written_results(out: Path):
    with pytest.raises(KeyboardInterrupt, match=f"^the results are in {out}, without pictures$"):
        decorate(out, RESULT, {"a": draws("a.png", then=KeyboardInterrupt())}, WRITES)
    assert {path.name for path in out.iterdir()} == {RESULT, ".slamgauge.json"}
