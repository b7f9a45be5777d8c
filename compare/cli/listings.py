"""Commands that print what is installed with slamgauge: `slamgauge scenarios`, `schema` and `completion`."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

import tyro

from slamgauge.compare.cli.terminal import Output, put

Kind = Literal["metrics", "summary", "sweep", "budget", "grades", "noise", "bench", "check", "scenarios", "doctor"]
SPECIFICATION = "COMPLETION_SPEC = "  # first words of the line of tyro's script that lists options and their help
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
class Scenarios:
    """List the shipped scenarios with descriptions. In a pipe, each is one line.

    For example:
      slamgauge scenarios
    """

    json: bool = False
    """Print JSON on standard output."""

    def __call__(self) -> int:
        from slamgauge.compare.scenarios.scenario import shipped_scenarios
        from slamgauge.compare.scoring.text_page import Page

        found = shipped_scenarios()
        width = max(len(name) for name, _ in found)
        page = Page(tuple(f"{name:{width}}  {text}" for name, text in found))
        output = Output(self.json, wide=not sys.stdout.isatty())
        return 0 if output.show([{"name": name, "description": text} for name, text in found], page) else 1


@dataclass
class Schema:
    """Print the JSON Schema of a result file or of the output of --json, with meanings and units.

    For example:
      slamgauge schema metrics
    """

    kind: tyro.conf.Positional[Kind]
    """The name of the file, or of the command that prints it."""

    def __call__(self) -> int:
        schema = files("slamgauge.compare.schemas") / f"{self.kind}.json"
        return 0 if put(schema.read_text(encoding="utf-8").rstrip()) else 1


@dataclass
class Completion:
    """Print a script for a shell that completes commands, options and files.

    For example:
      slamgauge completion zsh > ~/.zfunc/_slamgauge
    """

    shell: tyro.conf.Positional[Literal["bash", "fish", "zsh"]]
    """The shell."""

    def __call__(self) -> int:
        """Print tyro's script for the shell, extended so that it completes files where no command or option fits.

        A shell reads each line as one option, so this method joins help of several lines. It also changes options of
        tyro's type `path` to the type `value`: the shell then completes their folders and spaces, and does it better
        than tyro's script.
        """
        command = [sys.executable, "-P", "-m", "slamgauge", "--tyro-print-completion", self.shell]
        lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.rstrip("\n").split("\n")
        for at, line in enumerate(lines):
            if line.startswith(SPECIFICATION):
                lines[at] = re.sub(r"\\+n", " ", line).replace("'type': 'path'", "'type': 'value'")
        return 0 if put("\n".join([*lines, FILES[self.shell]])) else 1
