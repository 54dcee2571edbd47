// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/recording.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <bit>
#include <cstdio>
#include <ostream>
#include <string>
#include <system_error>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "io/poses/pose_matching.h"

namespace accessvdb::sim {
namespace {

namespace fs = std::filesystem;

static_assert(std::endian::native == std::endian::little, "binary PCD is written directly from memory");
static_assert(sizeof(Eigen::Vector3f) == 12, "a row of a PCD is three packed floats");

/// Frames between calls of `proceed`: enough to keep the threads busy, few enough to stop promptly.
constexpr int kFramesPerBatch = 16;

template <typename... Values>
std::string formatted(const char* format, Values... values) {
  char text[512];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

std::string scanName(int index) { return formatted("%06d.pcd", index); }

bool isScanName(const std::string& file, int frames) {
  if (!file.ends_with(".pcd") || file.size() > 12) return false;
  const std::string digits = file.substr(0, file.size() - 4);
  if (digits.empty() || digits.find_first_not_of("0123456789") != std::string::npos) return false;
  const int index = std::stoi(digits);
  return index < frames && file == scanName(index);
}

[[noreturn]] void throwCannotReplace(const fs::path& path, const std::error_code& error) {
  throw OutputError("output.permission", path.string(), "cannot be replaced: " + error.message(),
                    "Choose an --out folder that you may write to");
}

/// Replaces an earlier recording of at most as many frames. Other files are not removed, but refused: they would be
/// taken for scans of this recording. Poses go first: none may seem to belong to a half-written recording.
void clearFolder(const fs::path& scans, std::vector<fs::path> earlier, int frames) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(scans, error)) {
    const std::string file = entry.path().filename().string();
    if (isScanName(file, frames)) {
      earlier.push_back(entry.path());
    } else if (!file.starts_with(".")) {
      throw OutputError("sim.mixed", scans.string(), "already contains other files, for example " + file,
                        "Choose an empty folder or remove them");
    }
  }
  if (error) throwCannotReplace(scans, error);
  for (const fs::path& file : earlier) {
    fs::remove(file, error);
    if (error) throwCannotReplace(file, error);
  }
}

void writeTimedScan(const fs::path& path, const SimulatedFrame& frame) {
  io::writeFileDurably(path, [&](std::ostream& out) {
    const std::string n = std::to_string(frame.points_S.size());
    out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F U\n"
           "COUNT 1 1 1 1\nWIDTH "
        << n << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << n << "\nDATA binary\n";
    for (std::size_t i = 0; i < frame.points_S.size(); ++i) {
      out.write(reinterpret_cast<const char*>(frame.points_S[i].data()), sizeof(Eigen::Vector3f));
      out.write(reinterpret_cast<const char*>(&frame.times_ns[i]), sizeof(std::uint32_t));
    }
  });
}

void writeScan(const fs::path& path, const std::vector<Eigen::Vector3f>& points_S) {
  io::writeFileDurably(path, [&](std::ostream& out) {
    const std::string n = std::to_string(points_S.size());
    out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
           "COUNT 1 1 1\nWIDTH "
        << n << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << n << "\nDATA binary\n";
    out.write(reinterpret_cast<const char*>(points_S.data()),
              static_cast<std::streamsize>(points_S.size() * sizeof(Eigen::Vector3f)));
  });
}

std::string poseLine(double stamp_s, const Eigen::Isometry3d& T_W_S) {
  const Eigen::Vector3d t = T_W_S.translation();
  Eigen::Quaterniond q(T_W_S.linear());
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return formatted("%.6f %.12g %.12g %.12g %.15g %.15g %.15g %.15g\n", stamp_s, t.x(), t.y(), t.z(), q.x(), q.y(),
                   q.z(), q.w());
}

/// As odometry at 200 Hz would have them. The pose at the end of a frame is the first one of the next.
std::string poseLines(const SimulatedFrame& frame, double period_s, bool last) {
  constexpr double kSpacing_s = 0.005;
  const int count = std::max(1, static_cast<int>(std::lround(period_s / kSpacing_s)));
  std::string lines;
  for (int i = 0; i < count + (last ? 1 : 0); ++i) {
    const double share = static_cast<double>(i) / count;
    lines += poseLine(frame.stamp_s + share * period_s, io::interpolateBetween(frame.T_W_S, frame.T_W_S_end, share));
  }
  return lines;
}

void writeText(const fs::path& path, const std::string& text) {
  io::writeFileDurably(path, [&](std::ostream& out) { out << text; });
}

}  // namespace

int writeRecording(const fs::path& folder, const Simulator& simulator, const SimulatedRecordingOptions& options) {
  const fs::path scans = folder / "scans", poses = folder / "poses.txt", times = folder / "times.txt";
  io::prepareOutputFolder(folder);
  io::prepareOutputFolder(scans);
  const int frames = simulator.frames();
  clearFolder(scans, {poses, times}, frames);
  const LidarModel& model = simulator.model();

  std::vector<std::string> lines(static_cast<std::size_t>(frames));
  // More threads than the machine has would only cause a warning from TBB.
  const int most = tbb::this_task_arena::max_concurrency();
  tbb::task_arena arena(options.threads > 0 ? std::min(options.threads, most) : most);
  int done = 0;
  while (done < frames && (!options.proceed || options.proceed(done))) {
    const int end = std::min(frames, done + kFramesPerBatch);
    arena.execute([&] {
      tbb::parallel_for(done, end, [&](int index) {
        const SimulatedFrame frame = simulator.frame(index);
        std::string& of_frame = lines[static_cast<std::size_t>(index)];
        if (!model.moves) {
          of_frame = poseLine(frame.stamp_s, frame.T_W_S);
          writeScan(scans / scanName(index), frame.points_S);
          return;
        }
        of_frame = poseLines(frame, model.frame_period_s, index + 1 == frames);
        writeTimedScan(scans / scanName(index), frame);
      });
    });
    done = end;
  }
  if (done == frames && options.proceed) options.proceed(done);

  std::string text = "# stamp x y z qx qy qz qw, sensor to world, metres\n";
  for (int index = 0; index < done; ++index) text += lines[static_cast<std::size_t>(index)];
  writeText(folder / "range_noise.txt", formatted("%.9g\n", options.range_noise_m));
  if (model.moves) {
    std::string stamps;
    for (int index = 0; index < done; ++index) stamps += formatted("%.6f\n", index * model.frame_period_s);
    writeText(times, stamps);
  }
  writeText(poses, text);
  return done;
}

}  // namespace accessvdb::sim
