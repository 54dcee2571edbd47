#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Runs one test script: run.sh python|blender SCRIPT. The settings come from CMakeLists.txt next to this file.
set -euo pipefail
host=$1 script=$2
advice="Install it: ./tools/setup_debian.sh --tests"
export PYTHONPATH=$SOURCE/tests/blender:$SOURCE/tools/blender PYTHONDONTWRITEBYTECODE=1
mkdir -p "$WORK"

case $host in
  python)
    # Debian's modules belong to Debian's Python, whichever Python is first on the PATH.
    for python in /usr/bin/python3 python3; do
      if "$python" -c 'import numpy, importlib.util as u; assert u.find_spec("pyopenvdb") or u.find_spec("openvdb")' 2>/dev/null; then exec "$python" "$script"; fi
    done
    echo "no Python with numpy and pyopenvdb. $advice" >&2
    exit 1
    ;;
  blender)
    command -v blender >/dev/null || { echo "no Blender. $advice" >&2; exit 1; }
    # Uses nothing from the user's own set-up, and writes nothing there.
    home=$WORK/blender_home/$(basename "$script" .py)
    mkdir -p "$home"
    export BLENDER_USER_CONFIG=$home/config BLENDER_USER_SCRIPTS=$home/scripts BLENDER_USER_DATAFILES=$home/data
    exec blender --background --factory-startup --python-use-system-env --python-exit-code 1 --python "$script"
    ;;
esac
