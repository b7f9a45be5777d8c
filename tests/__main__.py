"""Every check behind one command: `python -m tests`."""

from __future__ import annotations

import subprocess
import sys

CHECKS = {
    "lint": ["ruff", "check", "."],
    "format": ["ruff", "format", "--check", "."],
    "types": ["basedpyright", "--pythonpath", sys.executable],
    "tests": ["pytest"],
}


def main() -> int:
    """Run all checks, also after one has failed; the exit status is 0 if every one passed."""
    failed: list[str] = []
    for name, (module, *arguments) in CHECKS.items():
        print(f"== {name}: {' '.join([module, *arguments])}", flush=True)
        if subprocess.run([sys.executable, "-m", module, *arguments], check=False).returncode:
            failed.append(name)
    print(f"failed: {', '.join(failed)}" if failed else "all checks passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
