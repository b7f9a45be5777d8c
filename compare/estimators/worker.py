"""Work of a process with user code: load the code as `python FILE.py` would, adapt it, and run it on recordings.

    python -P -m slamgauge.compare.estimators.worker [walled]

Requests come on standard input and answers leave on standard output, which the code does not see; what it prints goes
to standard error. The first request is the address, each other one a recording. The module is loaded again for every
run; behind a wall every run is a fork of this process.
"""

from __future__ import annotations

import importlib
import os
import shutil
import signal
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from time import perf_counter, sleep
from types import ModuleType
from typing import IO, Any, cast

import numpy as np

from slamgauge.compare.estimators.adapters import adapted, callable_of
from slamgauge.compare.estimators.answers import message, read_request
from slamgauge.compare.estimators.forms.signatures import Form
from slamgauge.compare.estimators.forms.step_function import StepFunction
from slamgauge.compare.estimators.sandbox import CACHES, HOME, LIMITS, WRITABLE
from slamgauge.compare.estimators.user_errors import FormError, UserCodeError, reason_of
from slamgauge.errors import CovarianceError, UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording
from slamgauge.suggestions import did_you_mean

WALLED = "walled"
ANSWERED = 77  # status of a fork that has answered
ALIVE = 1.0  # s between looks whether slamgauge still runs
OLD_NAMES = {each.__name__: each for each in (float, int, bool, object, complex, str)}
OLD_NAMES |= {"Inf": np.inf, "Infinity": np.inf, "PINF": np.inf, "NINF": -np.inf, "NaN": np.nan, "NAN": np.nan}
OLD_NAMES |= {"float_": np.float64, "complex_": np.complex128}
OLD_NAMES |= {"product": np.prod, "row_stack": np.vstack, "mat": np.asmatrix}


class Code:
    """User code at the address of a first request (`child`); `most` ends the errors of a lack of memory."""

    def __init__(self, where: Mapping[str, Any], most: str) -> None:
        self._where, self._most = where, most
        self._files = {str(Path(where["folder"], path)) for path in where["files"]}
        self._attribute: str = where["attribute"]
        self._loaded: Estimator | None = None

    def load(self) -> Mapping[str, object]:
        """Load the module and adapt its callable; return its name and its form in words, or why that failed."""
        try:
            self._loaded = self._adapted()
        except UserError as error:
            return _failure(error, str(error))
        return {"attribute": self._attribute, "form": getattr(self._loaded, "words", "")}

    def _adapted(self) -> Estimator:
        try:
            module = self._module()
        except (Exception, SystemExit) as error:
            missing = error.name or "" if isinstance(error, ModuleNotFoundError) else ""
            if missing and f"{self._where['module']}.".startswith(f"{missing}."):  # not one that the module imports
                remedy = "run in its folder or install it, or give its file"
                raise UserError(f"no module {missing!r} is found; {remedy}") from None
            raise UserError(f"cannot be loaded, {reason_of(error, self._where['folder'])}") from error
        self._attribute = self._attribute or callable_of(module)
        if not hasattr(module, self._attribute):
            remedy = did_you_mean(self._attribute, vars(module), "name a callable Recording -> Estimate of that module")
            raise UserError(f"{self._where['place']} has no {self._attribute!r}; {remedy}")
        given = getattr(module, self._attribute)
        if not callable(given):
            raise UserError(f"is a {type(given).__name__}; give a callable Recording -> Estimate")
        return adapted(given)

    def _module(self) -> ModuleType:
        """Import the module; a file whose name an imported module has is loaded under another."""
        for name, module in [*sys.modules.items()]:
            if getattr(module, "__file__", None) in self._files:
                del sys.modules[name]
        name, file = self._where["module"], str(Path(self._where["folder"], f"{self._where['module']}.py"))
        if file not in self._files:
            return importlib.import_module(name)
        spec = spec_from_file_location(f"_{name}" if name in sys.modules else name, file)
        assert spec is not None and spec.loader is not None
        module = sys.modules[spec.name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def run(self, recording: Recording, noise: str) -> tuple[Mapping[str, object], Estimate | None]:
        """Return times and remarks of a run, and its estimate; or why it has no estimate."""
        try:
            estimator, self._loaded = self._loaded or self._adapted(), None
            if noise == "file":
                if not isinstance(estimator, StepFunction):
                    raise UserCodeError("its form has no noise to choose; leave out --noise")  # noqa: TRY301
                estimator.noise = noise
            start = perf_counter()
            estimate = cast("object", estimator(recording))
            seconds = perf_counter() - start
        except (Exception, SystemExit) as error:  # noqa: BLE001 user code may raise anything
            most = self._most if isinstance(error, MemoryError) else ""
            return _failure(error, f"{reason_of(error, self._where['folder'])}{most}"), None
        if not isinstance(estimate, Estimate):
            return {"reason": f"returned a {type(estimate).__name__}; return a slamgauge.Estimate"}, None
        form = estimator if isinstance(estimator, Form) else Form()
        return {"seconds": seconds, "remarks": [*form.remarks], "replaces_noise": form.replaces_noise}, estimate


def _failure(error: BaseException, reason: str) -> Mapping[str, object]:
    """Return the fields of an answer without a result."""
    if isinstance(error, FormError):
        return {"refusal": reason.splitlines()}
    return {"reason": reason, "is_wrong_covariance": isinstance(error, CovarianceError)}


def _answer(out: IO[bytes], fields: Mapping[str, object], estimate: Estimate | None = None) -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # user code may have closed it
            stream.flush()
    out.write(message(fields, estimate))
    out.flush()


def _end_with_parent(parent: int) -> None:
    """End this process when slamgauge has ended without ending it."""
    while os.getppid() == parent:
        sleep(ALIVE)
    os._exit(1)


def _limit() -> None:
    """Limit what this process and those that it starts may take."""
    import resource  # not on Windows

    for name, most in LIMITS.items():
        what = getattr(resource, f"RLIMIT_{name}")
        least = min(each for each in (*resource.getrlimit(what), most) if each != resource.RLIM_INFINITY)
        resource.setrlimit(what, (least, least))


def _found() -> set[Path]:
    """Return the contents of the writable folders; before any run these are libraries that are installed there."""
    return {each for folder in WRITABLE for each in Path(folder).iterdir()}


def _clear(kept: set[Path]) -> None:
    """End the processes and remove the files that a run has left, not those `kept`; the caches begin again."""
    with suppress(ProcessLookupError, PermissionError):  # no process is left, or only the wall's own
        while True:  # until they have ended
            os.kill(-1, signal.SIGKILL)  # all but this one and the wall's own
            sleep(0.001)
    for each in _found() - kept:
        each.unlink() if each.is_symlink() or not each.is_dir() else shutil.rmtree(each)
    if Path(CACHES).is_dir():
        shutil.copytree(CACHES, f"{HOME}/.cache", copy_function=os.symlink)


def main() -> None:
    """Answer the requests of a slamgauge process until their pipe ends; the code does not see both pipes."""
    walled = sys.argv[1:] == [WALLED]
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    libraries = _found() if walled else set()
    if walled:
        _limit()
        _clear(libraries)
    else:
        threading.Thread(target=_end_with_parent, args=[os.getppid()], daemon=True).start()
    for name, value in OLD_NAMES.items():
        if name not in vars(np):
            setattr(np, name, value)
    _answer(answers, {})
    code: Code | None = None
    while (request := read_request(requests)) is not None:
        fields, recording = request
        if code is None or recording is None:
            sys.argv, sys.dont_write_bytecode = [fields["place"]], True
            sys.path.insert(0, fields["folder"])
            code = Code(fields, "; its process may take 4 GB" if walled else "")
            _answer(answers, code.load())
        elif not walled:
            _answer(answers, *code.run(recording, fields["noise"]))
        elif pid := os.fork():
            status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
            _clear(libraries)
            if status != ANSWERED:
                how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
                _answer(answers, {"reason": f"its process {how}{' before the run was done' if status >= 0 else ''}"})
        else:
            _answer(answers, *code.run(recording, fields["noise"]))
            os._exit(ANSWERED)


if __name__ == "__main__":
    main()
