// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags of `map` for writing .vdb files, and the frames of a sequence.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/field_export.h"
#include "options/flag_parser.h"

namespace accessvdb::tools {

struct ExportOptions {
  bool half = false, surface = false;
  std::string compression = "auto", up_axis = "z", points_format = "ply";
  int sequence = 0;  ///< scans per frame; 0 = no sequence
};

void addExportOptions(FlagParser& flags, ExportOptions& options);

/// @throws InvalidArgument for an unknown word, or a codec that is not available
[[nodiscard]] io::WriteOptions writeOptions(const ExportOptions& options);

/// How much smaller field.vdb is than with 32-bit floats, in words.
[[nodiscard]] std::string savingOfHalf(std::uint64_t bytes, std::uint64_t full_bytes);

/// Names of the files that writeField() makes with these options.
[[nodiscard]] std::vector<std::string> fieldFilesOf(const ExportOptions& options);

/// field_0001.vdb for frame 1; more digits from frame 10000 on.
[[nodiscard]] std::string frameName(std::uint64_t frame);

/// Number of the last file in the folder with a frame's name; 0 = none.
[[nodiscard]] std::uint64_t lastFrameIn(const std::filesystem::path& folder);

}  // namespace accessvdb::tools
