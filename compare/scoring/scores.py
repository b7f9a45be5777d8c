"""Score of an estimate: every figure of metrics.json, relative to the truth and to the optimum."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.catalogue import CATALOGUE, SCORED, measured
from slamgauge.compare.scoring.consistency import log_scores, sigma_ratios, squared_mahalanobis
from slamgauge.compare.scoring.intervals import ROUNDING
from slamgauge.compare.scoring.landmark_identity import association_figures, landmark_errors, true_landmarks
from slamgauge.compare.scoring.loop_closures import LoopClosure, closure_steps, describe_closures
from slamgauge.compare.scoring.nan_stats import mean, number, rms
from slamgauge.compare.scoring.ray_figures import RayFigures, ray_figures
from slamgauge.compare.scoring.trajectory_error import aligned_errors, distances, pose_errors, step_errors
from slamgauge.compare.scoring.verdicts import Evidence, verdict
from slamgauge.display import data_frame, html_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Kind
from slamgauge.recording import Recording
from slamgauge.truth import Truth
from slamgauge.validation import require_type


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Score:
    """Figures of an estimate. A figure that does not apply is None.

    Attributes:
        kind: "filtered" (compared with `causal`) or "smoothed" (compared with `batch`).
        ate_m: RMS position error over the poses with truth, without alignment [m].
        ate_aligned_m: RMS position error after the best rigid motion of the plane [m].
        heading_rmse_rad: RMS heading error [rad].
        final_position_error_m: Position error of the last pose [m].
        final_heading_error_rad: Absolute heading error of the last pose [rad].
        rpe_m: RMS translation error of single steps, in the body frame [m].
        nees_pose: Mean over time of the pose NEES: about 3 if the covariance is right.
        nis_per_dof: NIS over its degrees of freedom: about 1 if the assumed noise is right.
        landmark_rmse_m: RMS distance of the mapped landmarks from the true ones, at the end [m].
        landmark_nees_per_dof: Mean NEES of the mapped landmarks over its 2 degrees of freedom.
        landmarks_mapped: Number of landmarks in the map.
        landmarks_true: Number of distinct landmarks that were observed.
        landmarks_missed: Number of observed landmarks without a counterpart in the map.
        landmarks_spurious: Number of mapped landmarks without a true counterpart, duplicates included.
        wrong_associations: Number of observations assigned to another landmark than their own.
        observations_rejected: Number of observations assigned to no landmark.
        track_purity: Mean over tracks of the largest share of their observations from one landmark.
        track_purity_min: Smallest such share of a track.
        rays: Result of the rays of a bearing-only estimate.
        ratio_to_optimum: ATE over that of the optimum of the same kind.
        sigma_ratio_to_optimum: Mean over time of sigma over the optimum's, for x, y and heading.
        mahalanobis_to_optimum: Mean over time of the squared Mahalanobis distance to the optimum, under its covariance.
        log_score_to_optimum: Log score minus that of the optimum of the same kind [nats]: more is worse.
        yardstick_check_sigma: Check of the optimum with which the estimate is compared, in its sigmas.
        verdict: Conclusions from the figures, in words.
        final_distance_to_batch_m: Distance of the last position from that of `batch` [m].
        landmark_distance_to_batch_m: RMS distance of the landmarks from those of `batch` [m].
        loop_closure: One entry per loop closure.
        seconds_total: Computing time [s].
        seconds_per_step_median: Median over the steps of the computing time [s].
        nees: (N+1,) pose NEES of each step, NaN where undefined.
        sigmas: (N+1, 3) standard deviations of x, y [m] and heading [rad], NaN where undefined.
        nis_total: Sum of the NIS of all steps.
        nis_dof_total: Degrees of freedom of `nis_total`.
        others: Figures of the catalogue without an attribute here, by key.
    """

    kind: Kind
    ate_m: float | None
    ate_aligned_m: float | None
    heading_rmse_rad: float | None
    final_position_error_m: float | None
    final_heading_error_rad: float | None
    rpe_m: float | None
    nees_pose: float | None
    nis_per_dof: float | None
    landmark_rmse_m: float | None
    landmark_nees_per_dof: float | None
    landmarks_mapped: int
    landmarks_true: int | None
    landmarks_missed: int | None
    landmarks_spurious: int | None
    wrong_associations: int | None
    observations_rejected: int | None
    track_purity: float | None
    track_purity_min: float | None
    rays: RayFigures | None
    ratio_to_optimum: float | None = None
    sigma_ratio_to_optimum: tuple[float | None, ...] | None = None
    mahalanobis_to_optimum: float | None = None
    log_score_to_optimum: float | None = None
    yardstick_check_sigma: float | None = None
    verdict: str | None
    final_distance_to_batch_m: float | None
    landmark_distance_to_batch_m: float | None
    loop_closure: tuple[LoopClosure, ...] | None
    seconds_total: float | None
    seconds_per_step_median: float | None
    nees: Float
    sigmas: Float
    nis_total: float
    nis_dof_total: int
    others: dict[str, Any] = field(default_factory=dict)

    def figure(self, key: str) -> Any:
        """Return the figure with a key of the catalogue."""
        return self.others[key] if key in self.others else getattr(self, key)

    def __repr__(self) -> str:
        known = {"ATE": (self.ate_m, " m"), "NEES": (self.nees_pose, ""), "NIS/dof": (self.nis_per_dof, "")}
        parts = [f"{title} {value:.3g}{unit}" for title, (value, unit) in known.items() if value is not None]
        return f"Score({', '.join([self.kind, *parts])})"

    def _repr_html_(self) -> str:
        helps = {each.key: each.help for each in CATALOGUE}
        rows = [(key, f"{value:.4g}", helps.get(key, "")) for key, value in self.figures().items() if value is not None]
        return html_table((f"{self.kind} estimate", "", ""), rows)

    def figures(self) -> dict[str, float | None]:
        """Return the entries of metrics.json that are numbers."""
        entry = {key: value for key, value in self.to_json().items() if key != "kind"}
        return {key: value for key, value in entry.items() if value is None or isinstance(value, int | float)}

    def to_frame(self) -> Any:
        """Return the figures as a `pandas.DataFrame` with a row for each."""
        figures = self.figures()
        return data_frame({"value": [*figures.values()]}, [*figures])

    def to_json(self) -> dict[str, Any]:
        """Return the entry in metrics.json: plain numbers, lists and None; `rays` only if the estimate has any.

        JSON has no infinity: an infinite check becomes the largest double.
        """
        keys = [each.name for each in fields(self) if each.name == "kind" or each.name in SCORED]
        entry: dict[str, Any] = {key: getattr(self, key) for key in keys}
        entry |= self.others
        entry = {key: sys.float_info.max if value == math.inf else value for key, value in entry.items()}
        if self.sigma_ratio_to_optimum is not None:
            entry["sigma_ratio_to_optimum"] = list(self.sigma_ratio_to_optimum)
        if self.rays is None:
            del entry["rays"]
        else:
            entry["rays"] = self.rays._asdict()
        if self.loop_closure is not None:
            entry["loop_closure"] = [closure._asdict() for closure in self.loop_closure]
        return entry


def evaluate(
    truth: Truth | None,
    recording: Recording,
    estimate: Estimate,
    optimum: Estimate | None = None,
    batch: Estimate | None = None,
) -> Score:
    """Score an estimate against the truth, the optimum of the same kind and the hindsight optimum.

    Args:
        truth: the known part of the truth; None on real data without ground truth.
        recording: input of the estimator.
        estimate: output of the estimator.
        optimum: estimate of `causal` if `estimate` is filtered, of `batch` if it is smoothed.
        batch: the hindsight optimum, for the distances of the last pose and of the map.

    Raises:
        UserError: lengths do not fit the recording, or the optimum is of another kind.
    """
    truth = Truth() if truth is None else truth
    require_type("truth", truth, Truth)
    require_type("recording", recording, Recording)
    require_type("estimate", estimate, Estimate)
    _check(truth, recording, estimate, optimum, batch)
    figures = _path_figures(truth, recording, estimate)
    figures |= map_figures(truth, recording, estimate, batch)
    figures |= _optimum_figures(truth, estimate, optimum)
    figures |= filter_figures(estimate)
    others = measured(truth, recording, estimate)
    nees = figures["nees_pose"]
    evidence = Evidence(
        runs=1,
        nees_per_dof=None if nees is None else nees / 3,
        coverage_95=others["coverage_95"],
        nis_per_dof=figures["nis_per_dof"],
        nis_dof=figures["nis_dof_total"],
        wrong_associations=figures["wrong_associations"],
    )
    return Score(kind=estimate.kind, **figures, verdict=verdict(evidence), others=others)


def _path_figures(truth: Truth, recording: Recording, estimate: Estimate) -> dict[str, Any]:
    poses, reference, covs = estimate.poses, _true_poses(truth, estimate), pose_covs_of(estimate)
    aligned = rms(
        np.linalg.norm(aligned_errors(poses[:, :2], reference[:, :2]), axis=1)
    )  # first, because it needs the most memory
    errors = pose_errors(reference, poses)
    off = distances(errors)
    nees = squared_mahalanobis(errors, covs)
    closures = closure_steps(truth, recording)
    sigmas = np.sqrt((covs[:, 0, 0] + covs[:, 1, 1]).clip(min=0))
    return {
        "ate_m": rms(off),
        "ate_aligned_m": aligned,
        "heading_rmse_rad": rms(errors[:, 2]),
        "final_position_error_m": number(off[-1]),
        "final_heading_error_rad": number(abs(errors[-1, 2])),
        "rpe_m": rms(step_errors(reference, poses)),
        "nees": nees,
        "sigmas": np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(min=0)),
        "nees_pose": mean(nees),
        "loop_closure": None if closures is None else describe_closures(closures, off, sigmas),
    }


def map_figures(truth: Truth, recording: Recording, estimate: Estimate, batch: Estimate | None) -> dict[str, Any]:
    """Return the figures of the map and of the associations."""
    ids, landmarks = true_landmarks(truth, recording, estimate)
    errors = landmark_errors(ids, landmarks, truth.landmark_ids, truth.landmarks)
    covs = estimate.landmark_covs
    nees = None if covs is None else mean(squared_mahalanobis(errors, covs))
    final_distance, map_distance = None, None
    if batch is not None:
        final_distance = number(math.dist(estimate.poses[-1, :2], batch.poses[-1, :2]))
        differences = landmark_errors(ids, landmarks, *true_landmarks(truth, recording, batch))
        map_distance = rms(np.linalg.norm(differences, axis=1))
    return {
        "landmark_rmse_m": rms(np.linalg.norm(errors, axis=1)),
        "landmark_nees_per_dof": None if nees is None else nees / 2,
        "landmarks_mapped": len(ids),
        **association_figures(truth, recording, estimate)._asdict(),
        "final_distance_to_batch_m": final_distance,
        "landmark_distance_to_batch_m": map_distance,
        "rays": ray_figures(truth, recording, estimate),
    }


def _optimum_figures(truth: Truth, estimate: Estimate, optimum: Estimate | None) -> dict[str, Any]:
    if optimum is None:
        return {}
    reference = _true_poses(truth, estimate)
    ate, optimal = (rms(distances(pose_errors(reference, path.poses))) for path in (estimate, optimum))
    covs, optimum_covs = pose_covs_of(estimate), pose_covs_of(optimum)
    score, best = (log_scores(pose_errors(reference, each.poses), pose_covs_of(each)) for each in (estimate, optimum))
    ratios = tuple(mean(column) for column in sigma_ratios(covs, optimum_covs).T)
    return {
        "ratio_to_optimum": ate / optimal if ate is not None and optimal is not None and optimal > ROUNDING else None,
        "sigma_ratio_to_optimum": None if ratios == (None, None, None) else ratios,
        "mahalanobis_to_optimum": mean(squared_mahalanobis(pose_errors(optimum.poses, estimate.poses), optimum_covs)),
        "log_score_to_optimum": mean(score - best),
        "yardstick_check_sigma": optimum.optimum_check,
    }


def filter_figures(estimate: Estimate) -> dict[str, Any]:
    """Return the figures of the innovations and of computing time."""
    nis = 0.0 if estimate.nis is None else float(estimate.nis.sum())
    dof = 0 if estimate.nis_dof is None else int(estimate.nis_dof.sum())
    seconds = estimate.seconds
    return {
        "nis_total": nis,
        "nis_dof_total": dof,
        "nis_per_dof": nis / dof if dof > 0 else None,
        "seconds_total": None if seconds is None else float(seconds.sum()),
        "seconds_per_step_median": None if seconds is None else float(np.median(seconds)),
    }


def _true_poses(truth: Truth, estimate: Estimate) -> Float:
    """Return the true poses (N+1, 3), all NaN without truth, so that all figures from them are undefined."""
    return np.full(estimate.poses.shape, np.nan) if truth.poses is None else truth.poses


def pose_covs_of(estimate: Estimate) -> Float:
    """Return the pose covariances (N+1, 3, 3), all NaN if the estimator returns none."""
    return np.full((len(estimate.poses), 3, 3), np.nan) if estimate.pose_covs is None else estimate.pose_covs


def _check(
    truth: Truth, recording: Recording, estimate: Estimate, optimum: Estimate | None, batch: Estimate | None
) -> None:
    poses, observations = recording.steps + 1, len(recording.observation_step)
    given = {"truth": truth, "estimate": estimate, "optimum": optimum, "batch": batch}
    for name, each in given.items():
        if each is not None and each.poses is not None and len(each.poses) != poses:
            raise UserError(f"{name}.poses: {len(each.poses)} rows for {poses} stamps; give one pose per stamp")
        if each is not None and each.association is not None and len(each.association) != observations:
            raise UserError(
                f"{name}.association: {len(each.association)} entries for {observations} observations; "
                "give one per observation"
            )
    if optimum is not None and optimum.kind != estimate.kind:
        raise UserError(
            f"optimum.kind: {optimum.kind!r} is not comparable with {estimate.kind!r}; "
            "compare a filtered estimate with causal, a smoothed one with batch"
        )
    if batch is not None and batch.kind != "smoothed":
        raise UserError(f"batch.kind: {batch.kind!r} is not the hindsight optimum; give batch's smoothed estimate")
