// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/scan_file.h"

#include <array>
#include <bit>
#include <cstring>
#include <fstream>
#include <ostream>
#include <sstream>
#include <type_traits>

#include "accessvdb/field_io.h"

static_assert(std::endian::native == std::endian::little, "scan files are little-endian");

namespace accessvdb::eval {
namespace {

/// Incremented whenever the layout of the file changes.
constexpr const char* kMagic = "accessvdb scans 1\n";

/// 64-bit FNV-1a (public domain).
class Hash {
 public:
  void add(const void* data, std::size_t bytes) {
    for (const auto* p = static_cast<const unsigned char*>(data); bytes > 0; --bytes, ++p) {
      value_ = (value_ ^ *p) * 0x100000001b3u;
    }
  }
  template <typename T>
  void add(const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    add(&value, sizeof value);
  }
  [[nodiscard]] std::string text() const {
    std::ostringstream out;
    out << std::hex << value_;
    return out.str();
  }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325u;
};

/// Pose as 12 numbers, row by row.
std::array<double, 12> numbers(const Eigen::Isometry3d& pose) {
  std::array<double, 12> out;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) out[static_cast<std::size_t>(4 * row + column)] = pose(row, column);
  }
  return out;
}

template <typename T>
void put(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Takes values from the front of a buffer; past its end, it returns zeros and sets a flag.
class Taker {
 public:
  explicit Taker(const std::string& bytes, std::size_t begin) : bytes_(bytes), at_(begin) {}

  template <typename T>
  T take() {
    T value{};
    if (fits(sizeof value)) {
      std::memcpy(&value, bytes_.data() + at_, sizeof value);
      at_ += sizeof value;
    }
    return value;
  }
  bool fits(std::size_t bytes) {
    if (bytes > bytes_.size() - at_) short_ = true;
    return !short_;
  }
  [[nodiscard]] bool ranShort() const { return short_; }
  [[nodiscard]] bool atEnd() const { return at_ == bytes_.size(); }

 private:
  const std::string& bytes_;
  std::size_t at_;
  bool short_ = false;
};

std::string checksum(const char* data, std::size_t bytes) {
  Hash hash;
  hash.add(data, bytes);
  std::string text = hash.text();
  return std::string(16 - text.size(), '0') + text;
}

}  // namespace

std::string fingerprintOf(const sim::BenchmarkScene& benchmark, const sim::LidarModel& model, std::uint64_t seed) {
  Hash mesh, path;
  for (const Eigen::Vector3f& v : benchmark.scene.mesh.vertices_W) mesh.add(v.data(), 3 * sizeof(float));
  for (const auto& triangle : benchmark.scene.mesh.triangles) mesh.add(triangle.data(), sizeof triangle);
  for (const Eigen::Isometry3d& pose : benchmark.trajectory) {
    for (const double number : numbers(pose)) path.add(number);
  }
  std::ostringstream text;
  text.precision(17);
  text << "mesh " << mesh.text() << " trajectory " << benchmark.trajectory.size() << ' ' << path.text() << " pattern "
       << static_cast<int>(model.pattern) << " rays " << model.rays_per_frame << " noise " << model.range_noise_m
       << " dropout " << model.dropout << " range " << model.min_range_m << ' ' << model.max_range_m << " seed "
       << seed;
  return text.str();
}

std::string scanFileName(const std::string& key) {
  Hash hash;
  hash.add(key.data(), key.size());
  return key.substr(0, key.find(' ')) + "-" + hash.text() + ".scans";
}

std::vector<StoredFrame> readScanFile(const std::filesystem::path& path, const std::string& fingerprint,
                                      std::string& why_not) {
  why_not.clear();
  std::ifstream file(path, std::ios::binary);
  std::ostringstream content;
  content << file.rdbuf();
  const std::string bytes = content.str();
  const std::string head = kMagic + fingerprint + "\n";
  constexpr std::size_t kChecksumSize = 16;
  if (!file || bytes.empty()) {
    why_not = "it cannot be read";
  } else if (bytes.rfind(kMagic, 0) != 0) {
    why_not = "it was written by another version";
  } else if (bytes.rfind(head, 0) != 0) {
    why_not = "scene, trajectory or sensor have changed since it was written";
  } else if (bytes.size() < head.size() + kChecksumSize ||
             bytes.compare(bytes.size() - kChecksumSize, kChecksumSize,
                           checksum(bytes.data(), bytes.size() - kChecksumSize)) != 0) {
    why_not = "it is damaged";
  }
  std::vector<StoredFrame> frames;
  if (!why_not.empty()) return frames;

  const std::string body = bytes.substr(0, bytes.size() - kChecksumSize);
  Taker taker(body, head.size());
  const auto count = taker.take<std::uint64_t>();
  while (frames.size() < count && !taker.ranShort()) {
    StoredFrame frame;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) frame.T_W_S(row, column) = taker.take<double>();
    }
    const auto hits = taker.take<std::uint32_t>();
    if (!taker.fits(std::size_t{hits} * 3 * sizeof(float))) break;
    frame.hits_S.resize(hits);
    for (Eigen::Vector3f& p_S : frame.hits_S) {
      for (int axis = 0; axis < 3; ++axis) p_S[axis] = taker.take<float>();
    }
    frames.push_back(std::move(frame));
  }
  if (taker.ranShort() || !taker.atEnd()) {
    why_not = "it is damaged";
    frames.clear();
  }
  return frames;
}

void writeScanFile(const std::filesystem::path& path, const std::string& fingerprint,
                   const std::vector<StoredFrame>& frames) {
  std::string bytes = kMagic + fingerprint + "\n";
  put(bytes, static_cast<std::uint64_t>(frames.size()));
  for (const StoredFrame& frame : frames) {
    for (const double number : numbers(frame.T_W_S)) put(bytes, number);
    put(bytes, static_cast<std::uint32_t>(frame.hits_S.size()));
    for (const Eigen::Vector3f& p_S : frame.hits_S) bytes.append(reinterpret_cast<const char*>(p_S.data()), 12);
  }
  bytes += checksum(bytes.data(), bytes.size());
  io::writeFileDurably(path, [&bytes](std::ostream& out) { out << bytes; });
}

}  // namespace accessvdb::eval
