#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# device_view.h of the install tree compiles alone: with the C++ compiler and, if there is one, with nvcc in a kernel.
set -euo pipefail
out=$WORK/device_headers
rm -rf "$out"
mkdir -p "$out"
cat >"$out/alone.cpp" <<'END'
#include <accessvdb/device_view.h>
#include <accessvdb/device_view.h>
bool ask(const accessvdb::DeviceView& view, const double* p_W) {
  return view.armFree(p_W) && view.distanceAt(p_W) >= 0.1f && view.along(p_W, p_W, 0.1).free();
}
END
cat >"$out/alone.cu" <<'END'
#include <accessvdb/device_view.h>
__global__ void ask(accessvdb::DeviceView view, const double* p_W, int* out) {
  *out = view.collides(p_W) || !(view.distanceInterpolatedAt(p_W) >= 0.1f) || !view.along(p_W, p_W + 3, 0.1).free();
}
END
"$CXX" -std=c++20 -O1 -Wall -Wextra -Werror "-I$WORK/moved/include" -c "$out/alone.cpp" -o "$out/alone.o"
if command -v "${CUDACXX:-}" >/dev/null; then  # without nvcc CMake says NOTFOUND
  "$CUDACXX" -std=c++20 -Werror=all-warnings "-I$WORK/moved/include" -c "$out/alone.cu" -o "$out/alone_cuda.o"
fi
