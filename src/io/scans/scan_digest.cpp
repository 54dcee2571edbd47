// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <cstdint>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/streams/sha256.h"

namespace accessvdb::io {

std::string sha256OfScans(const std::string& before, const ScanRecord& next) {
  internal::Sha256 sha256;
  const auto add = [&sha256](const auto& values) {
    const std::uint64_t count = values.size();
    sha256.update(&count, sizeof count);
    sha256.update(values.data(), count * sizeof values[0]);
  };
  add(before);
  add(next.points_S);
  add(next.points_W);
  add(next.origins_W);
  add(next.attributes);
  sha256.update(next.T_W_S.matrix().data(), sizeof(double) * 16);
  sha256.update(&next.stamp_s, sizeof next.stamp_s);
  return internal::hexOf(sha256.digest());
}

}  // namespace accessvdb::io
