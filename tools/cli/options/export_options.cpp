// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/export_options.h"

#include <charconv>
#include <cstdio>

#include "accessvdb/error.h"

namespace accessvdb::tools {
namespace {

constexpr std::string_view kPrefix = "field_", kSuffix = ".vdb";
constexpr std::size_t kMinDigits = 4;

}  // namespace

void addExportOptions(FlagParser& flags, ExportOptions& options) {
  flags.flag("--half", options.half, "16-bit floats in the .vdb files (score and weight keep 32 bits)");
  flags.option("--compression", &options.compression, "compression of the .vdb files: auto, blosc, zip or none");
  flags.option("--up-axis", &options.up_axis, "up axis of the .vdb files: z, or y for Houdini; points.ply stays z up");
  flags.flag("--surface", options.surface, "add `surface`, a level set of the scanned surface, to field.vdb");
  flags.option("--points-format", &options.points_format,
               "ply, or las for points.las (LAS 1.4) beside points.ply: QGIS, CloudCompare, lidR");
  flags.option("--sequence", &options.sequence,
               "also write field_0001.vdb, field_0002.vdb, ... while the map grows, one per n scans; 0 = none");
}

io::WriteOptions writeOptions(const ExportOptions& options) {
  io::WriteOptions write;
  write.half_float = options.half;
  write.surface = options.surface;
  if (options.compression == "blosc") {
    write.compression = io::Compression::Blosc;
  } else if (options.compression == "zip") {
    write.compression = io::Compression::Zip;
  } else if (options.compression == "none") {
    write.compression = io::Compression::None;
  } else if (options.compression != "auto") {
    throw InvalidArgument("usage.word", "--compression", "\"" + options.compression + "\" is not known",
                          "Use one of auto, blosc, zip, none");
  }
  if (options.up_axis == "y") {
    write.up_axis = io::UpAxis::Y;
  } else if (options.up_axis != "z") {
    throw InvalidArgument("usage.word", "--up-axis", "\"" + options.up_axis + "\" is not known", "Use one of z, y");
  }
  if (options.points_format != "ply" && options.points_format != "las") {
    throw InvalidArgument("usage.word", "--points-format", "\"" + options.points_format + "\" is not known",
                          "Use one of ply, las");
  }
  write.points_las = options.points_format == "las";
  if (options.sequence < 0) throw InvalidArgument("usage.sequence", "--sequence", "cannot be negative");
  io::checkWriteOptions(write);
  return write;
}

std::string savingOfHalf(std::uint64_t bytes, std::uint64_t full_bytes) {
  const auto mib = [](std::uint64_t size) { return static_cast<double>(size) / (1 << 20); };
  const double share = full_bytes == 0 ? 0 : 1 - static_cast<double>(bytes) / static_cast<double>(full_bytes);
  char text[128];
  std::snprintf(text, sizeof text, "field.vdb with 16-bit floats has %.1f MiB, %.1f %% less than the %.1f MiB without",
                mib(bytes), 100 * share, mib(full_bytes));
  return text;
}

std::vector<std::string> fieldFilesOf(const ExportOptions& options) {
  std::vector<std::string> names = {"field.vdb", "field_points.vdb", "points.ply"};
  if (options.points_format == "las") names.emplace_back("points.las");
  return names;
}

std::string frameName(std::uint64_t frame) {
  std::string digits = std::to_string(frame);
  if (digits.size() < kMinDigits) digits.insert(0, kMinDigits - digits.size(), '0');
  return std::string(kPrefix) + digits + std::string(kSuffix);
}

std::uint64_t lastFrameIn(const std::filesystem::path& folder) {
  std::uint64_t last = 0;
  std::error_code status;
  for (const auto& entry : std::filesystem::directory_iterator(folder, status)) {
    const std::string name = entry.path().filename().string();
    if (name.size() < kPrefix.size() + kMinDigits + kSuffix.size() || !name.starts_with(kPrefix) ||
        !name.ends_with(kSuffix)) {
      continue;
    }
    std::uint64_t frame = 0;
    const char* end = name.data() + name.size() - kSuffix.size();
    const auto parsed = std::from_chars(name.data() + kPrefix.size(), end, frame);
    if (parsed.ec == std::errc() && parsed.ptr == end) last = std::max(last, frame);
  }
  return last;
}

}  // namespace accessvdb::tools
