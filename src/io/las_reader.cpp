// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// LAS 1.0 to 1.4, point formats 0 to 10: only the coordinates, in double precision. Variable length records, waveforms
/// and index files are ignored.
#include <array>
#include <cmath>

#include "accessvdb/error.h"
#include "io/input_file.h"
#include "io/point_cloud.h"
#include "io/scalar_type.h"

namespace accessvdb::io {
namespace {

constexpr std::uint64_t kHeaderBytes = 227;    ///< up to version 1.2
constexpr std::uint64_t kHeaderBytes14 = 375;  ///< version 1.4
/// Minimum bytes of a record, by point format.
constexpr std::array<std::uint16_t, 11> kFormatBytes = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};

struct LasHeader {
  std::uint64_t points = 0, data_offset = 0, record_bytes = 0;
  Eigen::Vector3d scale, offset, min, max;
};

[[noreturn]] void malformed(const std::string& subject, const std::string& problem) {
  throw InputError("input.malformed", subject, problem, "Check the file, for example with lasinfo");
}

LasHeader parseHeader(const std::string& file, const std::string& subject) {
  if (file.compare(0, 4, "LASF") != 0) malformed(subject, "is not a LAS file: it does not begin with LASF");
  const auto cut = [&](std::uint64_t needed) {
    throw InputError(
        "input.truncated", subject,
        "has " + std::to_string(file.size()) + " bytes, but its header alone needs " + std::to_string(needed),
        "Copy the file again");
  };
  if (file.size() < kHeaderBytes) cut(kHeaderBytes);
  const int major = loadScalar<std::uint8_t>(&file[24]), minor = loadScalar<std::uint8_t>(&file[25]);
  if (major != 1 || minor > 4)
    throw InputError("input.unsupported", subject,
                     "is LAS " + std::to_string(major) + "." + std::to_string(minor) + "; supported are 1.0 to 1.4",
                     "Convert it with las2las or pdal translate");
  const std::uint64_t header_bytes = loadScalar<std::uint16_t>(&file[94]);
  const int format = loadScalar<std::uint8_t>(&file[104]);
  LasHeader header;
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
    malformed(subject, "declares that a point of format " + std::to_string(format) + " takes " +
                           std::to_string(header.record_bytes) + " bytes, but it needs " +
                           std::to_string(kFormatBytes[format]));
  const std::uint64_t needed = minor == 4 ? kHeaderBytes14 : kHeaderBytes;
  if (header_bytes < needed || header.data_offset < header_bytes)
    malformed(subject, "has a header of " + std::to_string(header_bytes) + " bytes and points from byte " +
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
      malformed(subject, "has a scale or offset that is not a positive, finite number");
  }
  if (header.data_offset > file.size()) cut(header.data_offset);
  return header;
}

}  // namespace

PointCloud readLas(const std::filesystem::path& path, const ReadOptions& options) {
  const std::string file = readInputFile(path);
  const std::string subject = forMessage(path.native());
  const LasHeader header = parseHeader(file, subject);
  PointCloud cloud;
  const std::uint64_t points =
      recordsAvailable(subject, header.points, header.record_bytes, file.size() - header.data_offset,
                       options.allow_truncated, cloud.truncated_points);
  cloud.points.resize(points);
  std::uint64_t outside = 0;
  for (std::uint64_t i = 0; i < points; ++i) {
    const char* const record = file.data() + header.data_offset + i * header.record_bytes;
    bool inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      const double p = loadScalar<std::int32_t>(record + 4 * axis) * header.scale[axis] + header.offset[axis];
      cloud.points[i][axis] = p;
      // The box of the header is rounded to the grid of the coordinates: one step of slack.
      inside = inside && p >= header.min[axis] - header.scale[axis] && p <= header.max[axis] + header.scale[axis];
    }
    outside += inside ? 0 : 1;
  }
  if (outside != 0)
    cloud.notices.push_back(subject + ": " + std::to_string(outside) + " of " + std::to_string(points) +
                            " points are outside the header's bounding box; the file may be damaged");
  return cloud;
}

}  // namespace accessvdb::io
