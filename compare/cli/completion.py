"""`slamgauge completion`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from slamgauge.compare.cli.options import print_result
from slamgauge.errors import UserError

# where shells look by themselves, below the user's own folder, or are told to
PLACES = {
    "bash": ".local/share/bash-completion/completions/slamgauge",
    "fish": ".config/fish/completions/slamgauge.fish",
    "zsh": ".zfunc/_slamgauge",
}
SPECIFICATION = "COMPLETION_SPEC = "  # how the line begins in which tyro names options and their help
THEN = {
    "bash": "new shells have it (package bash-completion)",
    "fish": "new shells have it",
    "zsh": "have `fpath+=~/.zfunc; autoload -Uz compinit; compinit` in ~/.zshrc",
}
# behind tyro's script: where it knows no word, shells offer files, as they do for a command that has no script
FILES = {
    "bash": """
_slamgauge_or_files() {
  _tyro_slamgauge
  [ -n "${COMPREPLY[*]}" ] || COMPREPLY=()
}
complete -o bashdefault -o default -F _slamgauge_or_files slamgauge""",
    "fish": """
function _slamgauge_knows_none
  not string match --quiet -- (commandline --current-token)"*" (_tyro_slamgauge)
end
complete --command slamgauge --condition _slamgauge_knows_none --force-files""",
    "zsh": """
(( compstate[nmatches] )) || _files""",
}


@dataclass
class Completion:
    """Let the shell complete commands and options: writes the script to where the shell looks for it.

    For example:
      slamgauge completion
      slamgauge completion --shell zsh --print
    """

    shell: Literal["yours", "bash", "fish", "zsh"] = "yours"
    """For which; yours is the one of the environment variable SHELL."""

    print: bool = False
    """Print the script on standard output instead."""

    def __call__(self) -> None:
        """Write or print it."""
        from slamgauge.compare.storage.files import explained

        shell = Path(os.environ.get("SHELL", "")).name if self.shell == "yours" else self.shell
        if shell not in PLACES:
            raise UserError(f"shell: {shell or 'none'} has no completion here; give --shell {', '.join(PLACES)}")
        if self.print:
            print_result(completion_script(shell))
            return
        place = Path.home() / PLACES[shell]
        with explained(place, "written"):
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(completion_script(shell) + "\n", encoding="utf-8")
        sys.stderr.write(f"written to {place}: {THEN[shell]}\n")


def completion_script(shell: str) -> str:
    """The script by which a shell completes `slamgauge`, as tyro makes it of all commands, and files elsewhere.

    To the shell an option and its help are a line: help of several lines becomes one, or its ends would be offered.
    Paths are left to the shell, which knows better than tyro how folders and blanks are written.
    """
    command = [sys.executable, "-P", "-m", "slamgauge", "--tyro-print-completion", shell]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.rstrip("\n").split("\n")
    script = [specified(line) if line.startswith(SPECIFICATION) else line for line in lines]
    return "\n".join(script) + "\n" + FILES[shell]


def specified(line: str) -> str:
    """The line of options, with help in one line each, and without paths."""
    return re.sub(r"\\+n", " ", line).replace("'type': 'path'", "'type': 'value'")
