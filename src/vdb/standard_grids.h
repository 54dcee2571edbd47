// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// OpenVDB with the grid types that are compiled in libopenvdb.so. A file that includes this instead of
/// <openvdb/openvdb.h> does not compile their trees again, about 600 functions per type and most of such a file's
/// compile time. Inline functions are still inlined; no value changes.
///
/// ACCESSVDB_GRIDS_IN_LIBOPENVDB is set by cmake/accessvdb_dependencies.cmake if the library is known to export
/// them; elsewhere this is plain OpenVDB. Only Grid and Tree are named: nodes have members that libopenvdb.so lacks.
#pragma once

#include <openvdb/openvdb.h>

#if defined(ACCESSVDB_GRIDS_IN_LIBOPENVDB)
extern template class openvdb::tree::Tree<openvdb::FloatTree::RootNodeType>;
extern template class openvdb::tree::Tree<openvdb::BoolTree::RootNodeType>;
extern template class openvdb::tree::Tree<openvdb::Int32Tree::RootNodeType>;
extern template class openvdb::tree::Tree<openvdb::Vec3STree::RootNodeType>;
extern template class openvdb::Grid<openvdb::FloatTree>;
extern template class openvdb::Grid<openvdb::BoolTree>;
extern template class openvdb::Grid<openvdb::Int32Tree>;
extern template class openvdb::Grid<openvdb::Vec3STree>;
#endif
