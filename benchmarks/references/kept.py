"""What has been judged, kept in a file of JSON lines, so that a long run can be interrupted and resumed."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from functools import cache
from pathlib import Path

from references.verdicts import Judged, Outcome

ROOT = Path(__file__).parents[2]
JUDGING = ("core", "ekf", "graph_baseline", "benchmarks/references", "tests/reference")


class Kept:
    """The judged recordings of a file, one line each, written as soon as they are there.

    Lines that other code has judged do not count, nor does one that was cut short.
    """

    def __init__(self, path: Path, seed: int) -> None:
        self._path = path
        self.judged: list[Judged] = []
        text = path.read_text() if path.exists() else ""
        for line in text.splitlines():
            try:
                content = json.loads(line)
            except json.JSONDecodeError:
                continue
            if content.pop("code") == code() and content["seed"] == seed:
                outcomes, tags = [Outcome(**each) for each in content.pop("outcomes")], tuple(content.pop("tags"))
                self.judged.append(Judged(**content, tags=tags, outcomes=outcomes))

        if text and not text.endswith("\n"):
            self._write("\n")

    def keep(self, judged: Judged) -> None:
        """Write one more, on a line of its own."""
        self._write(json.dumps({"code": code(), **asdict(judged)}) + "\n")

    def _write(self, text: str) -> None:
        with self._path.open("a") as file:
            file.write(text)


@cache
def code() -> str:
    """Digest of all code that has a say in what is judged."""
    digest = hashlib.sha256()
    for folder in JUDGING:
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()
