"""Errors of a Dask cluster are one line; `test_study` has a study on a cluster."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator
from typing import Any

import pytest

from slamgauge.compare.studies import executors as cluster
from slamgauge.compare.studies.executors import dask_cluster
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow

Versions = Callable[[], dict[str, str]]

SERVE = """
from distributed import LocalCluster
if __name__ == "__main__":
    cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None)
    print(cluster.scheduler_address, flush=True)
    input()
"""


@pytest.fixture
def scheduler(request: pytest.FixtureRequest) -> Generator[str]:
    """The address of a scheduler in this process, with the number of workers of the test's parameter."""
    from distributed import LocalCluster

    options: dict[str, Any] = {"n_workers": request.param, "threads_per_worker": 1, "dashboard_address": None}
    local: Any = LocalCluster(processes=False, protocol="tcp", **options)
    with local:
        yield f"{local.scheduler_address}"


def elsewhere(theirs: Versions) -> Versions:
    """Return a function that returns the versions here, and the result of `theirs` in a worker."""
    own, here = cluster.versions(), threading.get_ident()
    return lambda: own if threading.get_ident() == here else theirs()


@pytest.mark.parametrize("scheduler", [0], indirect=True)
def test_a_scheduler_without_workers(scheduler: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cluster, "WORKERS", 0.2)
    with pytest.raises(UserError, match=r"^scheduler \S+: has no workers; start one: dask worker \S+$"):
        dask_cluster(scheduler).__enter__()


@pytest.mark.parametrize("scheduler", [1], indirect=True)
def test_workers_of_another_version(scheduler: str, monkeypatch: pytest.MonkeyPatch):
    own = cluster.versions()
    monkeypatch.setattr(cluster, "versions", elsewhere(lambda: {**own, "numpy": "1.0"}))
    line = rf"^scheduler \S+: worker \S+ has numpy 1.0, and this is {own['numpy']}; install the same on both sides$"
    with pytest.raises(UserError, match=line):
        dask_cluster(scheduler).__enter__()


@pytest.mark.parametrize("scheduler", [1], indirect=True)
def test_workers_without_slamgauge(scheduler: str, monkeypatch: pytest.MonkeyPatch):
    def missing() -> dict[str, str]:
        raise ModuleNotFoundError("No module named 'slamgauge'")

    monkeypatch.setattr(cluster, "versions", elsewhere(missing))
    line = r"^scheduler \S+: its workers cannot run slamgauge \(No module named 'slamgauge'\); install slamgauge 0"
    with pytest.raises(UserError, match=line):
        dask_cluster(scheduler).__enter__()


def test_a_scheduler_that_is_killed_is_one_line_within_seconds(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(cluster, "CONNECT", 3.0)
    client_log = logging.getLogger("distributed.client")
    with subprocess.Popen([sys.executable, "-c", SERVE], stdin=-1, stdout=-1, stderr=-3, text=True) as served:
        assert served.stdout is not None
        address, begun = served.stdout.readline().strip(), time.monotonic()
        line = r"^scheduler \S+: lost; start it again, and give the same command again$"
        with pytest.raises(UserError, match=line), dask_cluster(address) as executor:
            assert not client_log.isEnabledFor(logging.ERROR)  # its log sometimes repeats the error
            run = executor.submit(time.sleep, 60.0)
            served.kill()
            begun = time.monotonic()
            run.result()
        assert time.monotonic() - begun < 20.0
    assert capfd.readouterr().err == ""
    assert client_log.isEnabledFor(logging.ERROR)


@pytest.mark.parametrize(
    ("address", "line"),
    [
        ("tcp://127.0.0.1:1", r"scheduler tcp://127.0.0.1:1: [^\n]*; give a running one"),
        ("tls://127.0.0.1:1", r"scheduler tls://\S+: tls needs certificates; name them in the environment: [^\n]+"),
        *(
            (address, rf"scheduler '{address}' is not an address; give tcp://host:port or tls://host:port")
            for address in ("nonsense", "ftp://127.0.0.1:1", "tcp://127.0.0.1:x", "127.0.0.1:8786", "")
        ),
    ],
)
def test_addresses_without_a_scheduler_are_refused_in_a_line(address: str, line: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    with pytest.raises(UserError, match=f"^{line}$"):
        dask_cluster(address).__enter__()
