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
    ("slamgauge study --runs 3 --preci", "--precision"),
    ("slamgauge run q1-long-dense --out rec", "record.npz"),
]
# what readline does: asks the function, and takes files where it says nothing, by -o default
BASH = """
source {script}
COMP_WORDS=({typed})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
registered=$(complete -p slamgauge)
$(sed 's/.*-F //; s/ .*//' <<< "$registered")
[[ ${{#COMPREPLY[@]}} = 0 && $registered = *"-o default"* ]] && COMPREPLY=($(compgen -f "${{COMP_WORDS[-1]}}"))
echo "${{COMPREPLY[@]}}"
"""
ZSHRC = "fpath+=~/.zfunc; autoload -Uz compinit; compinit -u; PROMPT='ready '\n"  # -u: whoever owns the folders


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's own folder with one file in it, and the command on the path."""
    for variable, value in {
        "HOME": str(tmp_path),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }.items():
        monkeypatch.setenv(variable, value)
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


def test_bash_completes(home: Path, capsys: pytest.CaptureFixture[str]):
    script = install("bash", home, capsys)
    for typed, expected in TYPED:
        told = subprocess.run(
            ["bash", "-c", BASH.format(script=script, typed=typed)], capture_output=True, text=True, check=False
        )
        assert told.stdout.split() == [expected], told


def test_fish_completes(home: Path, capsys: pytest.CaptureFixture[str]):
    install("fish", home, capsys)
    for typed, expected in TYPED:
        told = subprocess.run(["fish", "-c", f"complete -C '{typed}'"], capture_output=True, text=True, check=False)
        assert [line.split("\t")[0] for line in told.stdout.splitlines()] == [expected], told


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
            os.write(terminal, b"\x15")  # control and u: the line is emptied
    finally:
        os.close(terminal)  # the shell ends with its terminal
        os.waitpid(child, 0)


def read_until(terminal: int, expected: str) -> None:
    """Read what a terminal shows until this text is there; fails after half a minute."""
    shown, end = "", time.monotonic() + 30
    while expected not in shown:
        assert select.select([terminal], [], [], max(0.0, end - time.monotonic()))[0], f"no {expected!r} in {shown!r}"
        shown += os.read(terminal, 65536).decode(errors="replace")
