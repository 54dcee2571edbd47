// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// OpenVDB with the grid types that libopenvdb.so itself holds compiled. A file that includes this instead of
/// <openvdb/openvdb.h> does not compile their trees once more: that is some 600 functions per type, and most of the
/// time that such a file takes. Inline functions are still inlined; no value changes.
///
/// ACCESSVDB_GRIDS_IN_LIBOPENVDB is set by cmake/accessvdb_dependencies.cmake where the library is known to export
/// them; elsewhere this is plain OpenVDB. Only Grid and Tree are named: nodes have members that libopenvdb.so lacks.
#pragma once

#include <openvdb/openvdb.h>

#if defined(ACCESSVDB_GRIDS_IN_LIBOPENVDB)
extern template class openvdb::tree::Tree<openvdb::FloatTree::RootNodeType>;
extern template class openvdb::tree::Tree<openvdb::BoolTree::RootNodeType>;
extern template class openvdb::tree::Tree<openvdb::Vec3STree::RootNodeType>;
extern template class openvdb::Grid<openvdb::FloatTree>;
extern template class openvdb::Grid<openvdb::BoolTree>;
extern template class openvdb::Grid<openvdb::Vec3STree>;
#endif
