"""A robot's log whose files have separate stamps, its recording and truth, and checks that readers share.

An observation belongs to the moment of its stamp. If that is between two rows of odometry, the step between them is
split there. The robot is assumed to move at constant speed and yaw rate within the step: the parts, composed, are the
whole step, and each has a share of its noise in proportion to its duration.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.log_settings import BagMapping, CsvMapping
from slamgauge.compare.storage.text_lines import Line
from slamgauge.compare.storage.trajectories import SAME, Trajectory, interpolated
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import exp, log, wrap
from slamgauge.sensors import SENSORS, Sensor
from slamgauge.truth import Truth

GAP, MANY_ROWS = 1.0, 10.0  # s, typical times between rows: the shortest gap that a note is printed about
FEW, SHORTEST = 20, 0.01  # observations; share of the odometry's time that they should cover
UNWRAPPED = 0.5  # rad: largest turn in a row whose difference of headings jumps by a whole turn
Id = int | str | None
TrueMap = tuple[Path, Sequence[Id], Float]  # file, ids and places (L, 2) [m] of true landmarks


class Imported(NamedTuple):
    """An imported log.

    Attributes:
        recording: measurements.
        truth: true path and map; None if the log has no truth.
        notes: sentences about dropped content.
        mapping: settings with which CSV files or a bag were read (`log_settings`); None for other files.
    """

    recording: Recording
    truth: Truth | None = None
    notes: tuple[str, ...] = ()
    mapping: dict[str, Any] | None = None


class Odometry(NamedTuple):
    """Stamps (N+1,) [s], strictly increasing, body-frame increments (N, 3) [m, m, rad] and covariances (N, 3, 3).

    `lines` (N,) are the lines of a text that the increments are from, for messages.
    """

    stamps: Float
    increments: Float
    covs: Float
    lines: Sequence[Line] = ()


class Observed(NamedTuple):
    """Observations of one sensor: times (M,) [s], M ids (-1 or None without one), values (M, d), covs (M, d, d)."""

    sensor: Sensor
    times: Float
    ids: Sequence[Id]
    values: Float
    covs: Float


@dataclass(frozen=True, kw_only=True)
class Log:
    """A robot's log.

    Attributes:
        where: file or folder, for messages.
        odometry: increments with stamps.
        seen: observations, sorted by their times.
        has_steps: whether the times of observations are steps of the odometry.
        start: x, y [m] and heading [rad] of the start, if they are stated.
        prior_cov: (3, 3) of the start.
        path: true poses, headings NaN if unknown; not interpolated over gaps longer than `max_gap` [s].
        map: true landmarks.
        notes: sentences about dropped content.
    """

    where: Path
    odometry: Odometry
    seen: Observed
    has_steps: bool = False
    start: Sequence[float] | None = None
    prior_cov: Float = field(default_factory=lambda: np.zeros((3, 3)))
    path: Trajectory | None = None
    max_gap: float = 1.0
    map: TrueMap | None = None
    notes: Sequence[str] = ()

    def imported(self, mapping: CsvMapping | BagMapping | None = None) -> Imported:
        """Return the recording, with steps split at observations, and the truth at its stamps.

        Observations without an id are dropped if others have one. Files that do not fit each other are a UserError.
        """
        seen, notes, count = self.seen, [*self.notes], len(self.seen.ids)
        map_file, true_ids, places = self.map or (self.where, (), None)
        with of_file(self.where):
            numbers, texts = _numbered([*seen.ids, *true_ids], mapping.ids if mapping else {})
        if texts:
            notes.append(f"ids are texts, numbered from {min(texts.values())}: {', '.join(texts)}"[:200])
        landmark = numbers[:count]
        has_ids = bool((landmark >= 0).any())
        kept = np.flatnonzero(landmark >= 0) if has_ids else np.arange(count)
        if len(kept) < count:
            notes.append(f"{count - len(kept)} of {count} observations have no id and are dropped")
        odometry = self.odometry
        steps: Any = seen.times[kept]
        if not self.has_steps:
            self._require_turns()
            with of_file(self.where):
                odometry, steps, inside, more = joined(odometry, steps)
            kept = kept[inside]
            notes += more
        truth, poses, association = None, None, landmark[kept] if has_ids else None
        if self.path:
            if not len(self.path.stamps):
                raise UserError(f"{self.where}: {self.path.where}: has no poses; leave the ground truth out")
            poses = interpolated(self.path.stamps, self.path.poses, odometry.stamps, self.max_gap)
        if self.path or self.map:
            ids = numbers[count:] if self.map else None
            with of_file(map_file):
                truth = Truth(poses=poses, landmark_ids=ids, landmarks=places, association=association)
        with of_file(self.where):
            recording = Recording(
                stamps=odometry.stamps,
                prior_mean=_start_pose(self.start, poses, notes),
                prior_cov=self.prior_cov,
                odometry=odometry.increments,
                odometry_cov=odometry.covs,
                sensor=seen.sensor,
                observation_step=steps,
                observation=seen.values[kept],
                observation_cov=seen.covs[kept],
                landmark=association,
            )
        in_force = mapping.model_copy(update={"ids": texts}).model_dump() if mapping else None
        return Imported(recording, truth, tuple(notes), in_force)

    def _require_turns(self) -> None:
        """Refuse the first increment that turns by more than half a circle: odometry cannot resolve that."""
        turns = self.odometry.increments[:, 2]
        wild = np.abs(turns) > np.pi
        if not wild.any():
            return
        at = int(np.argmax(wild))
        what = f"the robot turns by {turns[at]:.3g} rad in one row"
        remedy = "check the units of angles and stamps, or write lines in between"
        if (np.abs(np.abs(turns[wild]) - 2.0 * np.pi) < UNWRAPPED).all():
            remedy = "these look like differences of headings from -pi to pi: wrap the differences into (-pi, pi]"
        if self.odometry.lines:
            raise self.odometry.lines[at].refused(what, remedy)
        raise UserError(f"{self.where}: {what}, before stamp {shown_stamp(self.odometry.stamps[at + 1])} s; {remedy}")


def _numbered(ids: Sequence[Id], stated: Mapping[str, int]) -> tuple[Int, dict[str, int]]:
    """Return ids (M,) as numbers, -1 for None, and the numbers of texts.

    Texts of digits are numbers. Another text has the number that is stated. If no number is stated, texts are numbered
    in alphabetical order, after the largest id that is a number.
    """
    ids = [int(each) if isinstance(each, str) and each.isdecimal() else each for each in ids]
    texts = sorted({each for each in ids if isinstance(each, str)})
    largest = max((each for each in ids if isinstance(each, int)), default=-1)
    table = dict(stated) or {text: number for number, text in enumerate(texts, max(largest, -1) + 1)}
    missing = [text for text in texts if text not in table]
    if missing:
        raise UserError(f"the id {missing[0]!r} has no number; add it to [ids], or leave [ids] out")
    numbers = [-1 if each is None else table[each] if isinstance(each, str) else each for each in ids]
    return np.array(numbers, dtype=np.int64), table


def _start_pose(stated: Sequence[float] | None, truth: Float | None, notes: list[str]) -> Float:
    """Return the start pose (3,), as stated, else the first of the true poses (N+1, 3), else the origin."""
    if stated is not None:
        return np.array(stated, dtype=np.float64)
    start = np.zeros(3) if truth is None else truth[0]
    if np.isnan(start[0]):
        raise UserError("start.pose: the ground truth has no pose at the start; state it, or cut the log")
    if np.isnan(start[2]):
        remedy = f"state its own with --set start.pose=[{start[0]:.6g},{start[1]:.6g},HEADING]"
        notes.append(f"the ground truth has no headings: the start has the heading 0; {remedy}")
    return np.nan_to_num(start)


def joined(odometry: Odometry, times: Float) -> tuple[Odometry, Int, Marks, list[str]]:
    """Split odometry at the times (M,) [s] of observations.

    Return the odometry; the step of each observation within its span; which observations (M,) these are; and notes
    about the others, which are dropped, and about a gap of the odometry. It is a UserError if all observations, or more
    than half of many, are outside the span, or if their own span is too short.
    """
    first, last = odometry.stamps[0], odometry.stamps[-1]
    inside = (times >= first - SAME) & (times <= last + SAME)
    outside, many = int(np.sum(~inside)), len(times) > FEW
    too_short = many and np.ptp(times) < SHORTEST * (last - first)
    if too_short or outside > len(times) * (0.5 if many else 0.99):
        begin, end, first, last = map(shown_stamp, (times.min(), times.max(), first, last))
        spans = f"observations from {begin} to {end} s, odometry from {first} to {last} s"
        raise UserError(f"{spans}; give each file the unit of its stamps, and both the same clock")
    share = f", {outside / len(times):.0%}: check units and clocks of the files" if outside > 0.1 * len(times) else ""
    notes = [f"{outside} observations outside the odometry's time are dropped{share}"] if outside else []
    seconds = np.diff(odometry.stamps)
    longest = int(np.argmax(seconds))
    if seconds[longest] >= max(GAP, MANY_ROWS * float(np.median(seconds))):
        where = f"{seconds[longest]:.3g} s from {shown_stamp(odometry.stamps[longest])} s on"
        notes.append(f"the odometry has no row for {where}: constant speeds are assumed there")
    return *split_at(odometry, times[inside]), inside, notes


def shown_stamp(seconds: float) -> str:
    """Return a stamp [s] with all its digits, at most nine behind the point."""
    return np.format_float_positional(seconds, precision=9, trim="-")


def split_at(odometry: Odometry, times: Float) -> tuple[Odometry, Int]:
    """Split odometry at times (M,) within its span; return it and the step (M,) of each time."""
    stamps = odometry.stamps
    new = np.unique(times[np.abs(times - stamps[_nearest(stamps, times)]) > SAME])
    new = new[np.diff(new, prepend=-np.inf) > SAME]
    finer = np.sort(np.concatenate([stamps, new]))
    whole = np.searchsorted(stamps, finer[:-1], side="right") - 1
    share = (np.diff(finer) / np.diff(stamps)[whole])[:, None]
    increments, covs = odometry.increments[whole], odometry.covs[whole]
    parts = np.where(share == 1.0, increments, exp(share * log(increments)))  # whole steps are unchanged
    return Odometry(finer, parts, share[:, None] * covs), _nearest(finer, times)


def _nearest(stamps: Float, times: Float) -> Int:
    """Return the index (M,) of the stamp nearest to each time."""
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    return np.where(times - stamps[after - 1] <= stamps[after] - times, after - 1, after)


@contextmanager
def of_file(path: Path | str) -> Generator[None]:
    """Return a context that adds the path of a file to the text of each UserError."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def with_sigmas(covs: Float, sigmas: Sequence[Float | float | None]) -> Float:
    """Return covariances (n, d, d) with stated standard deviations of d axes; None keeps variance and correlations."""
    covs = covs.copy()
    for axis, sigma in enumerate(sigmas):
        if sigma is not None:
            covs[:, axis, :], covs[:, :, axis] = 0.0, 0.0
            covs[:, axis, axis] = np.square(sigma)
    return covs


def require_sigmas(**sigmas: float) -> None:
    """Refuse standard deviations below 0 and ones that are not finite."""
    for name, sigma in sigmas.items():
        if not 0.0 <= sigma < np.inf:
            raise UserError(f"{name}: {sigma:g} is not a standard deviation; give a number from 0 on")


def require_rows(lines: Sequence[Line], wrong: Marks, what: str, remedy: str, values: Float | None = None) -> None:
    """Refuse the first of the lines (n,) that are marked as wrong; {} in `what` is its value."""
    if wrong.any():
        at = int(np.argmax(wrong))
        raise lines[at].refused(what if values is None else what.format(values[at]), remedy)


def require_order(lines: Sequence[Line], stamps: Float, *, strict: bool) -> None:
    """Refuse the first line whose stamp [s] is before that of the line above, or equal to it if `strict`."""
    seconds = np.diff(stamps, prepend=-np.inf)
    wrong = seconds <= 0.0 if strict else seconds < 0.0
    what = f"stamp {{:.9f}} is {'not after' if strict else 'before'} that of the line above"
    require_rows(lines, wrong, what, f"sort the lines by time{', one for each stamp' if strict else ''}", stamps)


def checked(sensor: str, lines: Sequence[Line], values: Float) -> Float:
    """Return observations (M, d) with wrapped bearings; refuse negative ranges, and bearings beyond a full turn."""
    model = SENSORS[sensor]
    if model.has_range:
        require_rows(lines, values[:, 0] < 0.0, "the range is negative", "remove the line")
    if model.has_bearing:
        what = "the bearing {:.6g} rad is more than a full turn"
        remedy = "correct the unit (in csv: bearing [deg] in the header, or observations.angle), or wrap it"
        require_rows(lines, np.abs(values[:, -1]) > 2.0 * np.pi, what, remedy, values[:, -1])
    return np.where(model.is_angle, wrap(values), values)
