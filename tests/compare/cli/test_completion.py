"""Completion is installed where shells look for it, and completes what there is."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from slamgauge.compare.cli.main import main

ASK = """
source {script}
COMP_WORDS=(slamgauge {words})
COMP_CWORD={place}
function=$(complete -p slamgauge | sed 's/.*-F //; s/ .*//')
$function slamgauge {last} before
echo ${{COMPREPLY[@]}}
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.parametrize(("words", "expected"), [("stu", "study"), ("study --runs 3 --preci", "--precision")])
def test_bash_completes_commands_and_options(
    words: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", "/bin/bash")
    assert main(["completion"]) == 0
    script = tmp_path / ".local/share/bash-completion/completions/slamgauge"
    assert str(script) in capsys.readouterr().err
    place, last = len(words.split()), words.split()[-1]
    asked = ASK.format(script=script, words=words, place=place, last=last)
    told = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=False)
    assert told.stdout.split() == [expected], told


def test_it_is_printed_for_the_shell_that_is_named(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    assert main(["completion", "--shell", "zsh", "--print"]) == 0
    assert capsys.readouterr().out.startswith("#compdef slamgauge")
    monkeypatch.setenv("SHELL", "/bin/fish")
    assert main(["completion"]) == 2
    assert capsys.readouterr().err == "slamgauge: shell: fish has no completion here; give --shell bash, zsh\n"
