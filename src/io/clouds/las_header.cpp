// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/las_header.h"

#include <array>
#include <cmath>

#include "accessvdb/error.h"
#include "io/clouds/scalar_type.h"

namespace accessvdb::io {
namespace {

constexpr std::uint64_t kHeaderBytes = 227;  ///< up to version 1.2
/// Minimum bytes of a record, by point format.
constexpr std::array<std::uint16_t, 11> kFormatBytes = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};

[[noreturn]] void malformedLas(const std::string& subject, const std::string& problem) {
  throw InputError("input.malformed", subject, problem, "Check the file, for example with lasinfo");
}

/// A list of records, each with a header that says how long it is.
struct LasRecordList {
  std::uint64_t begin = 0, count = 0, end = 0;
  bool extended = false;  ///< behind the points: with lengths of 64 bits
};

/// Takes what is of the projection. Records that are too long for it are passed over.
void takeProjection(ByteSource& file, const LasRecordList& list, LasProjection& to) {
  constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 20;
  const std::uint64_t head_bytes = list.extended ? 60 : 54;
  std::uint64_t at = list.begin;
  if (list.begin > list.end) return void(to.cut_off = true);
  for (std::uint64_t i = 0; i < list.count; ++i) {
    const std::string_view head = file.view(at, static_cast<std::size_t>(head_bytes));
    if (head.size() < head_bytes || list.end - at < head_bytes) return void(to.cut_off = true);
    const std::string_view user =
        head.substr(2, 16).substr(0, head.substr(2, 16).find_last_not_of(std::string_view("\0 ", 2)) + 1);
    // WKT of before LAS 1.4, which writers with libLAS still have.
    const bool liblas = user == "liblas";
    const int id = loadScalar<std::uint16_t>(&head[18]);
    const std::uint64_t bytes =
        list.extended ? loadScalar<std::uint64_t>(&head[20]) : loadScalar<std::uint16_t>(&head[20]);
    at += head_bytes;
    if (bytes > list.end - at) return void(to.cut_off = true);
    const bool extra = user == "LASF_Spec" && id == 4;
    std::optional<std::string>* const wanted = extra ? &to.extra_bytes
                                               : !(user == "LASF_Projection" || (liblas && id == 2112)) ? nullptr
                                               : id == 34735                                            ? &to.geo_keys
                                               : id == 34736 ? &to.geo_doubles
                                               : id == 34737 ? &to.geo_texts
                                               : id == 2112  ? &to.wkt
                                                             : nullptr;
    if (wanted != nullptr && bytes <= kMostBytes) {
      const std::string_view body = file.view(at, static_cast<std::size_t>(bytes));
      if (body.size() < bytes) return void(to.cut_off = true);
      const std::string_view own = body.substr(0, static_cast<std::size_t>(bytes));
      to.repeated = to.repeated || (*wanted && !extra && **wanted != own);
      if (!*wanted) *wanted = own;
    }
    at += bytes;
  }
}

}  // namespace

std::uint64_t lasFormatBytes(int format) { return kFormatBytes[static_cast<std::size_t>(format)]; }

std::uint64_t lasTimeOffset(int format) {
  constexpr std::array<std::uint8_t, 11> kTimeOffset = {0, 20, 0, 20, 20, 20, 22, 22, 22, 22, 22};
  return kTimeOffset[static_cast<std::size_t>(format)];
}

void refuseCutHeader(const std::string& subject, std::uint64_t bytes, std::uint64_t needed) {
  throw InputError("input.truncated", subject,
                   "has " + std::to_string(bytes) + " bytes, but its header alone needs " + std::to_string(needed),
                   "Copy the file again");
}

LasFileHeader parseLasHeader(std::string_view file, std::optional<std::uint64_t> size, const std::string& subject) {
  if (file.substr(0, 4) != "LASF") malformedLas(subject, "is not a LAS file: it does not begin with LASF");
  const auto cut = [&](std::uint64_t needed) { refuseCutHeader(subject, size.value_or(file.size()), needed); };
  if (file.size() < kHeaderBytes) cut(kHeaderBytes);
  const int major = loadScalar<std::uint8_t>(&file[24]), minor = loadScalar<std::uint8_t>(&file[25]);
  if (major != 1 || minor > 4)
    throw InputError("input.unsupported", subject,
                     "is LAS " + std::to_string(major) + "." + std::to_string(minor) + "; supported are 1.0 to 1.4",
                     "Convert it with las2las or pdal translate");
  const std::uint64_t header_bytes = loadScalar<std::uint16_t>(&file[94]);
  const int format = loadScalar<std::uint8_t>(&file[104]);
  LasFileHeader header;
  header.format = format;
  header.adjusted_gps_time = (loadScalar<std::uint16_t>(&file[6]) & 1) != 0;
  header.day = loadScalar<std::uint16_t>(&file[90]);
  header.year = loadScalar<std::uint16_t>(&file[92]);
  header.data_offset = loadScalar<std::uint32_t>(&file[96]);
  header.record_bytes = loadScalar<std::uint16_t>(&file[105]);
  header.points = loadScalar<std::uint32_t>(&file[107]);
  if ((format & 0xc0) != 0)
    throw InputError("input.unsupported", subject, "contains compressed points (LAZ)",
                     "Convert it: laszip -i IN.laz -o OUT.las, or pdal translate IN.laz OUT.las");
  if (format > 10)
    throw InputError("input.unsupported", subject,
                     "has point format " + std::to_string(format) + "; supported are 0 to 10",
                     "Convert it with las2las or pdal translate");
  if (header.record_bytes < kFormatBytes[format])
    malformedLas(subject, "declares that a point of format " + std::to_string(format) + " takes " +
                              std::to_string(header.record_bytes) + " bytes, but it needs " +
                              std::to_string(kFormatBytes[format]));
  const std::uint64_t needed = minor == 4 ? kLasHeaderBytes14 : kHeaderBytes;
  if (header_bytes < needed || header.data_offset < header_bytes)
    malformedLas(subject, "has a header of " + std::to_string(header_bytes) + " bytes and points from byte " +
                              std::to_string(header.data_offset) + ", which is impossible");
  if (file.size() < needed) cut(needed);
  if (minor == 4) {
    // Writers of 1.4 may fill only the old 32-bit count.
    const auto points = loadScalar<std::uint64_t>(&file[247]);
    if (points != 0) header.points = points;
  }
  for (int axis = 0; axis < 3; ++axis) {
    header.scale[axis] = loadScalar<double>(&file[131 + 8 * axis]);
    header.offset[axis] = loadScalar<double>(&file[155 + 8 * axis]);
    header.max[axis] = loadScalar<double>(&file[179 + 16 * axis]);
    header.min[axis] = loadScalar<double>(&file[187 + 16 * axis]);
    if (!(header.scale[axis] > 0 && std::isfinite(header.scale[axis])) || !std::isfinite(header.offset[axis]))
      malformedLas(subject, "has a scale or offset that is not a positive, finite number");
  }
  if (size && header.data_offset > *size) cut(header.data_offset);
  return header;
}

LasProjection readLasProjection(ByteSource& file) {
  LasProjection projection;
  const std::string header(file.view(0, kLasHeaderBytes14).substr(0, kLasHeaderBytes14));
  if (header.size() < kHeaderBytes || header.substr(0, 4) != "LASF") return projection;
  projection.wkt_counts = (loadScalar<std::uint16_t>(&header[6]) & 16) != 0;
  const std::uint64_t begin = loadScalar<std::uint16_t>(&header[94]), points = loadScalar<std::uint32_t>(&header[96]);
  takeProjection(file, {begin, loadScalar<std::uint32_t>(&header[100]), points, false}, projection);
  // What is behind the points of a pipe is not waited for.
  if (header[25] != 4 || header.size() < kLasHeaderBytes14 || !file.size()) return projection;
  const auto extended = loadScalar<std::uint64_t>(&header[235]);
  const auto count = loadScalar<std::uint32_t>(&header[243]);
  if (extended >= points && extended <= *file.size()) {
    takeProjection(file, {extended, count, *file.size(), true}, projection);
  } else if (count > 0) {
    projection.cut_off = true;
  }
  return projection;
}

}  // namespace accessvdb::io
