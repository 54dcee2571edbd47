#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Shows that each rule of check_layers.sh fires: plants one violation per file in an otherwise clean tree, and expects
# one line per file, for its rule, and nothing else.
set -euo pipefail
checker=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/check_layers.sh
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
licence=$'// Copyright Contributors to the AccessVDB project\n// SPDX-License-Identifier: Apache-2.0'
expected=()  # "file: rule" of each violation

plant_clean_tree() {
  write include/accessvdb/types.h '#include <vector>' '#include <Eigen/Core>'
  write include/accessvdb/tsdf_volume.h '#include <openvdb/openvdb.h>' '#include "accessvdb/types.h"'
  write nanovdb_kernels/hostdev/nanovdb_compat.h '#include <nanovdb/NanoVDB.h>'
  write nanovdb_kernels/hostdev/views.h '#include <cstdint>' '#include "accessvdb/point_label.h"' '#include "nanovdb_compat.h"'
  write nanovdb_kernels/launch/backend.h '#include <memory>' '#include "hostdev/views.h"'
  write nanovdb_kernels/cpu/cpu_backend.cpp '#include <tbb/parallel_for.h>' '#include "launch/backend.h"' '#include <sys/mman.h>'
  write include/accessvdb/map.h 'class ACCESSVDB_API Map : public Base {' 'struct Map::Impl {' 'class Reader;'
  write src/tsdf/lanes_avx2.h 'struct Lanes {'
  write src/tsdf/lanes_plain.h 'struct Lanes {' '#include "hostdev/views.h"'
  write nanovdb_kernels/cuda/fusion/lanes_cuda.cuh 'struct Lanes {'
  write src/tool/mesh.cpp 'struct Reader {' 'struct Own {'
  write src/field/own.cpp 'struct Own {' '  struct Map {'
  write src/tsdf/map.cpp '#include <tbb/parallel_for.h>' '#include <openvdb/openvdb.h>' '#include "tsdf/map.h"' '// exit(1)'
  write src/tool/mesh_reader.cpp '#include <assimp/scene.h>' '#include <unistd.h>' 'void f() { _exit(1); g("abort()"); }'
  write src/bags/convert.cpp '// "--flag"' 'f("rosbag compress --lz4"); --i; g("a"); // or --voxel'
  write tools/lab/sim/flags.cpp 'f("--frames");'
  write src/field/field.cpp '#include "tsdf/map.h"' '#include "launch/backend.h"'
  write tools/cli/map.cpp '#include <CLI/CLI.hpp>' '#include "accessvdb/types.h"' 'int main() { std::cout << 1; }'
  write tools/cli/program.h '#include <vector>'
  write tools/lab/cli/lab_verbs.h '#include "program.h"' '#include "sim/scene.h"'
  write tools/lab/sim/scene.h '#include "accessvdb/types.h"'
  write tests/parity/mirror_test.cpp '#include <nanovdb/util/OpenToNanoVDB.h>' 'auto h = nanovdb::openToNanoVDB(g);'
}

write() {  # write FILE LINE...
  mkdir -p "$tree/$(dirname "$1")"
  { echo "$licence"; printf '%s\n' "${@:2}"; } >"$tree/$1"
}

expect() {  # expect RULE FILE LINE...: this file breaks exactly this rule. "bad" in its name becomes a name of its own
  local file=${2/bad/bad_${#expected[@]}}
  write "$file" "${@:3}"
  expected+=("$file: $1")
}

plant_clean_tree
if ! output=$("$checker" "$tree"); then
  echo "FAILED: the clean tree is reported: $output"
  exit 1
fi

for header in cuda_runtime.h nanovdb/NanoVDB.h tbb/task_arena.h pcl/point_types.h assimp/mesh.h openvdb/openvdb.h tsdf/map.h; do
  rule=layer
  [[ $header == nanovdb/* ]] && rule=nanovdb-once
  expect "$rule" include/accessvdb/bad.h "#include <$header>"
done
for type in 'struct Map {' 'class Map final : public Base {' 'enum class Map { A };' 'enum Map : char {' 'struct alignas(32) Map {' \
  'template <class T> struct Map {' 'struct Map'; do
  expect type-name src/report/bad.h "$type"
  expect type-name src/report/bad.cpp "$type"
done
expect layer include/accessvdb/bad.h '#include "accessvdb/pcl.h"'
expect layer include/accessvdb/bad.h '#include "accessvdb/ompl.h"'
for file in include/accessvdb/bad.h nanovdb_kernels/launch/bad.h src/io/bad.cpp; do
  expect flag "$file" 'f("Use " + g(1), "or --voxel 0.1");'
done
expect layer src/io/bad.cpp '#include "accessvdb/pcl.h"'
expect layer tools/cli/bad.cpp '#include "accessvdb/pcl.h"'
expect layer python/bindings/bad.cpp '#include <openvdb/openvdb.h>'
expect layer tools/bad.cpp '#include <pybind11/pybind11.h>'
for header in vector array Eigen/Core openvdb/openvdb.h tbb/task_arena.h cuda_runtime.h accessvdb/types.h launch/backend.h; do
  expect layer nanovdb_kernels/hostdev/bad.h "#include <$header>"
done
for header in openvdb/openvdb.h accessvdb/tsdf_volume.h Eigen/Core cuda_runtime.h tsdf/map.h cuda/launch.cuh; do
  expect layer nanovdb_kernels/cpu/bad.cpp "#include \"$header\""
done
for header in openvdb/openvdb.h Eigen/Core tbb/task_arena.h; do
  expect layer nanovdb_kernels/cuda/update/bad.cu "#include <$header>"
done
for header in launch/backend.h cuda_runtime.h pcl/point_types.h points/store.h; do
  expect layer src/tsdf/bad.cpp "#include \"$header\""
done
for header in pcl/point_types.h assimp/mesh.h field/field.h; do
  expect layer src/mirror/bad.cpp "#include \"$header\""
done
for header in openvdb/tree/Tree.h accessvdb/tsdf_volume.h cuda_runtime.h tsdf/map.h; do
  expect layer src/points/bad.cpp "#include \"$header\""
  expect layer src/tool/bad.cpp "#include \"$header\""
done
for header in update/scheduler.h field/field.h tool/tool_kernel.h; do
  expect layer src/points/bad.cpp "#include \"$header\""
done
for header in field/field.h tsdf/map.h cuda/update/updaters.h; do
  expect layer src/update/bad.cpp "#include \"$header\""
done
for header in field/field.h openvdb/openvdb.h points/store.h; do
  expect layer src/picture/bad.cpp "#include \"$header\""
done
expect layer nanovdb_kernels/cuda/memory/bad.h '#include "cuda/search/warp.cuh"'
expect layer nanovdb_kernels/cuda/search/bad.cuh '#include "cuda/update/update_views.cuh"'
expect layer nanovdb_kernels/cuda/update/bad.cu '#include "cuda/cuda_backend.h"'
expect layer nanovdb_kernels/cuda/fusion/bad.cu '#include "cuda/update/update_views.cuh"'
for header in hostdev/views.h launch/backend.h cuda_runtime.h field/field.h; do
  expect layer src/io/bad.cpp "#include \"$header\""
done
for header in cuda_runtime.h pcl/point_types.h assimp/mesh.h sim/scene.h eval/oracle.h; do
  expect layer src/field/bad.cpp "#include \"$header\""
done
for header in hostdev/views.h tsdf/map.h; do
  expect layer tools/lab/eval/bad.cpp "#include \"$header\""
done
expect layer tools/lab/sim/bad.cpp '#include "eval/oracle.h"'
expect layer tools/lab/sim/bad.cpp '#include <libqhull_r/libqhull_r.h>'
expect layer tools/lab/cli/bad.cpp '#include <CLI/App.hpp>'
expect layer tools/cli/bad.cpp '#include "lab_verbs.h"'
expect layer tools/lab/sim/bad.cpp '#include "program.h"'
expect layer tools/lab/cli/bad.cpp '#include "io/ply.h"'
for header in tsdf/map.h hostdev/views.h openvdb/openvdb.h io/ply.h sim/scene.h eval/oracle.h embree3/rtcore.h; do
  expect layer tools/bad.cpp "#include \"$header\""
done
expect nanovdb-once src/mirror/bad.cpp '#include <nanovdb/util/GridBuilder.h>'
expect assimp-once src/tool/other_reader.cpp '#include <assimp/Importer.hpp>'
expect parent-folder src/points/bad.cpp '#include "../points/store.h"'
expect unlisted src/points/bad.cpp '#include <boost/optional.hpp>'
expect unknown-layer src/planner/bad.cpp '#include <vector>'
expect conversion src/mirror/bad.cpp 'auto handle = nanovdb::openToNanoVDB(grid);'
expect conversion src/field/bad.cpp 'auto handle = createNanoGrid(grid);'
expect quiet-library src/io/bad.cpp 'void f() { std::exit(1); }'
expect quiet-library tools/lab/sim/bad.cpp 'void f() { std::exit(1); }'
expect quiet-library src/io/bad.cpp 'void f() { abort(); }'
expect quiet-library src/io/bad.cpp 'void f() { std::cerr << 1; }'
expect quiet-library include/accessvdb/bad.h 'inline void f() { printf(""); }'
for name in src/io/utils.h src/common src/io/ply_helpers.cpp include/accessvdb/manager.h tests/core; do
  mkdir -p "$tree/$name"
  expected+=("$name: name")
done
printf '#pragma once\n' >"$tree/src/io/bare.h"
expected+=("src/io/bare.h: licence")

code=0
output=$("$checker" "$tree") || code=$?
said=$(sed -E 's/^([^:]*):[0-9]+: ([a-z-]+): .*/\1: \2/' <<<"$output" | LC_ALL=C sort)
if ((code != 1)) || ! diff <(printf '%s\n' "${expected[@]}" | LC_ALL=C sort) - <<<"$said"; then
  echo "FAILED: exit code $code; '<' was expected of the checker, '>' is what it says"
  exit 1
fi
echo "every rule fires"
