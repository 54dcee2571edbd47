// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the tests of the readers share: a temporary folder, expected errors, real data if available.
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "support/bytes.h"
#include "support/scratch_folder.h"

namespace accessvdb::io::test {

/// A folder that tests fill with files.
class TempFolder : public accessvdb::test::ScratchFolder {
 public:
  std::filesystem::path write(const std::filesystem::path& name, const std::string& bytes) const {
    const std::filesystem::path file = path() / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << bytes;
    return file;
  }
};

using ::accessvdb::test::put;

/// Runs it and expects an Error with this code and id that contains these words.
inline void expectError(const std::function<void()>& body, ErrorCode code, const std::string& id,
                        const std::vector<std::string>& words = {}) {
  try {
    body();
    ADD_FAILURE() << "no error, expected " << id;
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), code) << error.what();
    EXPECT_EQ(error.id(), id) << error.what();
    EXPECT_FALSE(error.advice().empty()) << error.what();
    for (const std::string& word : words)
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos)
          << "'" << word << "' is not in: " << error.what();
  }
}

inline bool anyContains(const std::vector<std::string>& lines, const std::string& words) {
  for (const std::string& line : lines)
    if (line.find(words) != std::string::npos) return true;
  return false;
}

inline std::filesystem::path dataFolder() {
  const char* const folder = std::getenv("ACCESSVDB_TEST_DATA");
  return folder != nullptr ? std::filesystem::path(folder)
                           : std::filesystem::path(ACCESSVDB_SOURCE_DIR) / ".." / "shared" / "data";
}

/// Skips the test if the file is absent.
#define ACCESSVDB_NEED_DATA(variable, name)                                          \
  const std::filesystem::path variable = accessvdb::io::test::dataFolder() / (name); \
  if (!std::filesystem::exists(variable)) GTEST_SKIP() << "missing test data: " << variable.string()

}  // namespace accessvdb::io::test
