// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Option texts turned into values with units, and the tool and picture flags shared by several verbs.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/render.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tool_geometry.h"
#include "options/flag_parser.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// "X,Y,Z". @throws InvalidArgument naming the flag
[[nodiscard]] Eigen::Vector3d parseVector(const std::string& flag, const std::string& text);
/// Finite numbers with commas between them. @param counts  how many there may be  @param form  for messages
/// @throws InvalidArgument naming the flag
[[nodiscard]] std::vector<double> parseNumbers(const std::string& flag, const std::string& text,
                                               std::initializer_list<std::size_t> counts, const std::string& form);
/// "X,Y,Z", or an axis: "x", "+x", "-x", "y" ... @throws InvalidArgument naming the flag
[[nodiscard]] Eigen::Vector3d parseDirection(const std::string& flag, const std::string& text);
/// "0.1" in metres, or "4v" in voxels. @throws InvalidArgument naming the flag
[[nodiscard]] double parseLength_m(const std::string& flag, const std::string& text, double voxel_size_m);
/// "500000", "500k", "500M", "2G", "1T" bytes, powers of 1024. @throws InvalidArgument naming the flag
[[nodiscard]] std::uint64_t parseBytes(const std::string& flag, const std::string& text);
/// "2.4 GiB"
[[nodiscard]] std::string bytesInWords(double bytes);
/// Shortest text that reads back as nearly the same number (six digits).
[[nodiscard]] std::string numberText(double value);

struct ToolOptions {
  std::string tool, unit, tip, axis, up;
};
void addToolOptions(FlagParser& flags, ToolOptions& options);
/// @throws what ToolGeometry::fromMesh throws; InvalidArgument for a bad flag
[[nodiscard]] ToolGeometry loadTool(const ToolOptions& options);
/// Its repairs as notices; what looks like a wrong tip or axis as warnings.
void sayToolNotes(const ToolGeometry& tool, Messages& messages);
/// Size and pose of a tool in one line.
[[nodiscard]] std::string toolInWords(const ToolGeometry& tool, const ToolOptions& options);

/// How scans and poses were read and matched, and what is likely wrong with them.
void sayAboutScans(const io::ScanSequence& scans, Messages& messages);
/// What only reading showed, once the scans have been read.
void sayAboutReading(const io::ScanSequence& scans, Messages& messages);

struct PictureOptions {
  std::string view = "iso", colour = "label";
  int width_px = 1600, height_px = 1000;
};
void addPictureOptions(FlagParser& flags, PictureOptions& options);
/// @throws InvalidArgument
[[nodiscard]] io::RenderOptions renderOptions(const PictureOptions& options);

}  // namespace accessvdb::tools
