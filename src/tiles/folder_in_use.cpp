// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/folder_in_use.h"

#include <mutex>
#include <set>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

struct InUse {
  std::mutex lock;
  std::set<fs::path> folders;
};
InUse& inUse() {
  static InUse all;
  return all;
}

}  // namespace

void FolderInUse::requireEmpty(const fs::path& folder) {
  if (!io::isThere(folder, ErrorCode::Output)) return;
  if (fs::is_directory(folder) && fs::is_empty(folder)) return;
  throw OutputError("output.foreign", folder.string(), "is not an empty folder", "Choose another one");
}

FolderInUse::FolderInUse(const fs::path& folder) : folder_(fs::canonical(folder)) {
  const std::scoped_lock locked(inUse().lock);
  if (inUse().folders.insert(folder_).second) return;
  folder_.clear();
  throw OutputError("output.locked", folder.string(), "is the folder of another field of this program",
                    "Wait for its end, or choose another folder");
}

FolderInUse::FolderInUse(FolderInUse&& other) noexcept : folder_(std::exchange(other.folder_, fs::path())) {}

FolderInUse& FolderInUse::operator=(FolderInUse&& other) noexcept {
  std::swap(folder_, other.folder_);
  return *this;
}

FolderInUse::~FolderInUse() {
  if (folder_.empty()) return;
  const std::scoped_lock locked(inUse().lock);
  inUse().folders.erase(folder_);
}

}  // namespace accessvdb::tiles
