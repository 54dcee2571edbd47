// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Results are held against the hashes that were written with them, when they are read: a file that has changed since,
/// on a bad disk or by another program, must not say "accessible". docs/file_formats.md, "report.json", has the rule.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb::io {

/// SHA-256 of the SHA-256 digests of a file's blocks of 1 MiB, one after the other; lower-case hexadecimal. Its blocks
/// are read in parallel. @throws InputError
[[nodiscard]] ACCESSVDB_API std::string sha256OfBlocks(const std::filesystem::path& file);

/// Hashes files in the background while they are read. Serves one thread.
class ACCESSVDB_API OutputCheck {
 public:
  /// @param allow_changed  go on with files that have changed, with a warning
  explicit OutputCheck(bool allow_changed = false);
  ~OutputCheck();
  OutputCheck(const OutputCheck&) = delete;
  OutputCheck& operator=(const OutputCheck&) = delete;

  /// Begins with files of a folder of results, by its report.json, or by the tile.json of a tile alone. Each is hashed
  /// once. Files that are not there are left to their readers, and so are those of folders without hashes: older ones,
  /// and those that AccessibilityField::write() has filled.
  void begin(const std::filesystem::path& folder, const std::vector<std::string>& names);
  /// The same with one file of which the hash is known. @param sha256  of the whole; empty: there is none
  /// @param record  the file that says so  @param advice  what to do if it has changed
  void begin(const std::filesystem::path& file, const std::string& sha256, const std::string& record,
             const std::string& advice);
  /// Waits for all that were begun. @throws InputError "output.changed" for the first that has changed, unless allowed
  void finish();

  /// Of finish(): ids and texts of what is doubtful, and in words what was read without hashes.
  [[nodiscard]] const std::vector<std::pair<std::string, std::string>>& warnings() const;
  [[nodiscard]] const std::vector<std::string>& notices() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Reads while the hashes of what is read are made. A file that has changed is called that, whatever its reader says.
/// @throws as finish() and `read`
template <typename Read>
auto readChecked(OutputCheck& check, const Read& read) {
  try {
    auto result = read();
    check.finish();
    return result;
  } catch (...) {
    check.finish();  // has nothing left to say if it was itself what failed
    throw;
  }
}

}  // namespace accessvdb::io
