#!/usr/bin/env bash
# Install slamgauge in Gradescope's image. Gradescope runs this once, when the autograder is built.
set -eu
source="${AUTOGRADER_SOURCE:-/autograder/source}"
wheels=("$source"/slamgauge-*.whl)
if [ ! -f "${wheels[0]}" ]; then
    echo "$source has no wheel of slamgauge; make one in its folder, pip wheel --no-deps ., and add it to the zip" >&2
    exit 2
fi
apt-get update
apt-get install -y python3 python3-venv
python=python3
if ! python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then # Ubuntu 22.04
    python=python3.11
    apt-get install -y "$python" "$python-venv"
fi
"$python" -m venv "$source/venv"
"$source/venv/bin/pip" install "${wheels[0]}"
"$source/venv/bin/slamgauge" check ekf >/dev/null # compiles the filters
