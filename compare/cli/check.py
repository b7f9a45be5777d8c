"""Properties of a user filter: `slamgauge check`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import tyro

from slamgauge.compare.checks import examination
from slamgauge.compare.cli.common import require_timeout
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators import loading, requests
from slamgauge.errors import UserError


@dataclass
class Command:
    """Test an estimator with checks that every right filter passes. A failed check names the part that is wrong.

    Exit status 1 if a check fails. A limit of the textbook method is reported, but does not count as a failure.

    For example:
      slamgauge check my_filter.py:estimate

    Attributes:
        estimator: A built-in name, or your own: [LABEL=]FILE.py or [LABEL=]FILE.py:callable. THIS LOADS AND RUNS THAT
            CODE.
        seed: Seed of the random recordings of the checks.
        timeout: Seconds that a check of your own code may take. If it takes longer, it fails and the others are not
            run.
    """

    estimator: tyro.conf.Positional[str]
    seed: int = 0
    timeout: float = 60.0
    output: Output = field(default_factory=Output)

    def run(self) -> int:
        if self.seed < 0:
            raise UserError(f"seed {self.seed}: a seed must not be negative; give one >= 0")
        limits = requests.Limits(require_timeout(self.timeout))
        (asked,) = requests.with_limits(requests.ask([self.estimator]), limits)
        verdicts = examination.check_estimator(asked.label, loading.load(asked), self.seed)
        self.output.show([asdict(each) for each in verdicts], examination.verdicts_table(verdicts))
        return 1 if any(verdict.is_failure for verdict in verdicts) else 0
