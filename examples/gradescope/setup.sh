#!/usr/bin/env bash
# Install slamgauge in Gradescope's image. Gradescope runs this once, when the autograder is built.
set -eu
source="${AUTOGRADER_SOURCE:-/autograder/source}"
apt-get update
apt-get install -y python3 python3-venv
python3 -m venv "$source/venv"
wheels=("$source"/slamgauge-*.whl)
if [ ! -f "${wheels[0]}" ]; then
    echo "$source has no wheel of slamgauge; make one in its folder, pip wheel --no-deps ., and add it to the zip" >&2
    exit 2
fi
"$source/venv/bin/pip" install "${wheels[0]}"
"$source/venv/bin/slamgauge" check ekf >/dev/null # compiles the filters
