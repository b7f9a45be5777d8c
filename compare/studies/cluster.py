"""A Dask cluster as executor; it is checked before work begins, and errors are one line.

Anyone who can reach the scheduler can run code on its workers and on this machine: its messages are pickles. Use only
addresses that no one else can reach, or `tls://`.
"""

from __future__ import annotations

import logging
import platform
import re
import warnings
from collections.abc import Generator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, cast

from slamgauge.errors import UserError
from slamgauge.version import __version__

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 10.0  # s to wait for a scheduler
WORKERS = 5.0  # s to wait for its first worker
TLS = "DASK_DISTRIBUTED__COMM__TLS_"


@contextmanager
def dask_cluster(address: str) -> Generator[Executor]:
    """Connect to a running Dask cluster; its workers need the same version of slamgauge.

    Raises:
        UserError: the extra `cluster` is not installed, the address is not valid or needs certificates, no scheduler
            answers, it has no workers or workers of another version, or the connection is lost.
    """
    try:
        from distributed import Client, Security
    except ImportError:
        raise UserError("scheduler: needs the extra 'cluster'; pip install 'slamgauge[cluster]'") from None
    if not re.fullmatch(r"(tcp|tls)://\S+:\d+", address):
        raise UserError(f"scheduler {address!r} is not an address; give tcp://host:port or tls://host:port")
    if address.startswith("tls") and not Security().get_connection_args("client").get("ssl_context"):
        remedy = f"name them in the environment: {TLS}_CA_FILE, {TLS}_CLIENT__CERT, {TLS}_CLIENT__KEY"
        raise UserError(f"scheduler {address}: tls needs certificates; {remedy}")
    with _quiet():
        try:
            client = Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TypeError, RuntimeError) as error:  # TimeoutError is an OSError
            raise UserError(f"scheduler {address}: {_first_line(error)}; give a running one") from None
        try:
            _require_workers(client, address)
            yield client.get_executor(pure=False)
        except UserError:
            raise
        except Exception as error:
            if client.status == "running" and not isinstance(error, CancelledError):
                raise
            raise UserError(f"scheduler {address}: lost; start it again, and give the same command again") from None
        finally:
            client.close()


def _require_workers(client: Client, address: str) -> None:
    """Refuse a cluster that has no workers, or workers of other versions."""
    try:
        client.wait_for_workers(1, timeout=WORKERS)
    except TimeoutError:
        raise UserError(f"scheduler {address}: has no workers; start one: dask worker {address}") from None
    try:
        found = cast("dict[str, dict[str, str]]", client.run(versions))
    except Exception as error:
        if client.status != "running":
            raise
        what = f"its workers cannot run slamgauge ({_first_line(error)})"
        raise UserError(f"scheduler {address}: {what}; install slamgauge {__version__} there") from None
    own = versions()
    for worker, theirs in found.items():
        for name in own:
            if theirs.get(name) != own[name]:
                what = f"worker {worker} has {name} {theirs.get(name)}, and this is {own[name]}"
                raise UserError(f"scheduler {address}: {what}; install the same on both sides")


def versions() -> dict[str, str]:
    """Return the versions that must be the same here and on the workers."""
    python = ".".join(platform.python_version_tuple()[:2])
    return {"slamgauge": __version__, "Python": python} | {name: version(name) for name in ("distributed", "numpy")}


@contextmanager
def _quiet() -> Generator[None]:
    """Silence the log of distributed about broken connections, which are also raised as errors."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]
    levels = {name: logging.getLogger(name).level for name in names}  # some loggers have their own level
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="distributed")  # about versions, which are checked here
            yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _first_line(error: BaseException) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
