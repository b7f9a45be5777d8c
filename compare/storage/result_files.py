"""Names of the files that commands write, the provenance that JSON files record, and user-given names in output.

A name of a user (scenario, file, folder, label) can contain control characters, bytes that are not valid UTF-8 or
markup, and it can be too long for a file name: it passes `shown` or `file_name` before it is printed or written.
"""

from __future__ import annotations

from contextvars import ContextVar

from slamgauge.version import __version__

RECORDING, TRUTH = "recording.npz", "truth.npz"
MAPPING = "recording.toml"  # how the files of a log were read
METRICS = "metrics.json"
REPORT = "report.html"  # page that explains the results in its folder
STORE = "study.sqlite"
LOCK = "-lock"  # next to a store that a command writes to
SUMMARY = "summary.json"
SWEEP = "sweep.json"
OPTIMA = "optimum"  # folder of the stores of the optima, next to those of the values
BUDGET = "budget.json"
NOISE = "noise.json"
EXERCISE = "exercise.json"
STUDIES, RUN_0 = "studies", "run-0"  # folders of the stores, and of the results of run 0 of each setting
TWIN = "twin.toml"
TWIN_PATH, TWIN_MOTION, TWIN_SIGHTINGS = "path.csv", "motion.csv", "sightings.csv"
BENCH = "bench.json"
GRADES, RUBRIC = "grades.csv", "rubric.toml"
GRADESCOPE, RESULTS = "gradescope", "results.json"  # folder with a folder per submission, and its file
PAGES = "submissions"  # folder with a page per submission

LONGEST = 200  # bytes of a file name; most file systems allow 255, and extensions follow
COMMAND: ContextVar[str | None] = ContextVar("COMMAND", default=None)  # what `main` runs at the moment


def origin(scenario_text: str | None) -> dict[str, str | None]:
    """Return version, command (None: a Python program) and scenario (None: without one) for a JSON file."""
    return {"version": __version__, "command": COMMAND.get(), "scenario_text": scenario_text}


def shown(name: str) -> str:
    r"""Return the name with escapes (\x1b, \udcff) for characters that cannot be printed."""
    if name.isprintable():
        return name
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in name)


def file_name(name: str) -> str:
    """Return a valid file name: printable, short, and without folders."""
    plain = shown(name).replace("/", "_").replace("\\", "_").encode()[:LONGEST].decode(errors="ignore")
    return f"_{plain}" if plain in {"", ".", ".."} else plain
