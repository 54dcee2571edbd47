#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Checks which layer includes what, and a few rules that compilers do not check: check_layers.sh [ROOT]
# Prints one line per violation, "file:line: rule: what", and exits 1 if there is any.
#
# The table lists what IS allowed; an include that it does not list is a violation too, so that a new dependency has to
# be written down here. Arrows run one way: a folder may only name folders in its row.
set -euo pipefail
root=${1:-$(dirname "${BASH_SOURCE[0]}")/../..}
cd "$root"

# layer: what its files may include (besides its own files). `grids` is the public header that returns OpenVDB grids;
# `pcl-header` is accessvdb/pcl.h, and `ompl-header` accessvdb/ompl.h: the two exceptions, public headers that include
# another package, for its users.
# `constants`: headers without code that a device could lack. tools/lab has three layers, sim, eval and lab (its cli).
allowed_includes() {
  cat <<'TABLE'
api      std eigen
grids    std eigen api openvdb
pcl-header std eigen api pcl
ompl-header std eigen api ompl
hostdev  constants label
launch   std api hostdev
cpu      std posix simd api hostdev launch tbb
cuda-memory std api hostdev launch cudart
cuda-search std api hostdev launch cudart cuda-memory
cuda-fusion std api hostdev launch cudart cuda-memory cuda-search
cuda-update std api hostdev launch cudart cuda-memory cuda-search
cuda     std api hostdev launch cudart cuda-memory cuda-update cuda-search cuda-fusion
vdb      openvdb
processor std simd
tsdf     std posix processor api grids eigen openvdb vdb tbb hostdev
mirror   std posix api grids openvdb tbb launch hostdev
points   std api eigen tbb launch hostdev processor
change   std api eigen openvdb tbb launch hostdev tsdf points
update   std api eigen tbb launch hostdev processor points simd
tool     std posix api eigen tbb launch hostdev assimp openssl
bags     std api eigen bzip2 lz4 sqlite zlib zstd
io       std posix api grids eigen openvdb vdb tbb lzf openssl json bags
picture  std api eigen tbb io png
field    std posix api grids eigen openvdb vdb tbb launch hostdev processor tsdf mirror points change update tool io
live     std api eigen io field
tiles    std posix api grids eigen openvdb vdb tbb launch hostdev points update tool field io json
report   std api eigen tool io zlib openssl json
capi     std api eigen
dds      std api eigen bags io fastdds
gis      std posix api eigen gdal
tools    std posix api grids eigen cli toml json dds gis octomap
sim      std api grids eigen tbb field io embree
eval     std api grids openvdb vdb eigen tbb field sim io embree qhull png json picture ompl ompl-header
lab      std posix api grids eigen json tools sim eval
examples std posix api grids eigen cli cudart pcl pcl-header ompl ompl-header
python   std api eigen pybind
TABLE
}

sources() {  # every source file of the product; tests may include anything
  local folders=()
  for folder in include nanovdb_kernels src tools examples python; do
    [[ -d $folder ]] && folders+=("$folder")
  done
  find "${folders[@]}" -type f \( -name '*.h' -o -name '*.cuh' -o -name '*.c' -o -name '*.cpp' -o -name '*.cu' \) | LC_ALL=C sort
}

check_includes() {
  local files
  files=$(sources)
  {
    allowed_includes | sed 's/^/ALLOW /'
    awk '{ print "FILE", $0 }' <<<"$files"
    # shellcheck disable=SC2086  # one word per file: names with blanks are a separate violation
    grep -nHE '^[[:space:]]*#[[:space:]]*include' $files | sed -E 's/^([^:]*):([0-9]+):[^"<]*(["<])([^">]*).*/INCLUDE \1 \2 \3 \4/'
  } | awk '
    function folder(path) { sub(/\/[^\/]*$/, "", path); return path }
    function layerOf(path,   part) {
      split(path, part, "/")
      if (path ~ /^include\/accessvdb\/tsdf_volume\.h$/) return "grids"
      if (path ~ /^include\/accessvdb\/pcl\.h$/) return "pcl-header"
      if (path ~ /^include\/accessvdb\/ompl\.h$/) return "ompl-header"
      if (path ~ /^include\/accessvdb\//) return "api"
      if (path ~ /^nanovdb_kernels\/cuda\/[a-z]+\//) return "cuda-" part[3]
      if (part[1] == "nanovdb_kernels" || part[1] == "src") return part[2]
      if (part[1] == "tools" && part[2] == "lab") return part[3] == "cli" ? "lab" : part[3]
      return part[1]
    }
    function classOf(name, quote, path,   first, here) {
      first = name; sub(/\/.*/, "", first)
      if (name ~ /(^|\/)\.\.\//) return "parent-folder"
      if (name == "accessvdb/tsdf_volume.h") return "grids"
      if (name == "accessvdb/pcl.h") return "pcl-header"
      if (name == "accessvdb/ompl.h") return "ompl-header"
      if (name == "accessvdb/point_label.h" && layerOf(path) == "hostdev") return "label"
      if (first == "accessvdb") return "api"
      if (first in third) return third[first]
      if (name in third) return third[name]
      if (name ~ /^(cuda|device_|driver_types|vector_types|cooperative_groups|nvrtc|curand)/ && !(first in layers)) return "cudart"
      if (name ~ /^sys\// || name in posix) return "posix"
      if (name in constants && layerOf(path) == "hostdev") return "constants"
      if (quote == "<" && (name !~ /[\/.]/ || name ~ /^(stddef|stdint|stdio|stdlib|string|math)\.h$/)) return "std"
      if (name ~ /^cuda\/[a-z]+\//) { split(name, room, "/"); return "cuda-" room[2] }
      if (name ~ /\// && first in layers) return first
      here = folder(path) "/" name
      if (here in exists) return layerOf(path)
      if ((layerOf(path) "/" name) in exists) return layerOf(path)  # examples and tools, by their path below them
      if (("nanovdb_kernels/hostdev/" name) in exists) return "hostdev"
      if (("tools/cli/" name) in exists) return "tools"
      if (("tools/lab/cli/" name) in exists) return "lab"
      return "unlisted"
    }
    BEGIN {
      n = split("nanovdb:nanovdb openvdb:openvdb tbb:tbb oneapi:tbb pcl:pcl ompl:ompl octomap:octomap lzf.h:lzf assimp:assimp Eigen:eigen unsupported:eigen " \
                "cub:cudart thrust:cudart nv:cudart embree3:embree embree4:embree libqhull_r:qhull libqhullcpp:qhull png.h:png " \
                "pybind11:pybind openssl:openssl immintrin.h:simd arm_neon.h:simd CLI:cli toml++:toml toml.hpp:toml nlohmann:json " \
                "bzlib.h:bzip2 lz4frame.h:lz4 sqlite3.h:sqlite zlib.h:zlib zstd.h:zstd fastdds:fastdds fastrtps:fastdds gdal.h:gdal ogr_api.h:gdal ogr_srs_api.h:gdal", pairs, " ")
      for (i = 1; i <= n; ++i) { split(pairs[i], kv, ":"); third[kv[1]] = kv[2] }
      n = split("unistd.h malloc.h fcntl.h signal.h poll.h spawn.h termios.h dirent.h dlfcn.h pthread.h", names, " ")
      for (i = 1; i <= n; ++i) posix[names[i]] = 1
      n = split("cstdint cstddef cmath cfloat climits limits type_traits", names, " ")
      for (i = 1; i <= n; ++i) constants[names[i]] = 1
    }
    $1 == "ALLOW" { layers[$2] = 1; for (i = 3; i <= NF; ++i) allow[$2, $i] = 1; allow[$2, $2] = 1; next }
    $1 == "FILE" { exists[$2] = 1; next }
    {
      path = $2; line = $3; name = $5; layer = layerOf(path); class = classOf(name, $4, path)
      where = path ":" line
      if (!(layer in layers)) { print where ": unknown-layer: no row in the table for \"" layer "\""; next }
      if (class == "parent-folder") { print where ": parent-folder: \"" name "\" climbs out of its folder"; next }
      if (class == "unlisted") { print where ": unlisted: \"" name "\" is not a dependency that the table knows"; next }
      if (class == "nanovdb") {
        if (path != "nanovdb_kernels/hostdev/nanovdb_compat.h")
          print where ": nanovdb-once: only nanovdb_compat.h includes NanoVDB"
        next
      }
      if (class == "assimp" && layer == "tool") {
        if (assimp_file != "" && assimp_file != path) print where ": assimp-once: already in " assimp_file
        assimp_file = path
      }
      if (!((layer, class) in allow)) print where ": layer: " layer " must not include " class " (\"" name "\")"
    }'
}

check_names() {
  local folders=()
  for folder in include nanovdb_kernels src tools examples python tests cmake; do
    [[ -d $folder ]] && folders+=("$folder")
  done
  find "${folders[@]}" | LC_ALL=C sort |
    grep -E '(^|[/_])(utils?|common|core|helpers?|managers?)(\.[a-z]+)?$' |
    sed 's/$/:1: name: says nothing about what it holds/' || true
  find "${folders[@]}" -name '* *' | sed 's/$/:1: name: has a blank/'
}

# A type that a header defines has a name of its own, in whatever namespace: two in one namespace are one to the linker,
# which keeps the functions of either, and two elsewhere are one to the reader. Nested types, and those that only one
# source file knows, may be called alike; so may the lanes of the instruction sets, which are one vocabulary.
check_types() {
  # shellcheck disable=SC2046
  awk '
    match($0, /^(template <.*> *)?(class|struct|union|enum class|enum) +(([A-Z_]+|(alignas|[A-Z_]+)\([^)]*\)) +)*[A-Z][A-Za-z0-9]*(::[A-Z][A-Za-z0-9]*)?( final)? *(:[^:;][^;]*)?(\{.*)?$/) {
      name = $0
      sub(/^template <.*> +(class|struct|union) /, "", name)
      sub(/^(class|struct|union|enum class|enum) +/, "", name)
      while (sub(/^([A-Z_]+|(alignas|[A-Z_]+)\([^)]*\)) +/, "", name)) {}
      if (name ~ /^[A-Za-z0-9]+::/) next  # nested: Field::Impl
      sub(/[^A-Za-z0-9].*/, "", name)
      if (FILENAME ~ /^(examples|python)\//) next  # programs of their own
      if (FILENAME ~ /\/lanes_[a-z0-9]+\.(h|cuh)$/) next
      where[++found] = FILENAME ":" FNR
      type[found] = name
      if (FILENAME ~ /\.(h|cuh)$/) in_header[name] = 1
      if (!(name in first)) first[name] = where[found]
    }
    END {
      for (n = 1; n <= found; ++n) {
        if (!(type[n] in in_header) || first[type[n]] == where[n]) continue
        print where[n] ": type-name: " type[n] " is also in " first[type[n]]
      }
    }' $(sources)
}

# Lines of code without // comments and without string contents, as "file:line:code".
code_lines() {
  # shellcheck disable=SC2046  # one word per file, as above
  awk '{ gsub(/"([^"\\]|\\.)*"/, "\"\""); sub(/\/\/.*/, "") } NF { print FILENAME ":" FNR ":" $0 }' $(sources)
}

check_code() {
  local code
  code=$(code_lines)
  # Whole-grid conversions take tens of milliseconds per frame; the mirror is patched instead. Tests compare with them.
  grep -E ':.*\b(openToNanoVDB|createNanoGrid)\b' <<<"$code" |
    sed -E 's/^([^:]*:[0-9]+):.*/\1: conversion: whole-grid NanoVDB conversion outside tests/' || true
  # A library neither ends its host nor writes to its terminal.
  grep -E '^(include|nanovdb_kernels|src|tools/lab/(sim|eval))/[^:]*:[0-9]+:' <<<"$code" |
    grep -E '(^|[^A-Za-z0-9_])(exit|abort|quick_exit|terminate|printf|puts)[[:space:]]*\(|std::(cout|cerr|clog)\b|\bcudaDeviceReset\b' |
    sed -E 's/^([^:]*:[0-9]+):.*/\1: quiet-library: ends the process, resets the device or prints/' || true
}

# Messages of the library name its parameters; the program says which flags they are (tools/cli/output/error_output.cpp).
check_flags_in_messages() {
  # shellcheck disable=SC2046  # one word per file, as above
  awk '/^[[:space:]]*\/\// { next }
       FILENAME !~ /^(include|nanovdb_kernels|src)\// || FILENAME ~ /^src\/(eval|sim|dds)\// { next }
       {
         sub(/\/\/[^"]*$/, "")
         gsub(/rosbag compress --lz4|-q --single-line -o WKT1/, "")  # flags of other programs
         for (line = $0; match(line, /"([^"\\]|\\.)*"/); line = substr(line, RSTART + RLENGTH))
           if (substr(line, RSTART, RLENGTH) ~ /--[a-z]/) { print FILENAME ":" FNR ": flag: the library names a flag"; break }
       }' $(sources)
}

check_licence() {
  # shellcheck disable=SC2046
  awk 'FNR == 2 && !/SPDX-License-Identifier: Apache-2.0/ { print FILENAME ":2: licence: no SPDX line" }
       { lines[FILENAME] = FNR }
       END { for (file in lines) if (lines[file] < 2) print file ":2: licence: no SPDX line" }' $(sources)
}

violations=$(check_includes; check_names; check_types; check_code; check_flags_in_messages; check_licence)
if [[ -n $violations ]]; then
  echo "$violations"
  exit 1
fi
