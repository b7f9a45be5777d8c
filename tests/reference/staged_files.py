"""A folder with files that are published together, and the message for files that others have written."""

from __future__ import annotations

from pathlib import Path

from slamgauge.compare.storage.manifest import MANIFEST
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
    """Return the text of every file below a folder except the manifest."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_text() for name, path in found.items() if name != MANIFEST}


def in_the_way(path: Path) -> str:
    return f"^{path}: exists already, and slamgauge has not written it; move it away or give another --out$"
