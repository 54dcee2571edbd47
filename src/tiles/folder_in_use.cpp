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
  // Of a process that was killed in its first moment.
  const auto isOurs = [](const fs::directory_entry& entry) {
    const std::string name = entry.path().filename().string();
    return entry.is_regular_file() && name.starts_with(".rolling.json.") && name.ends_with(".tmp");
  };
  if (fs::is_directory(folder) && std::ranges::all_of(fs::directory_iterator(folder), isOurs)) return;
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
