"""Properties of a user filter: `slamgauge check`."""

from __future__ import annotations

from slamgauge.compare.checks.examination import check_estimator, verdicts_json, verdicts_table
from slamgauge.compare.cli.options.user_filters import Check
from slamgauge.compare.cli.steps import require_timeout
from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.requests import Limits, ask, with_limits
from slamgauge.errors import UserError


def run(command: Check) -> int:
    """Run the command; return the exit status."""
    if command.seed < 0:
        raise UserError(f"seed {command.seed}: a seed must not be negative; give one >= 0")
    (asked,) = with_limits(ask([command.estimator]), Limits(require_timeout(command.timeout)))
    verdicts = check_estimator(asked.label, load(asked), command.seed)
    command.output.show(verdicts_json(verdicts), verdicts_table(verdicts))
    return 0 if not any(verdict.is_failure for verdict in verdicts) else 1
