"""Settings for reading a robot's log, from TOML files and `--set`, validated by pydantic.

docs/your_robot.md has a table of all keys. Every key has a default, except the noise, which the log may contain.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from slamgauge.arrays import Float
from slamgauge.compare.storage.files import Table, override, read_toml
from slamgauge.errors import UserError
from slamgauge.sensors import Sensor
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

LONGEST_KEY, LONGEST_VALUE = 100, 40  # characters in messages

Number = Annotated[float, Field(gt=-LARGEST, lt=LARGEST)]
Sigma = Annotated[float, Field(ge=0.0, lt=LARGEST)]  # standard deviation of a motion or a start, possibly zero
SensorSigma = Annotated[float, Field(gt=0.0, lt=LARGEST)]
Text = Annotated[str, Field(min_length=1)]
Paths = Text | Annotated[list[Text], Field(min_length=1)]  # paths into a message: one, or several
Columns = dict[Text, Text]  # our columns to names in a file
Ids = dict[str, Annotated[int, Field(ge=0)]]  # numbers of landmarks whose ids are texts
Pose = tuple[Number, Number, Number]
Motion = Literal["increments", "velocities", "poses"]
Holds = Literal["until-next", "since-last"]  # how long a velocity is valid
Per = Literal["step", "second", "speed"]  # unit of the noise of motions
Settings = TypeVar("Settings", bound="Section")


class Section(BaseModel):
    """Base of settings: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Noise(Section):
    """Standard deviations [m, rad] of a row of odometry, of a second of it, or of its speeds, and of the sensor."""

    forward: Sigma | None = None
    lateral: Sigma | None = 0.0
    turn: Sigma | None = None
    per: Per = "step"
    range: SensorSigma | None = None
    bearing: SensorSigma | None = None
    position: SensorSigma | None = None

    def growth(self, seconds: Float) -> Float:
        """Return the factors (N,) from the standard deviations of motions to those of steps of seconds (N,)."""
        return seconds ** {"step": 0.0, "second": 0.5, "speed": 1.0}[self.per]


class Start(Section):
    """Pose [m, m, rad] (by default the true one) and standard deviations of the start."""

    pose: Pose | None = None
    sigmas: tuple[Sigma, Sigma, Sigma] = (0.0, 0.0, 0.0)


class FileTable(Section):
    """Units of a file where its header has none, and the names of its columns."""

    time: Literal["s", "ms", "us", "ns"] = "s"
    length: Literal["m", "cm", "mm"] = "m"
    angle: Literal["rad", "deg"] = "rad"
    columns: Columns = {}


class OdometryTable(FileTable):
    """The file of odometry."""

    file: Text = "odometry.csv"
    kind: Motion | None = None
    holds: Holds = "until-next"


class ObservationsTable(FileTable):
    """The file of observations."""

    file: Text = "observations.csv"
    kind: Sensor | None = None
    drop_zero_ranges: bool = False


class TruthTable(FileTable):
    """The files of ground truth. Poses are not interpolated over gaps longer than `max_gap` [s]."""

    file: Text | None = None
    landmarks: Text | None = None
    max_gap: Sigma = 1.0
    landmark_columns: Columns = {}


class FileStart(Start):
    """The start of a log: its time [s] (by default that of the first row of odometry), or a file with a row of it."""

    stamp: float | None = None
    file: Text | None = None


class CsvMapping(Section):
    """All sections for CSV files."""

    odometry: OdometryTable = OdometryTable()
    observations: ObservationsTable = ObservationsTable()
    noise: Noise = Noise()
    start: FileStart = FileStart()
    truth: TruthTable = TruthTable()
    ids: Ids = {}


class BagNoise(Noise):
    """The same standard deviations; those that are not stated are those of the messages."""

    lateral: Sigma | None = None
    per: Per = "speed"


class OdometryTopic(Section):
    """Odometry: increments from twists, or from differences of poses."""

    topic: Text | None = None
    kind: Literal["twist", "poses"] = "twist"
    holds: Holds = "since-last"


class ObservationsTopic(Section):
    """Observations: paths into a message, and from there into an element of `array`, as results.0.pose.position.x.

    Of several paths in `id`, the first is used that leads to a number or a text. Elements whose id does not match
    `pattern` are dropped; its first group is the id.
    """

    topic: Text | None = None
    array: Paths | None = None
    x: Text | None = None
    y: Text | None = None
    z: Text | None = None
    range: Text | None = None
    bearing: Text | None = None
    id: Paths | None = None
    pattern: Text | None = None
    covariance: Text | None = None


class TruthTopic(Section):
    """Poses of the ground truth. They are not interpolated over gaps longer than `max_gap` [s]."""

    topic: Text | None = None
    max_gap: Sigma = 1.0


class Frames(Section):
    """Frame of the robot, by default the child frame of the odometry, else base_link."""

    base: Text | None = None


class BagMapping(Section):
    """All sections for bags; `transforms` are poses of sensor frames in the frame of the robot [m, m, rad]."""

    odometry: OdometryTopic = OdometryTopic()
    observations: ObservationsTopic = ObservationsTopic()
    noise: BagNoise = BagNoise()
    start: Start = Start()
    truth: TruthTopic = TruthTopic()
    frames: Frames = Frames()
    transforms: dict[str, Pose] = {}
    ids: Ids = {}


def load_settings(kind: type[Settings], file: Path | None, overrides: Sequence[str]) -> Settings:
    """Load settings from a TOML file, None for defaults only, and overrides `section.key=value` on top of it.

    Raises:
        UserError: the file cannot be read, or a key or a value in it is wrong.
    """
    table: Table = {} if file is None else read_toml(file)
    for text in overrides:
        override(table, text)
    return validated(kind, table, file or "--set")


def validated(kind: type[Settings], table: Table, file: Path | str) -> Settings:
    """Return the settings of a table of `file`; raise `UserError` as `load_settings`."""
    try:
        return kind.model_validate_json(json.dumps(table, default=str), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    *sections, key = map(str, first["loc"])
    where = f"{file}: {'.'.join([*sections, key])[:LONGEST_KEY]}"
    if first["type"] == "extra_forbidden":
        known: Any = kind.model_fields[sections[0]].annotation if sections else kind
        remedy = did_you_mean(key, known.model_fields)
        raise UserError(f"{where}: unknown {'key' if sections else 'section'}; {remedy}")
    rule = f"{first['msg'][0].lower()}{first['msg'][1:]}"
    raise UserError(f"{where}: {rule}, not {str(first['input'])[:LONGEST_VALUE]!r}; correct it")
