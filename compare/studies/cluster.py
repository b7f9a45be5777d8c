"""A Dask cluster as what carries runs: it is asked, before work begins, whether it can, and said in one line if not.

Whoever reaches a scheduler can run code on its workers and on whoever hands work to it: its messages are pickles. Give
only addresses that nobody else reaches, or that are `tls://`.
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
from typing import TYPE_CHECKING, Any, cast

from slamgauge.errors import UserError
from slamgauge.version import __version__

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 10.0  # s to wait for a scheduler, and
WORKERS = 5.0  # s for its first worker
TLS = "DASK_DISTRIBUTED__COMM__TLS_"


@contextmanager
def dask_cluster(address: str) -> Generator[Executor]:
    """The workers of a running Dask cluster, which must have this version of slamgauge installed.

    Raises:
        UserError: the extra `cluster` is not installed, `address` is none or needs certificates, no scheduler answers
            there, it has no workers, they are of another version, or the scheduler is lost.
    """
    try:
        from distributed import Client, Security
    except ImportError:
        raise UserError("scheduler: needs the extra 'cluster'; pip install 'slamgauge[cluster]'") from None
    if not re.fullmatch(r"(tcp|tls)://\S+:\d+", address):
        raise UserError(f"scheduler {address!r} is no address; give tcp://host:port or tls://host:port")
    if address.startswith("tls") and not Security().get_connection_args("client").get("ssl_context"):
        remedy = f"name them in the environment: {TLS}_CA_FILE, {TLS}_CLIENT__CERT, {TLS}_CLIENT__KEY"
        raise UserError(f"scheduler {address}: tls needs certificates; {remedy}")
    with _quiet():
        try:
            client = Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TypeError, RuntimeError) as error:  # TimeoutError is an OSError
            raise UserError(f"scheduler {address}: {_first_line(error)}; give that of one that runs") from None
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
    """What workers must have in common with whoever hands work to them."""
    python = ".".join(platform.python_version_tuple()[:2])
    return {"slamgauge": __version__, "Python": python} | {name: version(name) for name in ("distributed", "numpy")}


@contextmanager
def _quiet() -> Generator[None]:
    """Keep to ourselves what distributed logs of connections that break; it is raised as well."""
    # some have levels of their own, which those above them do not change
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]
    loggers: list[tuple[Any, int]] = [(each, each.level) for each in map(logging.getLogger, names)]
    for logger, _ in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="distributed")  # mismatched versions are refused
            yield
    finally:
        for logger, level in loggers:
            logger.setLevel(level)


def _first_line(error: BaseException) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
