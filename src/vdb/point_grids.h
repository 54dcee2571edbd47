// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The same as standard_grids.h for OpenVDB's grids of points.
#pragma once

#include <openvdb/points/PointDataGrid.h>
#include <openvdb/tools/PointIndexGrid.h>

#include "vdb/standard_grids.h"

#if defined(ACCESSVDB_GRIDS_IN_LIBOPENVDB)
extern template class openvdb::tree::Tree<openvdb::points::PointDataTree::RootNodeType>;
extern template class openvdb::tree::Tree<openvdb::tools::PointIndexTree::RootNodeType>;
extern template class openvdb::Grid<openvdb::points::PointDataGrid::TreeType>;
extern template class openvdb::Grid<openvdb::tools::PointIndexGrid::TreeType>;
#endif
