// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// export --octomap in a program that was built without OctoMap.
#include "accessvdb/error.h"
#include "runs/octomap_file.h"

namespace accessvdb::tools {

void requireOctomap(const std::string& flag) {
  throw InvalidArgument("usage.no_octomap", flag, "this program was built without OctoMap",
                        "Install liboctomap-dev and build it again");
}

PreparedFile octomapFile(const std::filesystem::path&, const AccessibilityField&) {
  requireOctomap("--octomap");
  return {};
}

}  // namespace accessvdb::tools
