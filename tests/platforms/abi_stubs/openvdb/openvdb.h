// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// In OpenVDB's place where only layouts are asked for: the public headers name its types in pointers and references
/// only, and a member by value would not compile here. It saves most of the compiler's time.
#pragma once

#include <memory>

namespace openvdb {

struct Coord;
struct CoordBBox;
struct FloatGrid {
  using Ptr = std::shared_ptr<FloatGrid>;
};
struct BoolGrid {
  using Ptr = std::shared_ptr<BoolGrid>;
};

}  // namespace openvdb
