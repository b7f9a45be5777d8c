#!/usr/bin/env bash
# Install slamgauge in Gradescope's image. Gradescope runs this once, when the autograder is built.
set -eu
source="${AUTOGRADER_SOURCE:-/autograder/source}"
apt-get update
apt-get install -y python3 python3-venv
python3 -m venv "$source/venv"
wheels=("$source"/slamgauge-*.whl)
if [ -f "${wheels[0]}" ]; then
    "$source/venv/bin/pip" install "${wheels[0]}"
else
    "$source/venv/bin/pip" install slamgauge
fi
"$source/venv/bin/slamgauge" check ekf >/dev/null # compiles the filters
