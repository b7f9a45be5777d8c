"""Answers of processes with user code: every field that slamgauge would not write is an error of one line."""

from __future__ import annotations

import json
from io import BytesIO

import numpy as np
import pytest

from slamgauge import Estimate
from slamgauge.compare.estimators import answers
from slamgauge.compare.estimators.answers import Answer, Incoming, address_fields, message, read_address
from slamgauge.compare.estimators.user_code import UserCodeError, address

from .conftest import EXAMPLES

pytestmark = pytest.mark.slow

ESTIMATE = Estimate("filtered", np.zeros((3, 3)))


def npz(**arrays: object) -> bytes:
    file = BytesIO()
    np.savez(file, **arrays)  # pyrefly: ignore[bad-argument-type]
    return file.getvalue()


def npy() -> bytes:
    file = BytesIO()
    np.save(file, 1.0)
    return file.getvalue()


def test_an_estimate_arrives_in_pieces_as_it_was_sent():
    data, incoming = message({"seconds": 0.5, "cpu_seconds": 1, "remarks": ["one"]}, ESTIMATE), Incoming()
    *before, answer = [incoming.add(data[start : start + 7]) for start in range(0, len(data), 7)]
    assert answer is not None and not any(before)
    np.testing.assert_array_equal(answer.estimate().poses, ESTIMATE.poses)
    assert (answer.spent(1.0), answer.texts("remarks"), answer.reason) == ((0.5, 1.0), ["one"], "")


def test_two_messages_may_arrive_at_once():
    incoming = Incoming()
    first = incoming.add(message({"form": "one"}, ESTIMATE) + message({"form": "two"}))
    second = incoming.add(b"")
    assert first is not None and second is not None
    assert (first.text("form"), second.text("form"), incoming.add(b"")) == ("one", "two", None)


def test_an_address_arrives_as_it_was_sent():
    where = address(f"mine={EXAMPLES}/student_ekf.py:ekf_slam")._replace(strangers=("bob",), noise="file")
    assert read_address(BytesIO(message(address_fields(where)))) == where


@pytest.mark.parametrize("key", ["seconds", "cpu_seconds"])
@pytest.mark.parametrize("value", ["NaN", "Infinity", "-1", "1e9", f"1{400 * '0'}", "true", "null", '"1"', "[1]"])
def test_times_that_no_run_takes_are_refused(key: str, value: str):
    fields = {"seconds": 0.0, "cpu_seconds": 0.0, key: json.loads(value)}
    with pytest.raises(UserCodeError, match=f"^its process wrote a wrong answer .{key} is not from 0 to .*leave"):
        Answer(fields, b"").spent(1.0)


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
        (b"x" * 200_000, "too long a line"),
        (b'{"bytes": 500000001}\n', "its estimate has 500 MB; keep it below 500 MB"),
    ],
)
def test_what_is_no_message_is_refused(data: bytes, expected: str):
    with pytest.raises(UserCodeError) as caught:
        Incoming().add(data)
    assert expected in str(caught.value)


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
        (npy(), "its estimate is not an npz file"),
        (npz(kind=object()), "not a whole npz file of plain arrays"),
        (npz(kind="filtered", poses="x"), "poses"),
        (npz(kind="filtered", poses=np.zeros((2, 3)), more=1.0), "more"),
    ],
)
def test_what_is_no_estimate_is_refused(content: bytes, expected: str):
    with pytest.raises(UserCodeError) as caught:
        Answer({}, content).estimate()
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_estimate_too_large_to_read_is_refused(monkeypatch: pytest.MonkeyPatch):
    content = npz(kind="filtered", poses=np.zeros((1000, 3)))
    monkeypatch.setattr(answers, "MOST_BYTES", 1000)
    with pytest.raises(UserCodeError, match="its estimate has 0 MB; keep it below 0 MB"):
        Answer({}, content).estimate()
