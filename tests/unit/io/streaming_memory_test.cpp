// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Clouds that are several times larger than the memory that reading them may take.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <ostream>

#include "accessvdb/scan_io.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kFileBytes = 48U << 20;
/// A step of 20 000 rays is 1 MB, and the step before it may still be held.
constexpr long kBoundKiB = 8 << 10;

struct CloudForm {
  const char* name;
  bool rays = false, trajectory = false;
};
std::ostream& operator<<(std::ostream& out, const CloudForm& form) { return out << form.name; }

std::string plyHeader(const std::string& format, std::size_t points, const std::vector<std::string>& names) {
  std::string text = "ply\nformat " + format + " 1.0\nelement vertex " + std::to_string(points) + "\n";
  for (const std::string& name : names) text += "property float " + name + "\n";
  return text + "end_header\n";
}

std::string lasHeader(std::size_t points, std::size_t record_bytes) {
  std::string file("LASF", 4);
  file.resize(24, '\0');
  file += "\1\2";
  file.resize(94, '\0');
  test::put(file, std::uint16_t{227});
  test::put(file, std::uint32_t{227});
  file.resize(105, '\0');
  test::put(file, static_cast<std::uint16_t>(record_bytes));
  test::put(file, static_cast<std::uint32_t>(points));
  file.resize(131, '\0');
  for (int axis = 0; axis < 3; ++axis) test::put(file, 0.001);
  file.resize(179, '\0');
  for (int axis = 0; axis < 3; ++axis) {
    test::put(file, 1e6);
    test::put(file, -1e6);
  }
  return file;
}

/// Writes point after point, so that this process does not hold the file either. @return points
std::size_t writeCloud(const std::filesystem::path& path, const std::string& name) {
  std::string point, header;
  std::size_t points = 0;
  const auto fill = [&](const std::string& bytes) {
    point = bytes;
    points = kFileBytes / bytes.size();
  };
  std::string floats;
  for (const float value : {1.5F, 2.0F, 3.0F, 0.0F, 0.5F, 4.0F}) test::put(floats, value);
  if (name == "rays.ply") {
    fill(floats);
    header = plyHeader("binary_little_endian", points, {"x", "y", "z", "nx", "ny", "nz"});
  } else if (name == "text.ply") {
    fill("123.456 -234.567 3.25\n");
    header = plyHeader("ascii", points, {"x", "y", "z"});
  } else if (name == "cloud.las" || name == "timed.laz") {
    std::string record;
    for (int axis = 0; axis < 3; ++axis) test::put(record, std::int32_t{1000 + axis});
    record += std::string(8, '\0');
    if (name == "timed.laz") test::put(record, 100.5);
    fill(record);
    header = lasHeader(points, point.size());
    if (name == "timed.laz") header[104] = 1;
  } else if (name == "cloud.pcd") {
    fill(floats.substr(0, 16));
    const std::string count = std::to_string(points);
    header = "FIELDS x y z i\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH " + count + "\nHEIGHT 1\nPOINTS " + count +
             "\nDATA binary\n";
  } else if (name == "cloud.bin") {
    fill(floats.substr(0, 16));
  } else {
    fill("470000.0001 3810222.123 1 7 8\n");
  }
  std::ofstream file(path, std::ios::binary);
  file << header;
  std::string block;
  for (std::size_t i = 0; i < 1000; ++i) block += point;
  std::size_t left = points;
  for (; left >= 1000; left -= 1000) file << block;
  while (left-- > 0) file << point;
  return points;
}

/// Peak of this process, KiB, by VmHWM.
long peakKiB() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    long kib = 0;
    if (word == "VmHWM:" && status >> kib) return kib;
  }
  return -1;
}

/// Reads all steps in a process of its own, whose peak begins where it is now. @return by how much the peak grew, KiB
long growthWhileReadingKiB(const std::filesystem::path& path, const CloudForm& form, std::size_t points) {
  int ends[2];
  if (::pipe(ends) != 0) return -1;
  const pid_t child = ::fork();
  if (child == 0) {
    const long before = peakKiB();
    ScanInputOptions options{.scans = path, .laz_command = "cat"};
    if (form.trajectory) {
      options.trajectory = path.parent_path() / "trajectory.txt";
    } else if (!form.rays) {
      options.sensor_at_W = Eigen::Vector3d::Zero();
    }
    ScanSequence scans = ScanSequence::open(options);
    std::size_t read = 0;
    for (std::size_t step = 0; step < scans.size(); ++step) read += scans.read(step).points_W.size();
    const long growth = read == points ? peakKiB() - before : -2;
    _exit(::write(ends[1], &growth, sizeof(growth)) == sizeof(growth) ? 0 : 1);
  }
  ::close(ends[1]);
  long growth = -1;
  if (::read(ends[0], &growth, sizeof(growth)) != sizeof(growth)) growth = -1;
  ::close(ends[0]);
  ::waitpid(child, nullptr, 0);
  return growth;
}

class StreamingMemory : public ::testing::TestWithParam<CloudForm> {};

TEST_P(StreamingMemory, StaysFarBelowTheSizeOfTheFile) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers keep what was freed";
#endif
  const test::TempFolder folder;
  const std::filesystem::path path = folder / GetParam().name;
  const std::size_t points = writeCloud(path, GetParam().name);
  (void)folder.write("trajectory.txt", "100.4 0 0 0\n100.6 1 0 0\n");
  const long growth = growthWhileReadingKiB(path, GetParam(), points);
  ASSERT_GE(growth, 0);
  EXPECT_LE(growth, kBoundKiB);
}
INSTANTIATE_TEST_SUITE_P(Formats, StreamingMemory,
                         ::testing::Values(CloudForm{"rays.ply", true}, CloudForm{"text.ply"}, CloudForm{"cloud.las"},
                                           CloudForm{"cloud.pcd"}, CloudForm{"cloud.bin"}, CloudForm{"cloud.xyz"},
                                           CloudForm{"timed.laz", false, true}));

}  // namespace
}  // namespace accessvdb::io
