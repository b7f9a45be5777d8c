"""Small logs of every format that `slamgauge import` reads: texts by file name, fields of a MATLAB file."""

from __future__ import annotations

from typing import Any

import numpy as np

CSV = {
    "odometry.csv": "stamp,v,omega\n0.0,1.0,0.5\n1.0,1.0,-0.5\n2.0,1.0,0.0\n3.0,0,0\n",
    "observations.csv": "stamp,landmark,range,bearing\n0.5,7,2.0,0.1\n0.5,3,4.0,-0.2\n2.0,7,1.5,3.1\n",
    "truth.csv": "stamp,x,y,theta\n0.0,0,0,3.0\n1.0,1,0,-3.0\n2.5,2,0,-3.0\n",
    "landmarks.csv": "landmark,x,y\n3,1,2\n7,3,4\n",
    "recording.toml": "[noise]\nforward = 0.1\nturn = 0.05\nrange = 0.2\nbearing = 0.03\n",
}
G2O = {
    "graph.g2o": """\
# a comment
VERTEX_SE2 10 1 2 0.5
VERTEX_SE2 11 2 2 0.5
VERTEX_SE2 15 3 3 0.7
VERTEX_XY 4 5 5
FIX 10
EDGE_SE2 11 15 1 0.1 0.2 400 0 0 900 30 1600
EDGE_SE2 10 11 1 0 0.1 100 10 0 200 0 300
EDGE_SE2_XY 15 4 2 1 25 5 16
EDGE_SE2_XY 10 4 4 -1 25 0 25
""",
}
TORO = {
    "graph.toro": """\
VERTEX2 0 0 0 0
VERTEX2 1 1 0 0
EDGE2 1 0 -1 0.1 -0.2 50 1 60 100 2 3
BR 0 3 0.5 4.0 0.1 0.2
BR 1 3 -0.5 4.0 0.1 0.2
""",
}
MRCLAM = {
    "Robot2_Odometry.dat": "# Time v w\n10.0 0.2 0.0\n10.5 0.2 0.1\n10.5 0.3 0.1\n11.0 0.1 -0.2\n12.0 0.0 0.0\n",
    "Robot2_Measurement.dat": "9.0 63 1.0 0.1\n10.25 63 2.0 0.2\n10.5 14 1.0 0.0\n11.0 99 1 0\n11.5 25 3.0 -0.3\n",
    "Barcodes.dat": "# Subject Barcode\n1 5\n2 14\n6 63\n7 25\n",
    "Robot2_Groundtruth.dat": "10.2 1 2 3.1\n10.9 2 2 -3.1\n11.9 3 2 -3.0\n12.8 3 2 -3.0\n",
    "Landmark_Groundtruth.dat": "6 1.0 2.0 0.001 0.001\n7 3.0 4.0 0.001 0.001\n",
}
COLUMN = np.ones((4, 1))
WOODS: dict[str, Any] = {  # four steps of a robot that turns by 0.3 rad while it drives 0.2 m, with one landmark
    "t": 0.1 * np.arange(4.0)[:, None],
    "v": 2.0 * COLUMN,
    "om": 3.0 * COLUMN,
    "d": 0.5,
    "x_true": COLUMN,
    "y_true": 2.0 * COLUMN,
    "th_true": np.pi / 2 * COLUMN,
    "true_valid": np.array([[1], [1], [0], [1]], dtype=np.uint8),
    "r": np.array([[1.0], [0.0], [9.0], [5.0]]),
    "b": 4.0 * COLUMN,
    "l": [[7.0, 8.0]],
    "r_var": 0.1,
    "b_var": 0.2,
    "v_var": 0.01,
    "om_var": 0.04,
}
