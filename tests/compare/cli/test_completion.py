"""The printed script completes commands, options and files in each shell."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest

from slamgauge.compare.cli.main import main
from tests.reference.external_programs import program

PLACES = {
    "bash": ".local/share/bash-completion/completions/slamgauge",
    "fish": ".config/fish/completions/slamgauge.fish",
    "zsh": ".zfunc/_slamgauge",
}
TYPED = [
    ("slamgauge stu", "study"),
    ("slamgauge evaluate rec", "record.npz"),
    ("slamgauge study --runs 3 --again", "--against"),
    ("slamgauge run q1-long-dense --out rec", "record.npz"),
]
# like readline: call the function and, if it returns nothing, complete files (-o default)
BASH = """
source {script}
COMP_WORDS=({typed})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
registered=$(complete -p slamgauge)
$(sed 's/.*-F //; s/ .*//' <<< "$registered")
[[ ${{#COMPREPLY[@]}} = 0 && $registered = *"-o default"* ]] && COMPREPLY=($(compgen -f "${{COMP_WORDS[-1]}}"))
echo "${{COMPREPLY[@]}}"
"""
ZSHRC = "fpath+=~/.zfunc; autoload -Uz compinit; compinit -u; PROMPT='ready '\n"  # -u: whatever the owners


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home folder with one file in it, and the command on the path."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "record.npz").touch()
    return tmp_path


def install(shell: str, home: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    program(shell, shell)
    assert main(["completion", shell]) == 0
    script = home / PLACES[shell]
    script.parent.mkdir(parents=True)
    script.write_text(capsys.readouterr().out)
    return script


@pytest.mark.parametrize("shell", ["bash", "fish"])
def test_bash_and_fish_complete(shell: str, home: Path, capsys: pytest.CaptureFixture[str]):
    script = install(shell, home, capsys)
    for typed, expected in TYPED:
        code = BASH.format(script=script, typed=typed) if shell == "bash" else f"complete -C '{typed}'"
        done = subprocess.run([shell, "-c", code], capture_output=True, text=True, check=False)
        assert [line.split("\t")[0].strip() for line in done.stdout.splitlines()] == [expected], done


def test_zsh_completes(home: Path, capsys: pytest.CaptureFixture[str]):
    install("zsh", home, capsys)
    (home / ".zshrc").write_text(ZSHRC)
    child, terminal = pty.fork()
    if child == 0:
        os.execlp("zsh", "zsh", "-i")
    try:
        read_until(terminal, "ready ")
        for typed, expected in TYPED:
            os.write(terminal, f"{typed}\t".encode())
            read_until(terminal, expected.removeprefix(typed.split()[-1]))
            os.write(terminal, b"\x15")  # control and u empty the line
    finally:
        os.close(terminal)  # the shell ends with its terminal
        os.waitpid(child, 0)


def read_until(terminal: int, expected: str) -> None:
    """Read the terminal until it shows this text; fail after half a minute."""
    shown, end = "", time.monotonic() + 30
    while expected not in shown:
        assert select.select([terminal], [], [], max(0.0, end - time.monotonic()))[0], f"no {expected!r} in {shown!r}"
        shown += os.read(terminal, 65536).decode(errors="replace")
