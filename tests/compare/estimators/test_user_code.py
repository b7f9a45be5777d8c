"""User modules: found as in a script of their folder, and by no other import."""

from __future__ import annotations

import gc
import json
import os
import random
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import slamgauge.ekf
from slamgauge.compare.estimators.adapters import adapted
from slamgauge.compare.estimators.private_import import PrivateFolder
from slamgauge.compare.estimators.user_code import address, load_callable_module

from .conftest import short

pytestmark = pytest.mark.slow

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """Return a function that writes files into the current folder, by path."""
    monkeypatch.chdir(tmp_path)

    def write(files: dict[str, str]) -> Path:
        for name, text in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path

    return write


def value(text: str) -> object:
    return own(text)(None)  # pyrefly: ignore[bad-argument-type]


def own(text: str) -> slamgauge.Estimator:
    return adapted(address(text))[0]


@pytest.mark.parametrize(
    "statement",
    [
        "import pack.deep.leaf\nx = pack.deep.leaf.X",
        "import pack.deep.leaf as leaf\nx = leaf.X",
        "from pack.deep import leaf\nx = leaf.X",
        "from pack.deep.leaf import X as x",
        "from pack.deep.leaf import *\nx = X",
        "from pack import up\nx = up.X",
        "import pack.up\nx = pack.up.X",
        "from .pack.deep.leaf import X as x",
        "import importlib\nx = importlib.import_module('pack.deep.leaf').X",
        "from importlib import import_module\nx = import_module('pack.deep.leaf').X",
        "import importlib.util\nx = importlib.util.find_spec and importlib.import_module('pack.deep.leaf').X",
        "x = __import__('pack.deep.leaf').deep.leaf.X",
        "import plain.leaf\nx = plain.leaf.X",
        "space = {}\nexec('from pack.deep.leaf import X', space)\nx = space['X']",
    ],
)
@pytest.mark.parametrize("place", ["at its head", "in a function"])
def test_every_form_of_import_finds_the_neighbours(write: Write, statement: str, place: str):
    if place == "at its head":
        source = f"{statement}\ndef f(_):\n    return x\n"
    elif "*" in statement:
        pytest.skip("Python allows it at the head alone")
    else:
        source = "def f(_):\n    " + statement.replace("\n", "\n    ") + "\n    return x\n"
    files = {
        "own.py": source,
        "pack/__init__.py": "",
        "pack/deep/__init__.py": "",
        "pack/deep/leaf.py": "X = 7\n",
        "pack/up.py": "from .deep.leaf import X\nfrom . import deep\nfrom pack.deep import leaf\nassert leaf.X == X\n",
        "plain/leaf.py": "X = 7\n",  # a folder without __init__.py
    }
    write(files)
    before = {*sys.modules}
    assert value("own.py:f") == value("own:f") == 7
    assert all(name.startswith("_slamgauge_own_") for name in {*sys.modules} - before)


def test_neighbours_hide_libraries_in_user_code_only(write: Write):
    folder = write(
        {
            "own.py": "import json, random, numpy, textwrap, sys, os\n"
            "def f(_): return json.X, random.X, numpy.X, textwrap.dedent(' a'), sys.maxsize, os.sep\n",
            **{f"{name}.py": f"X = {name!r}\n" for name in ("json", "random", "numpy", "sys", "os")},
        }
    )
    assert value("own.py:f") == ("json", "random", "numpy", "a", sys.maxsize, os.sep)  # sys and os: as in Python
    assert str(folder) not in sys.path
    assert all(hasattr(*each) for each in ((json, "dumps"), (random, "random"), (np, "zeros")))
    assert __import__("json") is json


def test_a_folder_without_code_hides_no_library(write: Write):
    write({"own.py": "import json, data\ndef f(_): return json.dumps([1]), data.__name__\n", "json/a.txt": ""})
    Path("data").mkdir()
    text, _ = value("own.py:f")  # pyrefly: ignore[not-iterable]
    assert text == "[1]"


def test_a_neighbour_never_hides_slamgauge(write: Write):
    write({"own.py": "import slamgauge\ndef f(_): return slamgauge.wrap(0.0)\n", "slamgauge.py": "1 / 0\n"})
    assert value("own.py:f") == 0.0


def test_files_of_equal_names_are_separate(write: Write):
    for who in ("anna", "ben"):
        write({f"{who}/ekf.py": "from helper import X\ndef f(_): return X\n", f"{who}/helper.py": f"X = {who!r}\n"})
    assert [value(f"{who}/ekf.py:f") for who in ("anna", "ben", "anna")] == ["anna", "ben", "anna"]


def test_every_loading_is_separate(write: Write):
    write(
        {
            "own.py": "import helper\ndef f(_):\n    helper.X.append(1)\n    return len(helper.X)\n",
            "helper.py": "X = []",
        }
    )
    first, second = own("own.py:f"), own("own.py:f")
    assert [first(None), first(None), second(None)] == [1, 2, 1]  # pyrefly: ignore[bad-argument-type]
    write({"helper.py": "X = [0] * 5"})  # perhaps within the same second
    assert value("own.py:f") == 6


STEP = """
import helper
DT, Q, Py = 0.1, helper.eye(2), helper.eye(2)
def ekf_slam(xEst, PEst, u, y):
    import late
    return xEst, PEst
"""
PLAIN = """
import helper
def estimate(recording):
    import late
    return late.dead_reckoning(recording)
"""
BESIDE = {"helper.py": "from numpy import eye\n", "late.py": "import helper\nfrom slamgauge import dead_reckoning\n"}


@pytest.mark.parametrize(("source", "callee"), [(STEP, "ekf_slam"), (PLAIN, "estimate")])
@pytest.mark.parametrize("place", ["own.py", "own"])
def test_fifty_runs_leave_no_more_modules_than_one(write: Write, source: str, callee: str, place: str):
    write({"own.py": source, **BESIDE})
    recording = short("q1-short-dense", "trajectory.duration=0.2")

    def left_by(runs: int) -> tuple[int, int]:
        for _ in range(runs):
            own(f"{place}:{callee}")(recording)
        gc.collect()
        living = sum(isinstance(each, PrivateFolder) for each in gc.get_objects())
        return len(sys.modules), living

    assert left_by(1) == left_by(50)
    assert not any(name.startswith("_slamgauge_own_") for name in sys.modules)


def test_the_first_run_uses_the_first_loading(write: Write):
    count = "LOADED = open('loaded', 'a').write('x')\n"
    folder = write({"own.py": f"{count}{STEP}", **BESIDE})
    estimator, recording = own("own.py:ekf_slam"), short("q1-short-dense", "trajectory.duration=0.2")
    for times in (1, 2, 3):
        estimator(recording)
        assert len((folder / "loaded").read_text()) == times


def test_code_called_after_its_run_imports_the_same_modules(write: Write):
    write(
        {
            "own.py": "import helper\ndef f(_):\n    def late():\n        import helper as again, other\n"
            "        return again is helper is other.helper, other\n    return late\n",
            "helper.py": "",
            "other.py": "import helper\n",
        }
    )
    late: Any = value("own.py:f")
    is_the_same, other = late()
    assert is_the_same
    assert late() == (True, other)


def test_modules_that_import_each_other(write: Write):
    write(
        {
            "own.py": "import one\ndef f(_): return one.get()\n",
            "one.py": "import two\nfrom two import Y\nX = 1\ndef get(): return X + Y + two.get()\n",
            "two.py": "import one\nY = 10\ndef get(): return 100 * one.X\n",
        }
    )
    assert value("own.py:f") == 111


def test_a_file_in_a_package_may_import_relatively(write: Write):
    write(
        {
            "pack/__init__.py": "",
            "pack/own.py": "from .helper import X\ndef f(_): return X\n",
            "pack/helper.py": "X = 3",
        }
    )
    assert value("pack/own.py:f") == value("pack.own:f") == 3


def test_threads_import_at_the_same_time(write: Write):
    source = "import time\ntime.sleep(0.05)\nX = object()\n"
    write({"own.py": "def f(_):\n    import slow\n    return slow.X\n", "slow.py": source})
    estimator = own("own.py:f")
    with ThreadPoolExecutor(8) as pool:
        assert len({id(each) for each in pool.map(estimator, [None] * 8)}) == 1


def test_user_classes_can_be_pickled_and_their_source_read(write: Write):
    write(
        {
            "own.py": "import dataclasses, inspect, pickle as p\n@dataclasses.dataclass\n"
            "class State:\n    x: 'int' = 1\n"
            "def f(_):\n    return p.loads(p.dumps(State())) == State() and 'x: ' in inspect.getsource(State)\n"
        }
    )
    assert value("own.py:f") is True


def test_installed_modules_are_found_where_the_folder_has_none(write: Write):
    write({})
    assert load_callable_module(address("slamgauge.ekf:dead_reckoning")) is slamgauge.ekf
    assert own("textwrap:dedent")(" a") == "a"  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("text", "label", "place", "attribute"),
    [
        ("ekf.py:f", "ekf.py:f", "ekf.py", "f"),
        ("a/b/ekf.py:f", "ekf.py:f", "a/b/ekf.py", "f"),
        ("pack.ekf:f", "pack.ekf:f", "pack.ekf", "f"),
        ("mine=a/ekf.py:f", "mine", "a/ekf.py", "f"),
        ("my filter=pack.ekf:f", "my filter", "pack.ekf", "f"),
    ],
)
def test_addresses(text: str, label: str, place: str, attribute: str):
    assert address(text)[:4] == (text, label, place, attribute)


def test_a_path_with_an_equals_sign_is_no_label(write: Write):
    write({"gate=9/ekf.py": "def f(_): return 1\n"})
    assert address("gate=9/ekf.py:f").label == "ekf.py:f"
    assert value("gate=9/ekf.py:f") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ekf", "write FILE.py:callable or module:callable"),
        ("ekf.py:", "write FILE.py:callable or module:callable"),
        ("=ekf.py:f", "label '' names files of results; give a short word without slashes"),
        ("a/b=ekf.py:f", "label 'a/b' names files of results"),
        ("my\u00a0filter=own.py:f", r"label 'my\\xa0filter' names files of results; give a short word"),
        ("\u2003=own.py:f", r"label '\\u2003' names files of results; give a short word"),
        (f"{'n' * 300}=own.py:f", "label .* names files of results; give a short word"),
        (" =own.py:f", "label ' ' names files of results; give a short word"),
        ("my.ekf.py:f", "no Python module can have a dot in its name; rename the file"),
        ("nothing.py:f", "no file 'nothing.py' is found; check the path"),
        ("pack.nothing:f", "no module 'pack.nothing' is found; run in its folder or install it, or give its file"),
        ("own.py:f", r"it raised ModuleNotFoundError: No module named 'pack.nothing' \(own.py, line 1\)"),
        ("deep.py:f", r"it raised ZeroDivisionError: division by zero \(broken.py, line 2\); mend it"),
        ("bad.py:f", r"it raised SyntaxError: .*bad.py, line 2\)"),
    ],
)
def test_wrong_addresses(write: Write, text: str, message: str):
    write(
        {
            "pack/__init__.py": "",
            "own.py": "import pack.nothing\n",
            "deep.py": "def f(_): pass\nimport broken\n",
            "broken.py": "X = 0\nY = 1 / X\n",
            "bad.py": "\ndef f(_)\n",
        }
    )
    with pytest.raises(ValueError, match=message) as caught:
        own(text)
    assert "_slamgauge_own_" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_private_folder_loads_its_modules_by_name(write: Write):
    folder = PrivateFolder(write({"own.py": "X = 1\n"}))
    assert isinstance(folder.load("own"), ModuleType)
    assert (folder.owns("own.x"), folder.owns("numpy"), folder.owns("slamgauge")) == (True, False, False)
