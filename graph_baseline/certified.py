"""A certificate of an optimum: the proven global minimum of a surrogate, and the minimum that it leads to.

The surrogate (`isotropic_surrogate`) has isotropic noise and chordal differences of headings. Its minimum does not
depend on dead reckoning, and a lower bound of all paths and maps proves that it is the global one. A descent on
the exact cost starts there. `batch` starts there, too, if the cost of its first minimum is larger than noise explains.

The lower bound holds for the exact cost, too, if positions are observed. The surrogate's variances are not smaller than
the stated ones, the translation of the SE(2) logarithm is not shorter than the difference of translations, and
2 - 2 cos d <= d^2 for a difference d of headings. The exact cost remains above the bound by what these inequalities
lose, so that this bound is never attained with noise in the headings. It is not a bound with ranges and bearings,
because the position's variance is that at the measured range, and the range of the optimum may be larger.
"""

from __future__ import annotations

from slamgauge.errors import UserError
from slamgauge.estimate import Certificate, Estimate
from slamgauge.graph_baseline.problem.preparation import in_frame_of_start, prepare
from slamgauge.graph_baseline.solver.isotropic_surrogate import (
    lower_bound,
    minimum,
    path_and_map,
    spectral_headings,
    surrogate_of,
)
from slamgauge.graph_baseline.solver.levenberg_marquardt import damped_descent, gauss_newton_minimum
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS


def require_certifiable(recording: Recording) -> None:
    """Check that the sensor places landmarks, and that at least one is observed.

    Raises:
        UserError: it does not, or nothing is observed.
    """
    if not SENSORS[recording.sensor].places_landmarks:
        raise UserError("certify: does not apply to bearing-only recordings; give ranges or positions")
    if not len(recording.observation):
        raise UserError("certify: nothing is observed, so that dead reckoning is the optimum")


def certificate(recording: Recording, optimum: Estimate) -> Certificate:
    """Return the certificate of an optimum of `batch`.

    Args:
        recording: measurements.
        optimum: its association selects the observations.

    Raises:
        UserError: the recording is bearing-only, nothing is observed, the estimate is not an optimum, or the descent
            from the certified start finds no minimum.
    """
    require_certifiable(recording)
    if optimum.chi_square is None or optimum.association is None:
        raise UserError("certify: the estimate is not an optimum; give one of batch")
    problem = prepare(in_frame_of_start(recording.associated(optimum.association)))
    surrogate = surrogate_of(problem)
    x = minimum(surrogate, spectral_headings(surrogate))
    reached = gauss_newton_minimum(problem, damped_descent(problem, *path_and_map(problem, x)))
    return Certificate(
        surrogate_cost=surrogate.cost(x),
        lower_bound=lower_bound(surrogate, x),
        reached_cost=reached.cost,
        optimum_cost=optimum.chi_square / 2.0,
        bounds_optimum=not SENSORS[problem.sensor].has_bearing,
    )
