// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether a device that fuses gets values back from the host so often that the host had better fuse.
#pragma once

#include <cstdint>

namespace accessvdb::internal {

class ReturningValues {
 public:
  /// So many scans in a row: a turn to where nobody was for long is no reason.
  static constexpr int kMostScans = 10;

  /// Call after each scan. A leaf that comes back costs about twice as much as one that the host fuses.
  /// @param read  leaves that came back for it  @param touched  by it
  void note(std::uint64_t read, std::uint64_t touched) { scans_ = 2 * read > touched ? scans_ + 1 : 0; }
  [[nodiscard]] bool areTooMany() const { return scans_ >= kMostScans; }

 private:
  int scans_ = 0;
};

}  // namespace accessvdb::internal
