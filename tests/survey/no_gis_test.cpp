// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A program without GDAL says so in one line.
#include <gtest/gtest.h>

#include <string>

#include "accessvdb/error.h"
#include "runs/gis_files.h"

namespace accessvdb::tools {
namespace {

template <typename Call>
std::string refusalOf(const Call& call) {
  try {
    call();
  } catch (const InvalidArgument& error) {
    return error.id() + " " + error.what();
  }
  return "none";
}

TEST(NoGis, IsSaid) {
  for (const std::string& said :
       {refusalOf([] { requireGis("--raster"); }), refusalOf([] { (void)shareRaster("a.tif", {}, {}, 1); })}) {
    EXPECT_EQ(said.rfind("usage.no_gdal", 0), 0U) << said;
    EXPECT_NE(said.find("--raster"), std::string::npos) << said;
    EXPECT_NE(said.find("libgdal-dev"), std::string::npos) << said;
    EXPECT_EQ(said.find('\n'), std::string::npos) << said;
  }
  EXPECT_NE(refusalOf([] { (void)targetLayer("a.gpkg", {}, {}); }).find("--vector"), std::string::npos);
}

}  // namespace
}  // namespace accessvdb::tools
