"""`slamgauge completion`."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from slamgauge.compare.cli.options import print_result
from slamgauge.errors import UserError

SHELLS = ("bash", "zsh")
# where shells look by themselves, below the user's own folder, or are told to
PLACES = {
    "bash": ".local/share/bash-completion/completions/slamgauge",
    "zsh": ".zfunc/_slamgauge",
}
SPECIFICATION = "COMPLETION_SPEC = "  # how the line begins in which tyro names options and their help
THEN = {
    "bash": "new shells have it (package bash-completion)",
    "zsh": "have `fpath+=~/.zfunc; autoload -Uz compinit; compinit` in ~/.zshrc",
}


@dataclass
class Completion:
    """Let the shell complete commands and options: writes the script to where the shell looks for it.

    For example:
      slamgauge completion
      slamgauge completion --shell zsh --print
    """

    shell: Literal["bash", "zsh"] | None = None
    """For which; yours, of the environment variable SHELL, if not given."""

    print: bool = False
    """Print the script on standard output instead."""

    def __call__(self) -> None:
        """Write or print it."""
        from slamgauge.compare.storage.files import explained

        shell = self.shell or Path(os.environ.get("SHELL", "")).name
        if shell not in SHELLS:
            raise UserError(f"shell: {shell or 'none'} has no completion here; give --shell {', '.join(SHELLS)}")
        if self.print:
            print_result(completion_script(shell))
            return
        place = Path.home() / PLACES[shell]
        with explained(place, "written"):
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(completion_script(shell) + "\n", encoding="utf-8")
        sys.stderr.write(f"written to {place}: {THEN[shell]}\n")


def completion_script(shell: str) -> str:
    """The script by which a shell completes `slamgauge`, as tyro makes it of all commands.

    To the shell an option and its help are a line: help of several lines becomes one, or its ends would be offered.
    """
    command = [sys.executable, "-P", "-m", "slamgauge", "--tyro-print-completion", shell]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.rstrip("\n").split("\n")
    return "\n".join(line.replace("\\n", " ") if line.startswith(SPECIFICATION) else line for line in lines)
