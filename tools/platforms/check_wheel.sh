#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Installs a portable wheel in a root of a distribution that has only Python, NumPy and pip, labels the demo's scans there,
# and says how long that took. The same with a processor without AVX, by qemu.
#   check_wheel.sh WHEEL PROGRAMS [SUITE [MIRROR]]     PROGRAMS: the folder of accessvdb and make_sample_scans
# SUITE: bookworm unless given; its python3 has to be that of the wheel. MIRROR may be a line of sources.list: "deb
# [trusted=yes] http://archive.ubuntu.com/ubuntu jammy main universe". points.ply is that of `accessvdb map`, byte for
# byte. Needs root, mmdebstrap and qemu-user-static; roots are kept in build/roots.
set -euo pipefail
fail() {
  echo "check_wheel: error: $*" >&2
  exit 1
}
(($# >= 2)) || fail "usage: check_wheel.sh WHEEL PROGRAMS [SUITE [MIRROR]]"
((EUID == 0)) || fail "only root may make another root"
wheel=$(realpath "$1") programs=$(realpath "$2") suite=${3:-bookworm} mirror=${4:-http://deb.debian.org/debian}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
archive=$source/build/roots/python_$suite.tar
mkdir -p "$source/build/roots"
if [[ ! -e $archive ]]; then
  mmdebstrap --quiet --format=tar --variant=minbase --include=python3,python3-numpy,python3-pip,python3-venv "$suite" "$archive.tmp" "$mirror" ||
    fail "no root of $suite could be made, see above"
  mv "$archive.tmp" "$archive"
fi
root=$(mktemp -d "$source/build/roots/check.XXXXXX")
trap 'rm -rf "$root"' EXIT
tar -C "$root" -xf "$archive"
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 "$@"; }
! inside python3 -c 'import ctypes; ctypes.CDLL("libopenvdb.so.10.0")' 2>/dev/null || fail "$suite's root has OpenVDB: it would show nothing"
[[ -z $(inside sh -c 'ldconfig -p | grep -E "tbb|assimp|openvdb"') ]] || fail "the root has libraries that the wheel brings"

settings=$(sed -n 's/^settings="\(.*\)"$/\1/p' "$source/tools/demo.sh")
[[ -n $settings ]] || fail "tools/demo.sh has no settings any more; change this script, too"
# shellcheck disable=SC2086  # several words on purpose
"$programs/make_sample_scans" --out "$root/scans" $settings >/dev/null
cp "$wheel" "$root/root/"
cat >"$root/root/first_label.py" <<'END'
import sys
import time
import accessvdb
scans, out, most = sys.argv[1], sys.argv[2], int(sys.argv[3])
sequence = accessvdb.ScanSequence(scans, f"{scans}/poses.txt")
for count in (1, most):
    field = accessvdb.AccessibilityField(
        accessvdb.ToolGeometry.builtin("builtin:pruner"),
        {"tsdf": {"voxel_size_m": 0.05, "range_noise_m": sequence.recorded_range_noise_m}})
    for _, scan in zip(range(count), sequence):
        field.integrate(scan)
    field.update()
    if count == 1:
        print("first label", field.snapshot().counts, time.time())
print("all", field.snapshot().counts, time.time())
field.write(out)
END
echo "wheel: $(basename "$wheel"), $(awk -v b="$(stat -c %s "$wheel")" 'BEGIN { printf "%.1f MB", b / 1e6 }')"
echo "root: $suite, $(inside python3 --version), $(inside ldd --version | head -n 1), $(nproc) cores"
begin=$(date +%s.%N)
inside python3 -m venv --system-site-packages /root/environment
made=$(date +%s.%N)
inside /root/environment/bin/pip install --quiet --disable-pip-version-check --no-index "/root/$(basename "$wheel")"
installed=$(date +%s.%N)
said=$(inside /root/environment/bin/python /root/first_label.py /scans /root/field 1000)
echo "$said"
"$programs/accessvdb" map --scans "$root/scans" --poses "$root/scans/poses.txt" --tool builtin:pruner --voxel 0.05 --device cpu --out "$root/outside" --quiet
cmp "$root/root/field/points.ply" "$root/outside/points.ply" || fail "not the points of accessvdb map"
awk -v begin="$begin" -v made="$made" -v installed="$installed" -v first="$(sed -n 's/^first label.* //p' <<<"$said")" -v all="$(sed -n 's/^all.* //p' <<<"$said")" \
  'BEGIN { printf "python3 -m venv %.1f s; pip install %.1f s; from pip install to the first label %.1f s, to all labels %.1f s\n",
           made - begin, installed - made, first - made, all - made }'

# Without AVX, SSE4 and the like: a general x86-64.
if [[ $(uname -m) == x86_64 ]]; then
  qemu=$(command -v qemu-x86_64-static) || fail "qemu-x86_64-static is missing. On Debian and Ubuntu: apt install qemu-user-static"
  cp "$qemu" "$root/root/"
  inside /root/environment/bin/python /root/first_label.py /scans /root/here 1 >/dev/null
  begin=$(date +%s.%N)
  # qemu warns about features that it does not emulate.
  inside /root/qemu-x86_64-static -cpu qemu64 /root/environment/bin/python /root/first_label.py /scans /root/plain 1 2>"$root/log" >/dev/null ||
    { tail -n 5 "$root/log" >&2; fail "it does not run on a processor without AVX"; }
  cmp "$root/root/here/points.ply" "$root/root/plain/points.ply" || fail "other labels on a processor without AVX"
  awk -v begin="$begin" -v end="$(date +%s.%N)" 'BEGIN { printf "the same labels on a processor without AVX (qemu64), in %.0f s\n", end - begin }'
fi
