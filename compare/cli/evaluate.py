"""Estimators on a stored recording: `slamgauge evaluate`."""

from __future__ import annotations

import math
from pathlib import Path

from slamgauge.compare.cli.options.run import Evaluate, StoredOptions
from slamgauge.compare.cli.options.shared import flattened, split_names
from slamgauge.compare.cli.scoring import Data, FilterSettings, Source, score
from slamgauge.compare.cli.steps import isolated, write_page
from slamgauge.compare.estimators.requests import ask
from slamgauge.compare.estimators.running import require_room_for_estimates
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.compare.scenarios.scenario import stored_association
from slamgauge.compare.scenarios.schema import INITIALISATIONS
from slamgauge.compare.scoring.own_stamps import aligned, frame_doubt, in_world_frame
from slamgauge.compare.storage.files import load_recording, load_truth
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.ekf.setting_rules import fitted
from slamgauge.ekf.settings import Robustness
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.truth import Truth

MOST_TWINS = 10_000


def run(command: Evaluate) -> int:
    """Run the command; return the exit status."""
    status = _score(command)  # its memory is free again before the page is written
    return status if write_page(command.out, METRICS, command.page) else 1


def _score(command: Evaluate) -> int:
    recording = load_recording(command.recording)
    beside = command.recording.with_name("truth.npz")
    path = command.truth or (beside if beside.exists() else None)
    truth = None if path is None else load_truth(path)
    settings = FilterSettings(
        stored_association(flattened(command.set)),
        fitted(INITIALISATIONS[command.initialisation], command.reach),
        Robustness(command.robust),
    )
    stored = _stored_estimators(_stored(command), recording, truth, command.stored)
    named = isolated(ask(split_names(command.estimators)), command.own_code)
    require_room_for_estimates(recording, named)
    if not 0 <= command.test.twins <= MOST_TWINS:
        raise UserError(f"twins: {command.test.twins} is out of range; give 0 to {MOST_TWINS}")
    asked = ask([*named, *ask(stored)])
    source = Source(twins=command.test.twins)
    return score(Data(truth, recording), asked, settings, command.out, command.output, source)


def _stored(command: Evaluate) -> dict[str, Path]:
    """Return the paths of stored estimates by label."""
    pairs = [text.partition("=") for text in flattened(command.estimates)]
    for label, equals, path in pairs:
        if not label or not equals or not path:
            raise UserError(f"estimates {label + equals + path!r}: write LABEL=PATH, for example mine=mine.csv")
    return {label: Path(path) for label, _, path in pairs}


def _stored_estimators(
    paths: dict[str, Path], recording: Recording, truth: Truth | None, options: StoredOptions
) -> dict[str, Estimator]:
    """Return estimators of the estimates in files by label; one that cannot be read raises the reason when it runs."""

    def unreadable(reason: str) -> Estimator:
        def refuse(_: Recording) -> Estimate:
            raise UserCodeError(reason)

        return refuse

    if not math.isfinite(options.time_offset):
        raise UserError(f"time-offset: {options.time_offset:g} is not a time; give seconds")
    if not options.max_gap > 0.0:
        raise UserError(f"max-gap: {options.max_gap:g} s is not above 0; give seconds > 0")
    if options.align == "se2" and (truth is None or truth.poses is None):
        raise UserError("align: se2 needs true positions; give --truth, or leave this option out")
    found: dict[str, Estimator] = {}
    for label, path in paths.items():
        try:
            stored = load_stored(path, recording, options.time_offset, options.max_gap)
            if options.covariance_frame == "body":
                stored = in_world_frame(stored)
            elif doubt := frame_doubt(label, stored, truth, recording):
                tell_once(doubt)
            found[label] = stored
            if options.align == "se2" and truth is not None:
                found[f"{label}-aligned"] = aligned(f"{label}-aligned", stored, truth, recording)
        except UserError as error:
            found[label] = unreadable(str(error))
    return found
