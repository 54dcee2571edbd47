#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The program built without PCL (and without CUDA) by package.make_packages writes the same output as this build's
# program, for every kind of scan: binary, ascii and compressed PCD, PLY, KITTI, and recorded files if available.
set -euo pipefail
other=$SOURCE/build/packages/bin/accessvdb
[[ -x $other ]] || { echo "skipped: no $other, see package.make_packages"; exit 77; }
grep -qx 'ACCESSVDB_PCL:STRING=OFF' "$SOURCE/build/packages/CMakeCache.txt" || { echo "build/packages was configured with PCL"; exit 1; }
! ldd "$other" | grep -i libpcl || { echo "the program links PCL"; exit 1; }
out=$(mktemp -d "$WORK/without_pcl.XXXXXX")
trap 'rm -rf "$out"' EXIT

"$MAKE_SAMPLE_SCANS" --out "$out/binary" --frames 8 --rays 5000 --seed 3 --range-noise 0.01 >/dev/null
# The same returns in other formats; compressed by liblzf itself, column by column as the format requires.
python3 - "$out" <<'END'
import ctypes, ctypes.util, pathlib, struct, sys
out = pathlib.Path(sys.argv[1])
lzf = ctypes.CDLL(ctypes.util.find_library("lzf"))
for folder in ("ascii", "compressed", "ply", "kitti"):
    (out / folder).mkdir()
saved = 0
for scan in sorted((out / "binary").glob("*.pcd")):
    header, rows = scan.read_bytes().split(b"DATA binary\n", 1)
    n = len(rows) // 12
    points = list(struct.iter_unpack("<fff", rows))
    text = "".join("%.9g %.9g %.9g\n" % p for p in points).encode()
    (out / "ascii" / scan.name).write_bytes(header + b"DATA ascii\n" + text)
    columns = b"".join(struct.pack("<%df" % n, *(p[axis] for p in points)) for axis in range(3))
    packed = ctypes.create_string_buffer(len(columns) + len(columns) // 16 + 64)
    size = lzf.lzf_compress(columns, len(columns), packed, len(packed))
    assert size > 0
    saved += len(columns) - size
    (out / "compressed" / scan.name).write_bytes(
        header + b"DATA binary_compressed\n" + struct.pack("<II", size, len(columns)) + packed.raw[:size])
    ply = "ply\nformat binary_little_endian 1.0\nelement vertex %d\n" % n
    ply += "property float x\nproperty float y\nproperty float z\nend_header\n"
    (out / "ply" / (scan.stem + ".ply")).write_bytes(ply.encode() + rows)
    (out / "kitti" / (scan.stem + ".bin")).write_bytes(b"".join(struct.pack("<ffff", *p, 0) for p in points))
assert saved > 0, "nothing was compressed"
END

bad=0 compared=0
same() {  # same NAME ARGUMENTS...: both programs produce the same map
  local name=$1 file own=$out/own other_out=$out/other
  shift
  rm -rf "$own" "$other_out"
  "$PROGRAM" map "$@" --tool builtin:pruner --voxel 0.05 --device cpu --quiet --out "$own" 2>"$out/log" &&
    "$other" map "$@" --tool builtin:pruner --voxel 0.05 --quiet --out "$other_out" 2>>"$out/log" ||
    { cat "$out/log"; echo "$name: a program failed"; bad=1; return 0; }
  grep -aqE '^element vertex [1-9]' "$own/points.ply" || { echo "$name: no points"; bad=1; }
  for file in points.ply preview.png field.vdb field_points.vdb; do
    cmp "$own/$file" "$other_out/$file" || { echo "$name: $file differs"; bad=1; }
  done
  compared=$((compared + 1))
}
for kind in binary ascii compressed ply kitti; do
  same "$kind" --scans "$out/$kind" --poses "$out/binary/poses.txt" --range-noise 0.01
  [[ $kind != binary ]] || cp "$out/own/points.ply" "$out/points.ply"
  cmp "$out/points.ply" "$out/own/points.ply" || { echo "$kind: another field than from binary PCD"; bad=1; }
done
for file in fraslab_scans_compressed_viewpoint car6; do
  path=${ACCESSVDB_TEST_DATA:-}/pcd_misc/$file.pcd
  [[ ! -e $path ]] || same "$file" --scans "$path" --sensor-at 0,0,0
done
echo "$compared inputs compared"

# A subset of the program's own tests.
ACCESSVDB_PROGRAM_UNDER_TEST=$other "$CLI_TEST" --gtest_filter='MapOutputs*:CommandLine*' --gtest_brief=1 >"$out/log" 2>&1 ||
  { cat "$out/log"; bad=1; }
tail -n 1 "$out/log"
[[ $(tail -n 1 "$out/log") =~ 'PASSED  ] '[1-9] ]] || { echo "no test of the program ran"; bad=1; }
exit $bad
