// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What tests ask NanoVDB itself, by the names of its release.
#pragma once

#define NANOVDB_USE_OPENVDB
#include <nanovdb/NanoVDB.h>
#include <openvdb/openvdb.h>
#if NANOVDB_MINOR_VERSION_NUMBER >= 7
#include <nanovdb/tools/CreateNanoGrid.h>
#include <nanovdb/tools/GridValidator.h>
#else
#include <nanovdb/util/GridValidator.h>
#include <nanovdb/util/OpenToNanoVDB.h>
#endif
#include <array>
#include <string>

namespace accessvdb::testing {

/// @return a handle with NanoVDB's own conversion of an OpenVDB grid
template <class Grid>
auto convertedByNanoVdb(Grid& grid) {
#if NANOVDB_MINOR_VERSION_NUMBER >= 7
  return nanovdb::tools::createNanoGrid(grid);
#else
  return nanovdb::openToNanoVDB(grid);
#endif
}

/// @return what NanoVDB's own validator finds wrong, or nothing. Since 32.7 the full check wants each level of nodes in
///   one piece, also in grids that do not say so, as the mirror's do not; there the header and the root are checked.
template <class Build>
std::string problemByNanoVdb(const nanovdb::NanoGrid<Build>& grid) {
#if NANOVDB_MINOR_VERSION_NUMBER >= 7
  std::array<char, 1024> problem = {};
  nanovdb::tools::checkGrid(&grid, problem.data(), nanovdb::CheckMode::Half);
  return problem.data();
#else
  return nanovdb::GridValidator<Build>::check(grid, true);
#endif
}

}  // namespace accessvdb::testing
