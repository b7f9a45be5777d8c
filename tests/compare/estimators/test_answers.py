"""Answers of processes with user code: every field that slamgauge would not write is an error of one line."""

from __future__ import annotations

import json
from io import BytesIO

import numpy as np
import pytest

from slamgauge import Estimate
from slamgauge.compare.estimators import answers
from slamgauge.compare.estimators.answers import Answer, message, read_answer
from slamgauge.compare.estimators.user_errors import UserCodeError

pytestmark = pytest.mark.slow

ESTIMATE = Estimate("filtered", np.zeros((3, 3)))


def npz(**arrays: object) -> bytes:
    file = BytesIO()
    np.savez(file, **arrays)  # pyrefly: ignore[bad-argument-type]
    return file.getvalue()


def test_an_estimate_arrives_as_it_was_sent():
    stream = BytesIO(message({"seconds": 0.5, "remarks": ["one"]}, ESTIMATE) + message({"form": "two"}))
    first, second = read_answer(stream), read_answer(stream)
    assert first is not None and second is not None
    np.testing.assert_array_equal(first.estimate().poses, ESTIMATE.poses)
    assert (first.seconds(1.0), first.texts("remarks"), first.error) == (0.5, ["one"], None)
    assert (second.text("form"), read_answer(stream)) == ("two", None)


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-1", "1e9", f"1{400 * '0'}", "true", "null", '"1"', "[1]"])
def test_times_that_no_run_takes_are_refused(value: str):
    with pytest.raises(UserCodeError, match=r"^its process wrote a wrong answer .seconds is not from 0 to .*leave"):
        Answer({"seconds": json.loads(value)}, b"").seconds(1.0)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"[]\n", "not a JSON object"),
        (b"{\n", "not a line of JSON"),
        (b"[" * 50_000 + b"\n", "not a line of JSON"),
        (b'{"bytes": 1' + b"0" * 5000 + b"}\n", "not a line of JSON"),
        (b'{"bytes": NaN}\n', "bytes is not a size"),
        (b'{"bytes": -1}\n', "bytes is not a size"),
        (b'{"bytes": true}\n', "bytes is not a size"),
        (b"{}\n", "bytes is not a size"),
        (b"x" * 2_000_000, "too long a line"),
        (b'{"bytes": 500000001}\n', "its estimate has 500 MB; keep it below 500 MB"),
    ],
)
def test_what_is_no_message_is_refused(data: bytes, expected: str):
    with pytest.raises(UserCodeError, match=expected):
        read_answer(BytesIO(data))


def test_texts_are_short_printable_lines():
    assert Answer({"form": "a\x1b[31m\n" + "x" * 5000}, b"").text("form") == "a [31m " + "x" * 993
    for remarks in ("one", ["one", 2], ["one"] * 101, {"one": 1}):
        with pytest.raises(UserCodeError, match="remarks is not a short list of texts"):
            Answer({"remarks": remarks}, b"").texts("remarks")
    with pytest.raises(UserCodeError, match="attribute is not a text"):
        Answer({"attribute": 1}, b"").text("attribute")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "its estimate is not an npz file"),
        (b"junk", "its estimate is not an npz file"),
        (b"\x93NUMPY\x01\x00", "its estimate is not an npz file"),
        (npz(kind=object()), "not a whole npz file of plain arrays"),
        (npz(kind="filtered", poses="x"), "poses"),
        (npz(kind="filtered", poses=np.zeros((2, 3)), more=1.0), "more"),
    ],
)
def test_what_is_no_estimate_is_refused(content: bytes, expected: str):
    with pytest.raises(UserCodeError, match=rf"^[^\n]*{expected}[^\n]*$"):
        Answer({}, content).estimate()


def test_an_estimate_too_large_to_read_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(answers, "MOST_BYTES", 1000)
    with pytest.raises(UserCodeError, match="its estimate has 0 MB; keep it below 0 MB"):
        Answer({}, npz(kind="filtered", poses=np.zeros((1000, 3)))).estimate()
