"""What user code prints is kept in a file, and errors name the user's own line."""

from __future__ import annotations

import gc
import io
import re
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from slamgauge import load_estimators, load_scenario, simulate
from slamgauge.compare.estimators import captured_output
from slamgauge.compare.estimators.captured_output import captured
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow

HEAD = """
import sys
import numpy as np
from slamgauge import Estimate
print("loading")

def estimate(recording):
    print("step 1\\nstep 2")
    print("warning", file=sys.stderr)
    print("step 3\\nstep 4")
"""
_, RECORDING = simulate(load_scenario("q1-short-dense", ["trajectory.duration=1"]), 0)


def run(folder: Path, body: str, name: str) -> None:
    (folder / "mine.py").write_text(f"{HEAD}    {body}\n")
    run_estimator(name, load_estimators([f"{name}={folder / 'mine.py'}:estimate"])[name], RECORDING)


def test_prints_go_to_a_file_that_is_named_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    for _ in range(2):
        run(tmp_path, "return Estimate('filtered', np.zeros((11, 3)))", "talker")
    printed = capfd.readouterr()
    assert printed.out == ""
    (place,) = re.findall(r"slamgauge: talker: what it prints is kept in (.*)", printed.err)
    assert not re.search(r"step \d", printed.err.replace(place, ""))  # another notice lists the form `step`
    assert Path(place).read_text() == 2 * "step 1\nstep 2\nwarning\nstep 3\nstep 4\n"
    Path(place).unlink()


def test_an_error_shows_the_first_lines_and_the_line_of_the_user(tmp_path: Path):
    with pytest.raises(UserError) as caught:
        run(tmp_path, "return np.linalg.inv(np.zeros((2, 2)))", "singular")
    text = str(caught.value)
    place = re.findall(r"it printed first: step 1 / step 2 / warning; all in (.*)\)", text)
    assert len(place) == 1
    assert "it raised LinAlgError: Singular matrix (mine.py, line 11)" in text
    assert "\n" not in text
    Path(place[0]).unlink()


def test_a_file_has_a_largest_size_and_silence_makes_none(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(captured_output, "LARGEST", 1000)
    with captured("endless") as output:
        for _ in range(500):
            print("x" * 99)
    assert output.place is not None
    assert 1000 <= output.place.stat().st_size <= 1100
    output.place.unlink()
    with captured("silent") as output:
        pass
    assert output.place is None
    assert output.first_lines == ""


def test_control_characters_of_prints_do_not_reach_the_terminal():
    with captured("colourful") as output:
        print("\x1b[31mred")
    assert output.first_lines == r"\x1b[31mred"
    assert output.place is not None
    output.place.unlink()


def test_threads_of_a_study_keep_their_output_apart(capfd: pytest.CaptureFixture[str]):
    """Two estimators overlap and end in the order in which they began, while a third thread prints to the terminal."""
    streams = sys.stdout, sys.stderr
    both_inside, first_is_out = threading.Barrier(3), threading.Event()

    def estimate(name: str) -> str:
        with captured(name) as output:
            both_inside.wait(10)
            print(f"step of {name}")
            if name == "later":
                first_is_out.wait(10)
                print("after", file=sys.stderr)
        first_is_out.set()
        assert output.place is not None
        text = output.place.read_text()
        output.place.unlink()
        return text

    with ThreadPoolExecutor(2) as pool:
        results = pool.map(estimate, ["earlier", "later"])
        both_inside.wait(10)
        print("result of a built-in estimator")
        assert [*results] == ["step of earlier\n", "step of later\nafter\n"]
    assert (sys.stdout, sys.stderr) == streams
    printed = capfd.readouterr()
    assert printed.out == "result of a built-in estimator\n"
    assert printed.err.count("what it prints is kept in") == 2


def test_the_file_is_named_after_an_error_too(capfd: pytest.CaptureFixture[str]):
    with pytest.raises(ZeroDivisionError), captured("failing") as output:
        print("before")
        raise ZeroDivisionError
    assert f"failing: what it prints is kept in {output.place}" in capfd.readouterr().err
    assert output.place is not None
    output.place.unlink()


def test_a_print_survives_the_end_of_the_capture_of_another_thread(monkeypatch: pytest.MonkeyPatch):
    """`print` of Python before 3.14 keeps no reference to `sys.stdout`, which must not be freed while it writes."""
    writing, ended, heard = threading.Event(), threading.Event(), list[str]()

    class Slow(io.StringIO):
        def write(self, text: str, /) -> int:
            heard.append(text)
            writing.set()
            ended.wait(10)
            return len(text)

    monkeypatch.setattr(sys, "stdout", Slow())
    printing = threading.Thread(target=lambda: print("a line"))  # outside `captured`
    with captured("silent too"):
        printing.start()
        writing.wait(10)
    gc.collect()
    ended.set()
    printing.join(10)
    assert heard == ["a line", "\n"]


def test_an_error_of_loading_shows_the_first_lines(tmp_path: Path):
    (tmp_path / "mine.py").write_text("print('reading')\nX = print('log')\ndef estimate(r, x=1 / 0):\n    return X\n")
    with pytest.raises(UserError, match=r"cannot be loaded, it raised ZeroDivisionError") as caught:
        load_estimators([f"broken={tmp_path / 'mine.py'}:estimate"])
    assert "(mine.py, line 3); mend it and run again (it printed first: " in str(caught.value)
    assert "reading / log" in str(caught.value)
