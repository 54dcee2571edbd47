#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# What the portable archive asks of a machine: tools/platforms/glibc_needed.sh reads it, tools/make_portable.sh refuses
# too much of it, and the archive's `run` says what a machine lacks. The libraries are planted: a C library that is a few
# empty functions with versions, as a linker script names them, and libraries linked to it. Nothing of them is ever run.
set -euo pipefail
for need in readelf dpkg-query xz; do
  command -v "$need" >/dev/null || { echo "skipped: $need is missing"; exit 77; }
done
machine=$(uname -m)
folder=$WORK/portable root=$WORK/portable/root
libraries=$root/usr/lib/$machine-linux-gnu
rm -rf "$folder"
mkdir -p "$libraries" "$root/var/lib/dpkg/info" "$root/usr/share/doc/libplanted1" "$root/usr/share/doc/libnewer1"
bad=0
complain() { echo "$*"; bad=1; }

# plant FILE SONAME SOURCE VERSION_SCRIPT [LIBRARY...]
plant() {
  local file=$1 soname=$2 code=$3 versions=$4
  shift 4
  echo "$code" >"$folder/planted.c"
  echo "$versions" >"$folder/versions"
  "$CC" -shared -fPIC -O1 -nostdlib -fno-stack-protector -Wl,-z,now "-Wl,-soname,$soname" ${versions:+"-Wl,--version-script=$folder/versions"} \
    -o "$file" "$folder/planted.c" "$@"
}
plant "$libraries/libc.so.6" libc.so.6 'void old(void) {} void middle(void) {} void newer(void) {} void tied(void) {}' \
  'GLIBC_2.4 { global: old; local: *; }; GLIBC_2.10 { global: middle; }; GLIBC_2.99 { global: newer; }; GLIBC_PRIVATE { global: tied; };'
calls() {  # calls FUNCTION...
  printf 'void %s(void); ' "$@" planted
  echo "void planted(void) { $(printf '%s(); ' "$@")}"
}
plant "$libraries/libplanted.so.1" libplanted.so.1 "$(calls old middle old)" '' "$libraries/libc.so.6"
plant "$libraries/libnewer.so.1" libnewer.so.1 "$(calls middle newer old)" '' "$libraries/libc.so.6"
plant "$folder/libtied.so.1" libtied.so.1 "$(calls tied)" '' "$libraries/libc.so.6"
program() {  # program NAME LIBRARY
  echo 'void planted(void); void _start(void) { planted(); }' >"$folder/planted.c"
  "$CC" -nostdlib -fno-stack-protector -o "$folder/$1" "$folder/planted.c" "$2" "-Wl,-rpath-link,$libraries"
}
program good "$libraries/libplanted.so.1"
program new "$libraries/libnewer.so.1"

needs=$SOURCE/tools/platforms/glibc_needed.sh
line() { cut -f 2,3 <<<"$1" | tr '\t' ' '; }
[[ $(line "$("$needs" "$libraries/libplanted.so.1")") == "2.10 middle" ]] || complain "not seen: 2.10 by middle"
[[ $(line "$("$needs" "$libraries/libnewer.so.1")") == "2.99 newer" ]] || complain "not seen: 2.99 by newer"
"$needs" --limit 2.99 "$libraries"/lib*.so.1 >/dev/null || complain "refused what is at the limit"
# refused TEXT COMMAND...: with one line that contains TEXT
refused() {
  local text=$1 code=0
  shift
  "$@" >"$folder/out" 2>"$folder/err" || code=$?
  ((code != 0)) && grep -qF -- "$text" "$folder/err" || { complain "not refused with '$text' ($code):"; cat "$folder/err"; }
}
refused "libnewer.so.1 needs glibc 2.99 (newer), more than 2.35" "$needs" --limit 2.35 "$libraries"/lib*.so.1
refused "needs glibc of one build only (tied of GLIBC_PRIVATE), more than 2.35" "$needs" --limit 2.35 "$folder/libtied.so.1"
refused "is no program and no shared library" "$needs" "$folder/planted.c"
refused "--limit needs a version" "$needs" --limit much "$libraries/libplanted.so.1"

# A root with a list of packages, as dpkg writes it, so that licences are found.
for package in libplanted1 libnewer1; do
  printf 'Package: %s\nStatus: install ok installed\nMaintainer: none\nArchitecture: all\nVersion: 1\nDescription: none\n\n' $package \
    >>"$root/var/lib/dpkg/status"
  echo "/usr/lib/$machine-linux-gnu/${package%1}.so.1" >"$root/var/lib/dpkg/info/$package.list"
  echo "the licence of $package" >"$root/usr/share/doc/$package/copyright"
done
export XZ_LEVEL=0
pack() { "$SOURCE/tools/make_portable.sh" --name packed --sysroot "$root" "$@"; }
refused "libraries/libnewer.so.1 needs glibc 2.99 (newer), more than 2.35" pack "$folder/new.tar.xz" - "$folder/new"
[[ ! -e $folder/new.tar.xz ]] || complain "an archive, although it was refused"
rm "$root/usr/share/doc/libnewer1/copyright"
refused "package 'libnewer1' has no licence text" pack --glibc 2.99 "$folder/new.tar.xz" - "$folder/new"
mv "$libraries/libplanted.so.1" "$folder/"
refused "libplanted.so.1, which good needs, is not in $root" pack "$folder/packed.tar.xz" - "$folder/good"
mv "$folder/libplanted.so.1" "$libraries/"
pack "$folder/packed.tar.xz" - "$folder/good" >"$folder/out" || complain "the good program is not packed"
tar -C "$folder" -xJf "$folder/packed.tar.xz"
archive=$folder/packed
head -n 1 "$archive/README" | grep -qF "for $machine Linux with glibc 2.10 or later" || { complain "the archive's README says:"; head -n 1 "$archive/README"; }
cmp "$archive/licences/libplanted1" "$root/usr/share/doc/libplanted1/copyright" || bad=1

# The loader's part in `run`, played by a program without a loader: it lists what the variable MACHINE_LACKS says, in the
# loader's words, unless the runtime of the archive is in the path.
mkdir -p "$archive/runtime"
cat >"$folder/played.c" <<'PROGRAM'
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
int main(int count, char** arguments) {
  const char* path = getenv("LD_LIBRARY_PATH");
  const char* lacks = getenv("MACHINE_LACKS");
  if (getenv("LD_TRACE_LOADED_OBJECTS") == NULL) {
    printf("ran with %s:", path);
    for (int i = 1; i < count; ++i) printf(" %s", arguments[i]);
    return 0 * printf("\n");
  }
  if (strcmp(lacks, "CANNOT") == 0) return 126;
  printf("\tlibm.so.6 => /lib/libm.so.6 (0x00007f0000000000)\n");
  if (strcmp(lacks, "LIBRARY") == 0) {
    printf("\tlibplanted.so.1 => not found\n");
  } else if (strcmp(lacks, "BOTH") == 0) {
    fprintf(stderr, "good: /lib/libc.so.6: version `%s' not found (required by good)\n",
            strstr(path, "/runtime") != NULL ? "GLIBC_2.36" : "GLIBCXX_3.4.30");
  } else if (lacks[0] != 0 && !(strncmp(lacks, "GLIBCXX", 7) == 0 && strstr(path, "/runtime") != NULL)) {
    fprintf(stderr, "good: /lib/libc.so.6: version `%s' not found (required by good)\n", lacks);
  }
  return 0;
}
PROGRAM
"$CC" -static -o "$archive/programs/good" "$folder/played.c"
run() { env -u LD_LIBRARY_PATH MACHINE_LACKS="$1" "$archive/bin/good" one 'two words'; }
[[ $(run "") == "ran with $archive/libraries: one two words" ]] || complain "does not run where nothing is missing"
[[ $(run GLIBCXX_3.4.30) == "ran with $archive/libraries:$archive/runtime: one two words" ]] || complain "an old C++ runtime is not replaced"
refused_at_start() {  # refused_at_start LACKS TEXT: one line, and code 5
  local code=0
  run "$1" >"$folder/out" 2>"$folder/err" || code=$?
  ((code == 5)) && [[ $(wc -l <"$folder/err") == 1 && ! -s $folder/out ]] && grep -qF -- "$2" "$folder/err" ||
    { complain "$1 (code $code), expected: $2"; cat "$folder/out" "$folder/err"; }
}
refused_at_start GLIBC_2.34 "is older than glibc 2.10, which is needed. Use a newer distribution"
refused_at_start BOTH "good: error[start.runtime] this machine: its libstdc++ is too old, and the one in runtime/ needs glibc"
refused_at_start LIBRARY "good: error[start.library] libplanted.so.1 => not found: a library is missing here. Unpack the archive again."
refused_at_start CANNOT "good: error[start.machine] $machine: this is a program for $machine Linux with glibc 2.10 or later"
exit $bad
