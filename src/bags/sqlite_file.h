// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lets SQLite read from a ByteInput, and nothing else: no journals, no locks, no other files. Where the file ends
/// early, SQLite's own files read as zeros, which would become points; here that is an error.
#pragma once

#include <sqlite3.h>

#include <memory>
#include <string>

#include "bags/byte_input.h"

namespace accessvdb::bags {

/// Registered with SQLite under a name of its own for as long as it exists.
class SqliteFile {
 public:
  explicit SqliteFile(std::unique_ptr<ByteInput> input);
  ~SqliteFile();
  SqliteFile(const SqliteFile&) = delete;
  SqliteFile& operator=(const SqliteFile&) = delete;

  /// For sqlite3_open_v2.
  [[nodiscard]] const char* vfsName() const { return name_.c_str(); }
  /// Bytes that a file which was cut off lacks, by the count of pages in its header.
  [[nodiscard]] std::uint64_t missingBytes() const { return whole_bytes_ - input_->size(); }
  [[nodiscard]] std::uint64_t wholeBytes() const { return whole_bytes_; }
  [[nodiscard]] const ByteInput& input() const { return *input_; }

 private:
  std::unique_ptr<ByteInput> input_;
  std::uint64_t whole_bytes_;
  std::string name_;
  sqlite3_vfs vfs_ = {};
};

}  // namespace accessvdb::bags
