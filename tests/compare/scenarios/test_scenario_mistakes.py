"""Messages about mistakes in scenario files and overrides: a line for each, with its place and a remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from slamgauge.compare.scenarios.scenario import load_scenario, shipped_scenarios
from slamgauge.errors import UserError

from .conftest import GOOD, Write, mistakes


def test_four_planted_mistakes_are_reported_together(write: Write):
    text = GOOD.replace("step = 0.1", "step = -0.1").replace("max_range = 5", 'max_range = "5"')
    text = text.replace("duration = 1.04", "duraton = 1.04").replace("[[1, 2]", "[[1, nan]")
    assert mistakes(write(text)) == [
        "trajectory.step: input should be greater than 0, not -0.1",
        "trajectory.segments[1].duraton: unknown key; did you mean duration?",
        "sensor.max_range: input should be a valid number, not '5'",
        "landmarks.positions[0][1]: input should be a finite number, not nan",
    ]


@pytest.mark.parametrize(
    ("old", "new", "mistake"),
    [
        ("sigma_position = 0.2", "", "sensor.sigma_position: missing; a position sensor needs it"),
        ("max_range", "sigma_range = 1\nmax_range", "sensor.sigma_range: a position sensor has none; remove it or"),
        ('"position"', '"radar"', "sensor.kind: input should be 'range-bearing', 'bearing' or 'position', not 'radar'"),
        ("max_range", "min_range = 6\nmax_range", "sensor.min_range: must not exceed max_range"),
        ("step = 0.1", "step = 0.1\nspeed = 1.0", "trajectory: has both forms; give segments, or speed, yaw_rate"),
        ("step = 0.1", "step = 1e-9", "trajectory: duration / step comes to more than 1000000 steps"),
        ("[motion]", "[motions]", "motions: unknown key; did you mean motion?"),
        ("description", "name = 'x'\ndescription", "name: unknown key; the file's own name is the scenario's name"),
        ("sigma_speed = 0.1", "sigma_speed = true", "motion.sigma_speed: input should be a valid number, not True"),
        ("[motion]", "[prior]\nmean = [0, 0, 0, 0]\n[motion]", "prior.mean: tuple should have at most 3 items"),
    ],
)
def test_each_mistake_has_its_line(write: Write, old: str, new: str, mistake: str):
    [line] = mistakes(write(GOOD.replace(old, new)))
    assert line.startswith(mistake)


TOO_MANY = "members from s_min to s_max; choose it larger, for 1000 members at most"
OVERRIDES = {  # by scenario: override, and its line, or the begin of a long one
    "q1-short-dense": {
        "trajectory={kind='spiral', step=1}": "trajectory: kind is not known; use one of segments, waypoints, ",
        "trajectory.radius=3": "trajectory.radius: a trajectory of the kind segments has none; remove it or change",
        "trajectory={kind='waypoints', step=1, points=[], speed=1, yaw_rate=1}": "trajectory.points: tuple should",
        "trajectory={kind='csv', file='none.csv'}": "trajectory.file: none.csv: cannot be read (No such file",
        "trajectory.speed=1e60": "trajectory.speed: must be at most 1e+50 in size, not 1e+60",
        "trajectory.sped=2": "trajectory.sped: unknown key; did you mean speed?",
        f"sensor.{'a' * 5000}=1": f"sensor.{'a' * 80}",
        f"sensor.max_range={'1' * 5000}": "sensor.max_range: input should be a valid number, not '1111",
        "prior.covariance=[[1,0,0],[0,-1,0],[0,0,1]]": "prior.covariance: covariance[0] = ",
        "landmarks={positions=[[1, 2]], random={count=3, box=[0,0,1,1]}}": "landmarks: has both forms; give positions",
        "landmarks={}": "landmarks: has no landmarks; give positions ([] for none), or random",
        "landmarks={random={count=9, box=[0,0,1,0]}}": "landmarks.random: box is empty; give [x from, y from, ",
        "landmarks={random={count=9, box=[0,0,1,1], min_distance=1}}": "landmarks.random: only 1 of 9 landmarks fit at "
        "min_distance = 1.0; lower it or enlarge the box",
    },
    "q2-long-dense": {
        "association.gate=0": "association.gate: 0.0 is out of range; choose it above 0",
    },
    "q4-ring": {
        "fis.s_max=5": "fis.s_max = 5.0 m is shorter than sensor.max_range = 10.0 m; farther landmarks would be lost",
        "fis.s_min=10": "fis.s_max: 10.0 m must be beyond s_min, 10.0 m; choose it larger",
        "fis.s_min=1e-307": f"fis.beta: 1.7 gives 1337 {TOO_MANY}",
        "fis.alpha=1": "fis.alpha: 1.0 is out of range; choose it above 0 and below 1",
        "fis.beta=1.000001": f"fis.beta: 1.000001 gives 693149 {TOO_MANY}",
        "delayed.poses=2": "delayed.poses: 2 is out of range; choose it at least 3",
    },
}
ROWS = [(scenario, *row) for scenario, rows in OVERRIDES.items() for row in rows.items()]


@pytest.mark.parametrize(("scenario", "override", "line"), ROWS)
def test_a_mistake_is_one_short_line(scenario: str, override: str, line: str) -> None:
    with pytest.raises(UserError, match=r"^[^\n]{1,400}$") as caught:
        load_scenario(scenario, [override])
    assert str(caught.value).startswith(f"{scenario}: {line}")


def test_unknown_names_list_near_misses_or_all() -> None:
    assert "did you mean q1-long-dense" in mistakes("q1-long-dens")[0]
    assert all(name in mistakes("zzz")[0] for name, _ in shipped_scenarios())


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a = 1\nb = = 2\n", r"not valid TOML: [^\n]* \(at line 2, [^\n]*"),
        (f"[sensor]\nmax_range = {'[' * 3000}{']' * 3000}\n", r"not valid TOML: [^\n]{1,200}"),
        ('extends = "q2-long-dens"', "extends: 'q2-long-dens' is not a shipped scenario; did you mean q2-long-dense.*"),
        ("extends = {a = 1}", r"extends: [^\n]+ is not a shipped scenario; [^\n]+"),
        (f"extends = {'1' * 4000}", r"extends: '.{100}' is not a shipped scenario; [^\n]+"),
    ],
)
def test_texts_that_are_no_scenario_are_a_line(write: Write, text: str, line: str):
    [mistake] = mistakes(write(text))
    assert re.fullmatch(line, mistake)


def test_files_and_overrides_that_cannot_be_read(tmp_path: Path):
    assert mistakes(str(tmp_path / "none.toml")) == ["cannot be read (No such file or directory); check the path"]
    (tmp_path / "latin.toml").write_bytes(b'description = "\xe9"')
    assert mistakes(str(tmp_path / "latin.toml")) == ["not a UTF-8 text; save it as UTF-8"]
    for override in ("start", "=1"):
        with pytest.raises(UserError, match=rf"^{override}: not an override; write dotted\.key=value$"):
            load_scenario("q1-long-sparse", [override])
    line = 'association.method = "jcbb" needs rays; set initialisation = "fis", or the method "known"'
    assert mistakes("q4-ring", "association.method=jcbb", "initialisation=delayed") == [line]


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("stamp,x,y,theta\n0,0,0,0\n", "path.csv: 1 poses; give 2 to 1000001"),
        ("stamp,x,y,theta\n0,0,0,0\n1,1,0,nan\n", "path.csv, line 3, column 4: 'nan' is not a finite number"),
        ("stamp,x,y,theta\n0,0,0,0\n1,1,0,0\n1,2,0,0\n", "path.csv, line 4: stamps must increase; sort the rows"),
        ("stamp,x,y,theta\n0,1,0,0\n1,1,0,0\n", "prior.mean: [0.0, 0.0, 0.0] is not where the path of path.csv"),
        ("step,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\n1,1,0,0,1,0,1\n", "motion.sigma_speed: motion.covariances"),
    ],
)
def test_mistakes_in_files_of_a_scenario_are_located(tmp_path: Path, path: str, line: str) -> None:
    (tmp_path / "path.csv").write_text(path)
    section = "motion = {covariances" if path.startswith("step") else "trajectory = {kind = 'csv', file"
    (tmp_path / "my.toml").write_text(f"extends = 'q1-short-dense'\n{section} = 'path.csv'}}\n")
    with pytest.raises(UserError) as caught:
        load_scenario(tmp_path / "my.toml")
    (message,) = str(caught.value).splitlines()
    assert line in message
