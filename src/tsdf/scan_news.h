// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which returns of a scan are news (new_things.h).
#pragma once

#include <span>

#include "tsdf/packed_map.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {

/// Sets ReturnRay::news by what the map holds now, which has to be what it held before the scan: whether a return is
/// news must not depend on which returns of the same scan were fused already.
void markNews(const PackedMap& map, std::span<ReturnRay> rays);

}  // namespace accessvdb::internal
