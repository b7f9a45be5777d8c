"""`slamgauge completion`."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import dataclass
from typing import Literal

import tyro

from slamgauge.compare.cli.options import print_result

SPECIFICATION = "COMPLETION_SPEC = "  # first words of the line in which tyro's script lists options and their help
# tyro's script completes no paths of positional arguments; these lines complete files where it finds nothing
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
    """Print the script by which a shell completes commands, options and files.

    For example:
      slamgauge completion zsh > ~/.zfunc/_slamgauge
    """

    shell: tyro.conf.Positional[Literal["bash", "fish", "zsh"]]
    """The shell."""

    def __call__(self) -> int:
        """Print the script; return the exit status."""
        return 0 if print_result(completion_script(self.shell)) else 1


def completion_script(shell: str) -> str:
    """Return tyro's script for a shell, extended so that it completes files where no command or option fits.

    Shells read each line as one option, so help of several lines becomes one line. Paths become plain values, because
    the shell completes folders and blanks better than tyro's script.
    """
    command = [sys.executable, "-P", "-m", "slamgauge", "--tyro-print-completion", shell]
    script = subprocess.run(command, capture_output=True, text=True, check=True).stdout.rstrip("\n")
    lines = [_corrected(line) if line.startswith(SPECIFICATION) else line for line in script.split("\n")]
    return "\n".join(lines) + "\n" + FILES[shell]


def _corrected(line: str) -> str:
    return re.sub(r"\\+n", " ", line).replace("'type': 'path'", "'type': 'value'")
