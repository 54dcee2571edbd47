#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Tests in a root of the distribution that contains only its smallest set of packages.
#   bare_root.sh make        creates the root, as an archive that is kept for a week
#   bare_root.sh tarball     unpacks the tarball and runs the demo's job
#   bare_root.sh debs        installs the Debian packages and runs the demo's job
#   bare_root.sh small_set   how many packages tools/setup_debian.sh would install
# Skipped if a root cannot be created: not Debian or Ubuntu, not root, no mmdebstrap, no network.
set -euo pipefail
skip() { echo "skipped: $*"; exit 77; }
((EUID == 0)) || skip "only root may make another root"
command -v mmdebstrap >/dev/null || skip "mmdebstrap is missing"
# shellcheck disable=SC1091
suite=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")
[[ -n $suite ]] || skip "the distribution has no code name"
archive=$WORK/bare_root_$suite.tar

if [[ $1 == make ]]; then
  mkdir -p "$WORK"
  if [[ -z $(find "$archive" -type f -mtime -7 2>/dev/null) ]]; then
    # The archive that this machine installs packages from.
    mirror=$(apt-get indextargets --format '$(RELEASE) $(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
      awk -v suite="$suite" '$1 == suite && $2 ~ /\/(debian|ubuntu)\/?$/ && !n++ { print $2 }')
    components=main
    [[ $mirror != */ubuntu* ]] || components=main,universe
    timeout 500 mmdebstrap --format=tar --variant=minbase --include=apt "--components=$components" "$suite" "$archive.tmp" ${mirror:+"$mirror"} >"$archive.log" 2>&1 ||
      { tail -n 5 "$archive.log"; rm -f "$archive.tmp"; skip "no root could be made, see above"; }
    mv "$archive.tmp" "$archive"
  fi
  exit 0
fi

[[ -e $archive ]] || skip "no bare root, see package.bare_root"
root=$(mktemp -d "$WORK/root_$1.XXXXXX")
trap 'rm -rf "$root"' EXIT  # nothing is mounted there
tar -C "$root" -xf "$archive"
cp -L /etc/resolv.conf "$root/etc/resolv.conf"
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C DEBIAN_FRONTEND=noninteractive "$@"; }
update() { inside apt-get update -qq --error-on=any >"$root/log" 2>&1 || { tail -n 5 "$root/log"; skip "the list of packages cannot be fetched"; }; }

# The demo's job from tools/demo.sh: in this root, and with the program just built outside it.
demo_job() {  # demo_job MAKE_SAMPLE_SCANS ACCESSVDB: their paths in the root
  local settings out=$WORK/demo_outside_$$
  settings=$(sed -n 's/^settings="\(.*\)"$/\1/p' "$SOURCE/tools/demo.sh")
  local map=(map --scans /tmp/scans --poses /tmp/scans/poses.txt --tool builtin:pruner --voxel 0.05)
  [[ -n $settings ]] && grep -qF -- '--tool builtin:pruner --voxel 0.05 --out' "$SOURCE/tools/demo.sh" ||
    { echo "tools/demo.sh has another job now; change it here too"; return 1; }
  # shellcheck disable=SC2086  # the settings are several words on purpose
  inside "$1" --out /tmp/scans $settings
  inside "$2" "${map[@]}" --out /tmp/field --quiet
  for file in points.ply field.vdb preview.png; do
    [[ -s $root/tmp/field/$file ]] || { echo "no $file"; return 1; }
  done
  "$PROGRAM" "${map[@]//\/tmp\/scans/$root/tmp/scans}" --device cpu --out "$out" --quiet
  local code=0
  cmp "$root/tmp/field/points.ply" "$out/points.ply" || code=1
  rm -rf "$out"
  return $code
}

case $1 in
  tarball)
    tarball=$(echo "$WORK"/packages/accessvdb-*-linux-*.tar.xz)
    [[ -e $tarball ]] || skip "no tarball, see package.make_packages"
    tar -C "$root/opt" -xJf "$tarball"
    mkdir -p "$root/usr/local/bin"
    folder=/opt/$(basename "$tarball" .tar.xz)
    ln -s "$folder/bin/accessvdb" "$root/usr/local/bin/accessvdb"  # as users do
    demo_job "$folder/bin/make_sample_scans" /usr/local/bin/accessvdb
    ;;
  debs)
    [[ -e $(echo "$WORK"/packages/accessvdb_*.deb) ]] || skip "no packages, see package.make_packages"
    cp "$WORK"/packages/*.deb "$root/tmp/"
    update
    # shellcheck disable=SC2016  # the shell inside expands the patterns
    inside sh -c 'apt-get install --download-only -y -qq --no-install-recommends /tmp/accessvdb_*.deb' >"$root/log" 2>&1 ||
      ! grep -q 'Failed to fetch' "$root/log" || { tail -n 5 "$root/log"; skip "packages cannot be fetched"; }
    # shellcheck disable=SC2016
    inside sh -c 'apt-get install -y -qq --no-install-recommends /tmp/accessvdb_*.deb' >"$root/log" 2>&1 ||
      { tail -n 20 "$root/log"; echo "accessvdb could not be installed"; exit 1; }
    strip -o "$root/tmp/make_sample_scans" "$MAKE_SAMPLE_SCANS"
    demo_job /tmp/make_sample_scans accessvdb
    ! inside dpkg-query -l 'libembree*' 'libqhull*' 2>/dev/null | grep '^ii' || { echo "accessvdb brings the lab's libraries along"; exit 1; }
    # The package for developers means hundreds of megabytes of headers, so only check that apt finds all it needs.
    for package in accessvdb-lab libaccessvdb-dev; do
      inside sh -c "apt-get install -s /tmp/${package}_*.deb" >"$root/log" 2>&1 ||
        { tail -n 20 "$root/log"; echo "$package could not be installed"; exit 1; }
      grep -q "^Inst $package " "$root/log" || { echo "$package would not be installed"; exit 1; }
    done
    inside dpkg --purge accessvdb >"$root/log" 2>&1
    [[ ! -e $root/usr/bin/accessvdb && ! -e $root/usr/share/doc/accessvdb ]] || { echo "files left after removal"; exit 1; }
    ;;
  small_set)
    update
    # shellcheck disable=SC2046  # one word per package
    inside apt-get install -s --no-install-recommends $("$SOURCE/tools/setup_debian.sh" --list) >"$root/log" 2>&1 ||
      { tail -n 5 "$root/log"; exit 1; }
    count=$(grep -c '^Inst ' "$root/log")
    echo "$count packages for the small set"
    # 114 on Debian 12, most for cmake (20) and g++ (18); 743 with libpcl-dev. Room for what a point release adds.
    ((count > 50 && count <= 125)) || { grep '^Inst ' "$root/log"; echo "more than 125 packages (or hardly any)"; exit 1; }
    ;;
esac
