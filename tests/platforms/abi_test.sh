#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The check of what a patch release keeps works: a small library with planted changes, each of which it has to name.
set -euo pipefail
command -v readelf >/dev/null && command -v c++filt >/dev/null || { echo "skipped: readelf or c++filt (binutils) is missing"; exit 77; }
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
folder=$WORK/abi
rm -rf "$folder"
mkdir -p "$folder/include/program"
cd "$folder"
echo 'namespace accessvdb { ACCESSVDB_API void report(int rows); }' >include/program/report.h
list=libaccessvdb-0.1.txt bad=0

build() {  # build [SED_COMMAND]: the library, with one change
  cat >planted.cpp <<'CODE'
extern "C" {
enum { ACCESSVDB_BLOCKED = 2 };
struct accessvdb_point { double x; int label; };
int accessvdb_one(accessvdb_point* point) { return point->label; }
}
namespace accessvdb {
enum class Label : unsigned char { Open, Closed };
struct Base { int b; };
struct Field : Base { double size_m; float weight; float score; Label label; struct Part { int n; }; };
struct Source { virtual int first(); virtual int second(); };
int Source::first() { return 1; }
int Source::second() { return 2; }
inline int inlined(int i) { return i; }
int area(const Field& field) { return inlined(field.b); }
void report(int) {}
namespace { struct Hidden { int h; }; Hidden hidden; }
int hiddenSize() { struct Local { int l; } local{hidden.h}; return local.l; }
}
CODE
  cp planted.cpp before.cpp
  sed -i "${1:-}" planted.cpp
  [[ -z ${1:-} ]] || ! cmp -s planted.cpp before.cpp || { echo "changes nothing: $1"; bad=1; }
  "$CXX" -std=c++20 -O0 -g -fno-eliminate-unused-debug-types -fPIC -shared -nostdlib planted.cpp -o planted.so
}
abi() { "$here/abi.sh" "$1" $list planted.so planted.so include >log 2>&1; }
refused() {  # refused TEXT MODE [SED_COMMAND]: with one line that contains TEXT
  build "${3:-}"
  ! abi "$2" || { echo "not refused: ${3:-$2}"; bad=1; return; }
  [[ $(wc -l <log) == 1 ]] && grep -qF -- "$1" log || { echo "${3:-$2}: expected '$1':"; cat log; bad=1; }
}
accepted() {
  build "${2:-}"
  abi "$1" || { echo "refused: ${2:-$1}:"; cat log; bad=1; }
}

refused "there is no list libaccessvdb-0.1.txt for this version. Write it: cmake --build BUILD --target abi_list" check
accepted write
accepted check
[[ $(sed -n '/^#/!p' $list) == "$(cat <<'FACTS'
base accessvdb::Field 0
field accessvdb::Base::b 0
field accessvdb::Field::Part::n 0
field accessvdb::Field::label 24
field accessvdb::Field::score 20
field accessvdb::Field::size_m 8
field accessvdb::Field::weight 16
field accessvdb::Source::_vptr.Source 0
field accessvdb_point::label 8
field accessvdb_point::x 0
symbol _ZN9accessvdb10hiddenSizeEv
symbol _ZN9accessvdb4areaERKNS_5FieldE
symbol _ZN9accessvdb6Source5firstEv
symbol _ZN9accessvdb6Source6secondEv
symbol _ZTIN9accessvdb6SourceE
symbol _ZTSN9accessvdb6SourceE
symbol _ZTVN9accessvdb6SourceE
symbol accessvdb_one
type accessvdb::Base 4
type accessvdb::Field 32
type accessvdb::Field::Part 4
type accessvdb::Label 1
type accessvdb::Source 8
type accessvdb_point 16
value accessvdb::Label::Closed 1
value accessvdb::Label::Open 0
value enum::ACCESSVDB_BLOCKED 2
virtual accessvdb::Source::first 0
virtual accessvdb::Source::second 1
FACTS
)" ]] || { echo "the list has other facts:"; cat $list; bad=1; }

gone="and $list has it. If that is meant, write the list again"
refused "the symbol accessvdb_one is gone, $gone" check 's/int accessvdb_one/int accessvdb_other/'
refused "the symbol accessvdb::area(accessvdb::Field const&) is gone, $gone" check 's/int area(const Field& field)/int area(const Field\& field, int)/'
refused "accessvdb::Field::score at byte 20 is now accessvdb::Field::score at byte 16, and 1 more" check 's/float weight; float score/float score; float weight/'
refused "accessvdb::Field with 32 bytes is now accessvdb::Field with 40 bytes" check 's/Label label; struct/Label label; double margin_m; struct/'
refused "accessvdb::Label::Closed = 1 is now accessvdb::Label::Closed = 0" check 's/Open, Closed/Closed, Open/'
refused "accessvdb::Source::first at place 0 is now accessvdb::Source::first at place 1" check 's/virtual int first(); virtual int second();/virtual int second(); virtual int first();/'
refused "enum::ACCESSVDB_BLOCKED = 2 is now enum::ACCESSVDB_BLOCKED = 3" check 's/ACCESSVDB_BLOCKED = 2/ACCESSVDB_BLOCKED = 3/'
refused "accessvdb_point::label at byte 8 is now accessvdb_point::label at byte 16" check 's/double x; int label;/double x; double y; int label;/'
refused "new and not in $list: " check 's/int label; };/int label; double confidence; };/'
refused "new and not in $list: the symbol accessvdb_two. Write it there" check 's/^int accessvdb_one/int accessvdb_two() { return 2; } int accessvdb_one/'
accepted check 's/void report(int)/void report(long)/'
accepted check 's/inline int inlined(int i) { return i; }/inline int inlined(long i) { return (int)i; }/'
accepted check 's/struct Hidden { int h;/struct Hidden { int h; int g;/'

# A released list only grows.
sed -i '1s/.*/# State: released/' $list
cp $list released.txt
refused "the symbol accessvdb_one is gone. A patch release keeps it: put it back, or raise the minor version" check 's/int accessvdb_one/int accessvdb_other/'
refused "A patch release keeps it" write 's/double size_m; float weight/float weight; double size_m/'
cmp $list released.txt || { echo "a released list has changed"; bad=1; }
accepted write 's/int label; };/int label; double confidence; };/'
accepted check 's/int label; };/int label; double confidence; };/'
refused "accessvdb_point with 24 bytes is now accessvdb_point with 16 bytes" check
grep -qx '# State: released' $list || { echo "the state is lost"; bad=1; }
sed -i 1d $list
refused "the first line of $list is neither" check
exit $bad
