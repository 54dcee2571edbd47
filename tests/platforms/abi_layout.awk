# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# From `readelf --debug-dump=info` of an object that includes the public headers: the layout of each struct and class
# and the values of each enum of the namespaces accessvdb, accessvdb::io and accessvdb::tiles, and of the C API. One fact
# a line: type NAME SIZE; base NAME OFFSET; field NAME::FIELD OFFSET; virtual NAME::FUNCTION SLOT; value
# NAME::ENUMERATOR VALUE. Templates and what has no name or no definition are left out.
function value(line) {  # of an attribute, without what versions of readelf say of its form: (data1), (strp) (offset: 0x1):
  sub(/^ *<[0-9a-f]+> +DW_AT_[A-Za-z_]+ *: */, "", line)
  sub(/^\([a-z_]+[0-9]*\) /, "", line)
  sub(/^\([a-z, ]*offset: (0x)?[0-9a-f]+\): /, "", line)
  sub(/[ \t]+$/, "", line)
  return line
}
function is_public(type) { return type ~ /^accessvdb(_[a-z0-9_]+|(::(io|tiles))?(::[A-Z][A-Za-z0-9_]*)+)$/ }
function finish(   outer) {
  if (tag == "") return
  outer = depth > 1 ? scope[depth - 1] : ""
  kept[depth] = ""
  if (tag == "namespace" || tag ~ /^(structure|class|union|enumeration)_type$/) {
    # What is unnamed or inside of a function or another thing is of nobody's concern.
    scope[depth] = outer == "-" ? "-" : name == "" ? "-" : outer (outer != "" ? "::" : "") name
    if (tag == "enumeration_type" && name == "" && outer == "") scope[depth] = "enum"  # C's, without a name
    if (tag != "namespace" && size != "" && !declaration && is_public(scope[depth])) {
      kept[depth] = scope[depth]
      print "type " scope[depth] " " size
    } else if (scope[depth] == "enum") {
      kept[depth] = "enum"
    }
  } else {
    scope[depth] = "-"
    outer = depth > 1 ? kept[depth - 1] : ""
    if (outer == "") return
    if (tag == "member" && at != "" && name != "") print "field " outer "::" name " " at
    if (tag == "inheritance") print "base " outer " " at
    if (tag == "subprogram" && slot != "") print "virtual " outer "::" name " " slot
    if (tag == "enumerator" && (outer != "enum" || name ~ /^ACCESSVDB_/)) print "value " outer "::" name " " constant
  }
}
/^ *<[0-9a-f]+><[0-9a-f]+>: Abbrev Number: / {
  finish()
  tag = ""
  if ($0 !~ /DW_TAG_/) next  # the end of a list of children
  split($0, parts, /[<>]/)
  depth = index_of(parts[2])
  match($0, /DW_TAG_[a-z_]+/)
  tag = substr($0, RSTART + 7, RLENGTH - 7)
  name = size = at = slot = constant = ""
  declaration = 0
  next
}
function index_of(hex,   i, n) { n = 0; for (i = 1; i <= length(hex); ++i) n = n * 16 + index("0123456789abcdef", substr(hex, i, 1)) - 1; return n }
/ DW_AT_name / { name = value($0) }
/ DW_AT_byte_size / { size = value($0) }
/ DW_AT_data_member_location/ { at = value($0) }
/ DW_AT_data_bit_offset/ { at = "bit " value($0) }
/ DW_AT_const_value / { constant = value($0) }
/ DW_AT_declaration / { declaration = 1 }
/ DW_AT_vtable_elem_location/ { slot = value($0); sub(/.*DW_OP_constu: /, "", slot); sub(/\)$/, "", slot) }
END { finish() }
