"""Run all checks, `python -m tests`, or some of them, `python -m tests lint types`.

`python -m tests quick` runs lint, format and the quick tests; `python -m tests full` runs all checks and all tests (see
`tests.sizes`).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from slamgauge.blas_threads import pin_blas_threads
from tests.sizes import SIZES, USUAL

ROOT = Path(__file__).parents[1]
PACKAGES = ("ekf", "graph_baseline", "compare")

WORKERS = str((os.cpu_count() or 1) + 1)  # one more than cores, because some tests wait for programs and timeouts

CHECKS = {
    "kernels": ["tests.kernels"],
    "lint": ["ruff", "check", "."],
    "format": ["ruff", "format", "--check", "."],
    "types": ["pyrefly", "check", "--output-format", "min-text", "--python-interpreter-path", sys.executable],
    "pages": ["sphinx", "--quiet", "--fail-on-warning", "--keep-going", "docs", "build/site"],
    "tests": ["pytest", "-n", WORKERS, "--dist", "loadfile", "--no-loadscope-reorder"],
}
ALL_CORES = "tests"  # the other checks use one core each
QUICK = ("kernels", "lint", "format", "tests")  # checks of the size `quick`; the other sizes have all


def main(names: Sequence[str] = ()) -> int:
    """Run the named checks, or those of a size, and continue after a failure.

    The exit status is 0 if all passed, 1 if one failed, 2 for an unknown name.
    """
    size = names[0] if len(names) == 1 and names[0] in SIZES else USUAL
    unknown = [name for name in names if name not in CHECKS and name != size]
    if unknown:
        print(f"no check is called {unknown[0]!r}; use {', '.join((*CHECKS, *SIZES))}", file=sys.stderr)
        return 2
    link_packages()
    pin_blas_threads()  # the tests run on all cores already
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each program that tests start would compile all its modules
    chosen = [name for name in names if name != size] or [*(QUICK if size == "quick" else CHECKS)]
    first = [name for name in chosen if name != ALL_CORES]
    with ThreadPoolExecutor(2) as executor:  # they run on while tests wait for timeouts and child processes
        running = {name: executor.submit(passes, name) for name in first}
        if "kernels" in running:
            running["kernels"].result()
        tests_failed = ALL_CORES in chosen and not passes(ALL_CORES, f"--size={size}")
    failed = [name for name, check in running.items() if not check.result()] + [ALL_CORES] * tests_failed
    print(f"failed: {', '.join(failed)}" if failed else "all checks passed")
    return 1 if failed else 0


def passes(name: str, *options: str) -> bool:
    """Run a check and print its output at the end, the output of the tests at once."""
    module, *arguments = *CHECKS[name], *options
    command, title = [sys.executable, "-m", module, *arguments], f"== {name}: {' '.join([module, *arguments])}\n"
    if name == ALL_CORES:
        print(title, end="", flush=True)
        return subprocess.run(command, cwd=ROOT, check=False).returncode == 0
    done = subprocess.run(
        command, cwd=ROOT, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8"
    )
    print(title + done.stdout, end="", flush=True)
    return done.returncode == 0


def link_packages() -> None:
    """Make `build/links/slamgauge` like the installed package, because the type checker follows no import hooks."""
    links = ROOT / "build/links/slamgauge"
    shutil.rmtree(links, ignore_errors=True)
    links.mkdir(parents=True)
    modules, folders = (ROOT / "core").glob("*.py"), (each.parent for each in (ROOT / "core").glob("*/__init__.py"))
    for place in (*modules, *folders, *(ROOT / package for package in PACKAGES)):
        (links / place.name).symlink_to(place)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
