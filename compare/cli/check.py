"""`slamgauge check`."""

from __future__ import annotations

from dataclasses import dataclass, field

import tyro

from slamgauge.compare.cli.options import print_result, require_timeout
from slamgauge.compare.cli.terminal import Output
from slamgauge.errors import UserError


@dataclass
class Check:
    """Hold one estimator to laws that every filter must obey; each names the part that is to blame.

    Exit status 1 if a law fails. What the textbook method itself cannot keep is told as a limit, which is no failure.

    For example:
      slamgauge check my_filter.py:estimate
    """

    estimator: tyro.conf.Positional[str]
    """One of ours by its name, or your own as [LABEL=]FILE.py:callable or module:callable (Recording -> Estimate).
    LOADS AND RUNS THAT CODE."""

    seed: int = 0
    """Seed of what is drawn in the laws' recordings."""

    timeout: float = 60.0
    """Seconds that your own code, in a process of its own, may take for one of them; a law that it takes longer for
    fails, and the laws after it are not judged."""

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        """Judge and print; the exit status."""
        from slamgauge.compare.checks.examination import check_estimator, verdicts_json, verdicts_table
        from slamgauge.compare.estimators.isolated_process import can_isolate
        from slamgauge.compare.estimators.loading import load
        from slamgauge.compare.estimators.requests import Isolation, ask, isolated

        if self.seed < 0:
            raise UserError(f"seed {self.seed}: no generator takes it; give one >= 0")
        isolation = Isolation(require_timeout(self.timeout), strict=False)  # no-future is a law
        (asked,) = isolated(ask([self.estimator]), isolation if can_isolate() else None)
        verdicts = check_estimator(asked.label, load(asked), self.seed)
        printed = print_result(verdicts_json(verdicts) if self.output.json else verdicts_table(verdicts))
        return 0 if printed and not any(verdict.is_failure for verdict in verdicts) else 1
