// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "inputs/cloud_files.h"

#include <array>
#include <cmath>
#include <limits>

namespace accessvdb::inputs_test {
namespace {

constexpr double kFirstTime_s = 1e7;
constexpr double kStep_s = 0.1;

std::vector<std::array<Eigen::Vector3d, 3>> boxFaces() {
  const auto corner = [](int n) {
    return Eigen::Vector3d(n & 1 ? 0.6 : 0, n & 2 ? 0.03 : -0.03, n & 4 ? 0.03 : -0.03);
  };
  std::vector<std::array<Eigen::Vector3d, 3>> faces;
  for (const auto& f : {std::array{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
    faces.push_back({corner(f[0]), corner(f[1]), corner(f[2])});
    faces.push_back({corner(f[0]), corner(f[2]), corner(f[3])});
  }
  return faces;
}

}  // namespace

std::string LasFile::bytes(const std::vector<LasReturn>& returns) const {
  const bool modern = format >= 6;
  const std::uint16_t header_bytes = modern ? 375 : 227;
  constexpr std::uint16_t kRecordBytes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
  std::string records;
  for (const auto& [id, content] : projection) {
    std::string name = user;
    name.resize(16, '\0');
    put(records, std::uint16_t{0});
    records += name;
    put(records, static_cast<std::uint16_t>(id));
    if (extended) {
      put(records, std::uint64_t{content.size()});
    } else {
      put(records, static_cast<std::uint16_t>(content.size()));
    }
    records.append(32, '\0');
    records += content;
  }
  const auto count = static_cast<std::uint32_t>(projection.size());
  const std::uint32_t data = header_bytes + (extended ? 0 : static_cast<std::uint32_t>(records.size()));
  std::string file("LASF", 4);
  put(file, std::uint16_t{0});
  put(file, global_encoding);
  file.resize(24, '\0');
  file += '\1';
  file += static_cast<char>(modern ? 4 : 2);
  file.resize(94, '\0');
  put(file, header_bytes);
  put(file, data);
  put(file, extended ? 0U : count);
  file += static_cast<char>(format);
  put(file, kRecordBytes[format]);
  put(file, modern ? 0U : static_cast<std::uint32_t>(returns.size()));
  file.resize(131, '\0');
  for (const double one : {scale, scale, z_scale}) put(file, one);
  file.resize(179, '\0');
  for (int axis = 0; axis < 3; ++axis) {
    double low = std::numeric_limits<double>::max(), high = -low;
    for (const LasReturn& one : returns) low = std::min(low, one.p[axis]), high = std::max(high, one.p[axis]);
    put(file, high);
    put(file, low);
  }
  if (modern) {
    put(file, std::uint64_t{0});
    put(file, std::uint64_t{extended ? data + returns.size() * kRecordBytes[format] : 0});
    put(file, extended ? count : 0U);
    put(file, std::uint64_t{returns.size()});
  }
  file.resize(header_bytes, '\0');
  if (!extended) file += records;
  for (const LasReturn& one : returns) {
    const std::size_t begin = file.size();
    for (int axis = 0; axis < 3; ++axis)
      put(file, static_cast<std::int32_t>(std::lround(one.p[axis] / (axis == 2 ? z_scale : scale))));
    file.resize(begin + kRecordBytes[format], '\0');
    file[begin + 14] = 0x11;
    if (modern) {
      file[begin + 15] = static_cast<char>(one.flags);
      file[begin + 16] = static_cast<char>(one.point_class);
    } else {
      file[begin + 15] = static_cast<char>(one.flags << 5 | one.point_class);
    }
    if (format != 0 && format != 2) std::memcpy(&file[begin + (modern ? 22 : 20)], &one.time, sizeof one.time);
  }
  return extended ? file + records : file;
}

std::string geoKeys(const std::vector<std::pair<int, int>>& values) {
  std::string bytes;
  for (const int head : {1, 1, 0, static_cast<int>(values.size())}) put(bytes, static_cast<std::uint16_t>(head));
  for (const auto& [key, value] : values)
    for (const int number : {key, 0, 1, value}) put(bytes, static_cast<std::uint16_t>(number));
  return bytes;
}

std::vector<LasReturn> walkReturns(const std::vector<WorldScan>& scans, double unit_m) {
  std::vector<LasReturn> returns;
  for (std::size_t i = 0; i < scans.size(); ++i)
    for (const Eigen::Vector3d& p_W : scans[i].points_W)
      returns.push_back({p_W / unit_m, kFirstTime_s + kStep_s * static_cast<double>(i)});
  return returns;
}

std::string walkLines(const std::vector<WorldScan>& scans, double unit_m) {
  std::string lines;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const Eigen::Vector3d p = scans[i].T_W_S.translation() / unit_m;
    lines += decimals(kFirstTime_s + kStep_s * static_cast<double>(i));
    for (int axis = 0; axis < 3; ++axis) lines += " " + decimals(p[axis]);
    lines += "\n";
  }
  return lines;
}

std::string boxStl(const std::string& header) {
  std::string bytes = header;
  bytes.resize(80, ' ');
  put(bytes, std::uint32_t{12});
  for (const auto& face : boxFaces()) {
    bytes.append(12, '\0');
    for (const Eigen::Vector3d& corner : face)
      for (int axis = 0; axis < 3; ++axis) put(bytes, static_cast<float>(corner[axis]));
    bytes.append(2, '\0');
  }
  return bytes;
}

std::string boxStlText(const std::string& line_end) {
  std::string text = "solid part" + line_end;
  for (const auto& face : boxFaces()) {
    text += "  facet normal 0 0 0" + line_end + "    outer loop" + line_end;
    for (const Eigen::Vector3d& corner : face)
      text +=
          "      vertex " + decimals(corner.x()) + " " + decimals(corner.y()) + " " + decimals(corner.z()) + line_end;
    text += "    endloop" + line_end + "  endfacet" + line_end;
  }
  return text + "endsolid part" + line_end;
}

}  // namespace accessvdb::inputs_test
