"""What the command says of mistakes, defects and refusals of the machine, and its exit status."""

from __future__ import annotations

import errno
from unittest.mock import Mock

import pytest

import slamgauge
from slamgauge.compare.cli.main import main


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"slamgauge {slamgauge.__version__}\n"


@pytest.mark.parametrize("error", [KeyError("gain"), ValueError("operands could not be broadcast"), RuntimeError("?")])
def test_what_is_no_users_mistake_is_a_defect_with_its_traceback_and_where_to_report_it(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("slamgauge.compare.scenarios.scenario.shipped_scenarios", Mock(side_effect=error))
    assert main(["scenarios"]) == 70
    printed = capsys.readouterr()
    assert printed.out == ""
    lines = printed.err.splitlines()
    assert lines[0] == "Traceback (most recent call last):"
    assert lines[-2].startswith(type(error).__name__)
    assert lines[-1].startswith("slamgauge: this is a defect of slamgauge, not a mistake of yours; please report it")
    assert f"slamgauge {slamgauge.__version__}" in lines[-1]


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate 8 TiB"), OSError(errno.ENOSPC, "No space left on device")]
)
def test_what_the_machine_refuses_is_one_line(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("slamgauge.compare.scenarios.scenario.shipped_scenarios", Mock(side_effect=error))
    assert main(["scenarios"]) == 71
    printed = capsys.readouterr()
    assert (printed.out, len(printed.err.splitlines())) == ("", 1)
    assert str(error) in printed.err
    assert printed.err.endswith("; make room and give the same command again\n")


def test_names_that_would_end_a_line_are_written_out(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "a\u2028b\x1b.npz"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("slamgauge: a\\u2028b\\x1b.npz: cannot be read")
    assert len(told.splitlines()) == 1


def test_paths_that_are_too_long_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["evaluate", "x" * 5000], ["export", "[" * 3000, "--format", "csv", "--out", "x"]):
        assert main(words) == 2
        told = capsys.readouterr().err
        assert told.startswith("slamgauge: ")
        assert told.count("\n") == 1
