// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `outputs` in report.json: the files of a folder with their hashes, which whoever reads them compares.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace accessvdb::tools {

/// One file in the folder of the report.
struct OutputEntry {
  std::string name;
  std::uint64_t bytes = 0;
  std::string sha256_of_blocks;
};
using OutputEntries = std::vector<OutputEntry>;

/// Hashes files of a folder right after they were written, while the system still has them in memory.
void addOutputs(OutputEntries& outputs, const std::filesystem::path& folder, const std::vector<std::string>& names);

/// `outputs`, with what the folder's report.json says of files that are still there and were not written again.
[[nodiscard]] OutputEntries withEarlier(OutputEntries outputs, const std::filesystem::path& folder);

[[nodiscard]] nlohmann::ordered_json jsonOf(const OutputEntries& outputs);

/// After a file was written by itself: its entry, if it lies in the folder and report.json there has entries.
/// @throws OutputError
void recordOutput(const std::filesystem::path& folder, const std::filesystem::path& file);

/// The name of a file that lies in the folder itself, by whatever spelling; else empty.
[[nodiscard]] std::string nameInFolder(const std::filesystem::path& folder, const std::filesystem::path& file);

}  // namespace accessvdb::tools
