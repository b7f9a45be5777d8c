"""The Octave course's functions as an estimator: prediction_step.m and correction_step.m in this folder.

    slamgauge evaluate first-run/recording.npz --estimators ekf,mine=examples/octave/octave.py:estimate

Copy this folder and replace the two .m files by yours. `octave-cli` is in Debian's package octave.
"""

from pathlib import Path

from slamgauge import adapters

DRIVER = Path(__file__).with_name("driver.m")
OPTIONS = ("--no-gui", "--norc", "--no-history", "--quiet")

estimate = adapters.external(["octave-cli", *OPTIONS, str(DRIVER), "{recording}", "{estimate}"], timeout=120.0)
