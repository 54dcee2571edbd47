#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# `pip install .` as in docs/python.md: into a fresh environment, from a copy of the sources, without any package index.
# Then the installed package, away from the sources, gives the same labels as the one made by the build.
set -euo pipefail
out=$WORK/pip_install
rm -rf "$out/environment" "$out/sources" "$out/elsewhere"
mkdir -p "$out/sources" "$out/elsewhere"
built=$PYTHONPATH
unset PYTHONPATH

# A copy, because it builds in the source tree: in build/, as deep as the earlier build, so that ccache knows the files.
tar -C "$SOURCE" --exclude=__pycache__ -cf - CMakeLists.txt CHANGELOG.md LICENSE README.md pyproject.toml cmake include \
  nanovdb_kernels python src docs/licences.md tools/collect_licences.sh tools/setup_debian.sh | tar -C "$out/sources" -xf -
"$PYTHON" -m venv --system-site-packages "$out/environment"
pip=("$out/environment/bin/python" -m pip --disable-pip-version-check)
export PIP_NO_INDEX=1 PIP_CONFIG_FILE=/dev/null
arguments="-DACCESSVDB_CUDA=OFF -DACCESSVDB_WARNINGS_AS_ERRORS=${WARNINGS_AS_ERRORS:-OFF} -DACCESSVDB_UNITY=${UNITY:-OFF}"
settings=(--config-settings "cmake-args=$arguments")
(cd "$out/sources" && "${pip[@]}" install "${settings[@]}" -v . >"$out/pip.log" 2>&1) || { tail -40 "$out/pip.log"; exit 1; }
left=$(cd "$out/sources" && LC_ALL=C ls)
wanted=$(printf '%s\n' CHANGELOG.md CMakeLists.txt LICENSE README.md build cmake docs include nanovdb_kernels pyproject.toml python src tools)
[[ $left == "$wanted" ]] || { echo "left behind in the sources: $left"; exit 1; }
# Only what the module needs was built.
[[ -n $(find "$out/sources/build" -name '*.o') ]]
! (cd "$out/sources/build" && find . -name '*.o') | grep -E '/(tools|tests|examples|sim|eval)/' ||
  { echo "too much was built"; exit 1; }

"${pip[@]}" show -f accessvdb | tee "$out/show.txt"
grep -q "^Version: $VERSION$" "$out/show.txt"
grep -q '^Requires: numpy$' "$out/show.txt"
for file in _errors.py __init__.py __init__.pyi _tile_task.py tiles.py py.typed; do grep -q "accessvdb/$file$" "$out/show.txt"; done

cd "$out/elsewhere"
cat >labels.py <<'END'
import sys
import numpy as np
import accessvdb
if sys.argv[1] == "installed":
    assert accessvdb.__file__.startswith(sys.prefix), accessvdb.__file__
field = accessvdb.AccessibilityField(accessvdb.ToolGeometry.builtin("builtin:pencil"),
                                     {"tsdf": {"voxel_size_m": 0.05}, "backend": "cpu"})
random = np.random.default_rng(1)
points = np.stack([np.where(random.random(9000) < 0.5, 3.0, 2.8), *random.uniform(-1, 1, (2, 9000))], axis=1)
for y in (-0.3, 0.0, 0.3):
    pose = np.eye(4)
    pose[1, 3] = y
    field.integrate_scan(points, pose)
field.update()
assert field.snapshot().counts["accessible"] > 100
sys.stdout.buffer.write(field.snapshot().records.tobytes())
END
cmp <("$out/environment/bin/python" labels.py installed) <(PYTHONPATH=$built "$PYTHON" labels.py built)

"$out/environment/bin/python" -m accessvdb.tiles run --help >"$out/help.txt"
grep -q -- '--scheduler tcp://HOST:PORT' "$out/help.txt"

# A second install compiles nothing.
(cd "$out/sources" && "${pip[@]}" install --force-reinstall --no-deps "${settings[@]}" -v . >"$out/again.log" 2>&1) || { tail -40 "$out/again.log"; exit 1; }
! grep -q 'Building CXX' "$out/again.log" || { echo "compiled again"; exit 1; }

# The source archive builds the same wheel's metadata: it contains what the back end reads.
"$PYTHON" - "$out" <<'END'
import sys, tarfile
sys.path.insert(0, sys.argv[1] + "/sources/python/build_backend")
sys.dont_write_bytecode = True
import cmake_wheel
name = cmake_wheel.build_sdist(sys.argv[1])
members = tarfile.open(f"{sys.argv[1]}/{name}").getnames()
top = name[: -len(".tar.gz")]
for path in ("PKG-INFO", "pyproject.toml", "CMakeLists.txt", "python/bindings/module.cpp", "python/accessvdb/py.typed"):
    assert f"{top}/{path}" in members, path
END

# The message names what is missing: here CMake itself.
code=0
(cd "$out/sources" && PATH=$out/environment/bin "${pip[@]}" wheel --no-deps . -w "$out/none") >"$out/missing.log" 2>&1 || code=$?
((code != 0)) && grep -q "'cmake' is missing" "$out/missing.log" || { cat "$out/missing.log"; exit 1; }
