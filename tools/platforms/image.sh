#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Builds the image of tools/platforms/Containerfile with buildah, from Debian's packages alone and without a registry,
# runs the demo in it as a user who is not root, and writes it as one file for podman load, docker load and skopeo.
#   image.sh [PACKAGES]      the folder that tools/make_packages.sh has filled: out/packages unless given
# The image goes to PACKAGES/accessvdb-VERSION-image-MACHINE.tar. The last line says size, isolation and time of the demo.
set -euo pipefail
fail() {
  echo "image: error: $*" >&2
  exit 1
}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
packages=$(realpath -m "${1:-$source/out/packages}")
for need in buildah mmdebstrap; do
  command -v $need >/dev/null || fail "'$need' is missing: apt install $need"
done
tarball=$(compgen -G "$packages/accessvdb-*-linux-*.tar.xz" || true)
[[ -n $tarball && $(wc -l <<<"$tarball") == 1 && $(compgen -G "$packages/accessvdb_*.deb" | wc -l) == 1 ]] ||
  fail "$packages does not have the packages of one version. Make them: tools/make_packages.sh $packages"
name=$(basename "$tarball" .tar.xz)
version=${name#accessvdb-} version=${version%-linux-*} machine=${name##*-linux-}

stage=$(mktemp -d "$packages/image.XXXXXX")
images=(buildah --root "$stage/store" --runroot "$stage/run")
finish() {
  "${images[@]}" rm --all >/dev/null 2>&1 || true
  "${images[@]}" rmi --all --force >/dev/null 2>&1 || true
  rm -rf "$stage"
}
trap finish EXIT

# The base: as Debian's own small image, whose documents are left out, but not its licences.
mmdebstrap --variant=minbase --format=tar --aptopt='Apt::Install-Recommends "false"' \
  --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' --dpkgopt='path-exclude=/usr/share/doc/*' \
  --dpkgopt='path-include=/usr/share/doc/*/copyright' bookworm "$stage/base.tar" >"$stage/log" 2>&1 ||
  { tail -n 3 "$stage/log" >&2; fail "no base could be made, see above"; }
base=$("${images[@]}" from scratch)
"${images[@]}" add -q "$base" "$stage/base.tar" / >/dev/null
"${images[@]}" commit -q "$base" accessvdb-base >/dev/null
rm "$stage/base.tar"

# Where neither a container nor a user's own names of processes are allowed, a changed root has to do.
for isolation in oci rootless chroot none; do
  [[ $isolation != none ]] || { tail -n 5 "$stage/log" >&2; fail "buildah cannot build here, see above"; }
  "${images[@]}" bud -q --isolation "$isolation" --build-arg BASE=localhost/accessvdb-base --build-arg "VERSION=$version" \
    -t accessvdb -f "$source/tools/platforms/Containerfile" "$packages" >"$stage/log" 2>&1 && break
done

# The demo's job, with its settings, in a folder of that user that stands for one of the host.
settings=$(sed -n 's/^settings="\(.*\)"$/\1/p' "$source/tools/demo.sh")
[[ -n $settings ]] || fail "tools/demo.sh has no settings any more"
mkdir "$stage/data"
chown 1000:1000 "$stage/data"
container=$("${images[@]}" from --pull-never localhost/accessvdb)
inside() { "${images[@]}" run --isolation "$isolation" -v "$stage/data:/data" "$container" -- "$@"; }
[[ $(inside id -u) == 1000 ]] || fail "the image runs as root"
# shellcheck disable=SC2086  # several words on purpose
inside make_sample_scans --out scans $settings >"$stage/log" 2>&1 || { cat "$stage/log" >&2; fail "no sample scans, see above"; }
begin=$(date +%s%N)
inside accessvdb map --scans scans --poses scans/poses.txt --tool builtin:pruner --voxel 0.05 --out field --html >"$stage/log" 2>&1 ||
  { cat "$stage/log" >&2; fail "the demo failed, see above"; }
end=$(date +%s%N)
for file in points.ply field.vdb preview.png report.html report.json; do
  [[ -s $stage/data/field/$file && $(stat -c %u "$stage/data/field/$file") == 1000 ]] || fail "the demo in the image wrote no $file"
done
sum=$(sha256sum <"$stage/data/field/points.ply" | cut -c 1-16)

image=$packages/accessvdb-$version-image-$machine.tar
rm -f "$image.tmp"
"${images[@]}" push -q localhost/accessvdb "oci-archive:$image.tmp:accessvdb:$version" >/dev/null
mv "$image.tmp" "$image"
unpacked=$("${images[@]}" images --json localhost/accessvdb | sed -n 's/^ *"size": "\(.*\)",\?$/\1/p')
awk -v file="$image" -v bytes="$(stat -c %s "$image")" -v unpacked="$unpacked" -v isolation="$isolation" -v ns=$((end - begin)) -v sum="$sum" \
  'BEGIN { printf "%s: %.1f MB, unpacked %s; demo as user 1000, isolation %s: %.1f s, points.ply %s\n", file, bytes / 1e6, unpacked, isolation, ns / 1e9, sum }'
