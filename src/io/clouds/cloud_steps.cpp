// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/cloud_steps.h"

#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "io/poses/trajectory_coverage.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

/// Returns that are decoded at once: few enough to stay in the cache.
constexpr std::size_t kChunk = 4096;
/// Tolerance for shading normals: length 1 within the rounding of text with 3 digits.
constexpr double kUnitNormal = 1e-3;

bool allUnitOrZero(const std::vector<Eigen::Vector3d>& rays) {
  return std::all_of(rays.begin(), rays.end(), [](const Eigen::Vector3d& ray) {
    return std::abs(ray.norm() - 1) <= kUnitNormal || ray.isZero(0);
  });
}

}  // namespace

CloudSteps::CloudSteps(CloudInput input) : input_(std::move(input)) {
  findSteps();
  steps_.erase(std::remove_if(steps_.begin(), steps_.end(), [](const Step& step) { return step.used == 0; }),
               steps_.end());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < steps_.size(); i += static_cast<std::size_t>(input_.every)) steps_[kept++] = steps_[i];
  steps_.resize(kept);
}

void CloudSteps::checkSize(std::size_t file) const {
  if (inputFileSize(input_.files[file]) != file_bytes_[file])
    throw InputError("input.changed", forMessage(input_.files[file].native()),
                     "changed its size since it was first read", "Wait until it is complete");
}

void CloudSteps::open(std::size_t file) {
  input_.read.scan = static_cast<std::int32_t>(file);
  reader_ = openCloud(input_.files[file], input_.kind, input_.read);
  file_ = file;
}

void CloudSteps::noteFrame(std::size_t file) {
  if (reader_->frame() == nullptr) return;
  const SurveyFrame& frame = *reader_->frame();
  if (file == 0) frame_ = frame;
  if (frame.systemSha256() == frame_.systemSha256()) return;
  throw UnusableInput("scans.frame", forMessage(input_.files[file].native()),
                      "says another coordinate system than " + forMessage(input_.files.front().filename().native(), 64),
                      "Reproject it, or say with crs_wkt which one all are in");
}

void CloudSteps::findSteps() {
  TrajectoryCoverage coverage;
  CarriedCheck carried(input_.read.carry);
  for (std::size_t file = 0; file < input_.files.size(); ++file) {
    file_bytes_.push_back(inputFileSize(input_.files[file]));
    open(file);
    noteFrame(file);
    carried.note(reader_->carried(), forMessage(input_.files[file].native()));
    CloudTotals totals;
    bool all_unit = true;
    std::size_t room = 0;  // in the step that is being filled
    for (bool more = true; more;) {
      const CloudReader::Place place = reader_->place();
      const std::size_t wanted = std::min(kChunk, room == 0 ? input_.rays_per_step : room);
      const PointCloud part = reader_->next(wanted);
      more = part.points.size() == wanted;
      totals.add(part);
      all_unit = all_unit && allUnitOrZero(part.ray_vectors);
      if (part.points.empty()) break;
      if (room == 0) {
        steps_.push_back({file, place});
        if (!part.stamps_s.empty() && std::isfinite(part.stamps_s.front()))
          steps_.back().stamp_s = part.stamps_s.front() + input_.time_offset_s;
        room = input_.rays_per_step;
      }
      steps_.back().returns += part.points.size();
      room -= part.points.size();
      if (input_.trajectory) {
        steps_.back().used += addTo(coverage, part);
      } else {
        steps_.back().used += part.points.size();
      }
    }
    checkReader(totals, all_unit);
  }
  carried.require(system_doubts_.empty() ? "" : system_doubts_.front());
  if (steps_.empty())
    throw UnusableInput("input.no_points", forMessage(input_.files.front().parent_path().native()),
                        "contains no points in any of its " + std::to_string(input_.files.size()) + " files",
                        "Use other files");
  if (!input_.trajectory) return;
  coverage.check(*input_.trajectory, input_.time_offset_s);
  // First, because only so many notices about files are kept.
  std::vector<std::string> notices = coverage.notices(*input_.trajectory);
  notices_.insert(notices_.begin(), notices.begin(), notices.end());
}

/// What only the whole of a file can tell.
void CloudSteps::checkReader(const CloudTotals& totals, bool all_unit) {
  const std::string subject = forMessage(input_.files[file_].native());
  for (std::string& notice : reader_->notices(totals)) notices_.push_back(std::move(notice));
  if (!reader_->unitDoubt().empty()) unit_doubts_.push_back(subject + ": " + reader_->unitDoubt());
  if (!reader_->systemDoubt().empty()) system_doubts_.push_back(subject + ": " + reader_->systemDoubt());
  if (totals.points == 0 && totals.left_out.all() != 0 && input_.files.size() == 1)
    throw UnusableInput("input.no_points", subject, "has only " + totals.left_out.inWords() + ", which are left out",
                        "Use keep_noise to keep them, or another file");
  if (totals.points == 0) {
    if (input_.files.size() == 1)
      throw UnusableInput("input.no_points", subject, "contains no points", "Use another file");
    notices_.push_back(subject + ": contains no points");
  } else if (input_.read.rays && input_.kind == ScanKind::Ply && all_unit) {
    throw UnusableInput("input.no_rays", subject,
                        "is not a ray cloud: its nx ny nz are all of length 1, as surface normals are",
                        "Provide poses, or a single sensor position with sensor_at_W X,Y,Z");
  }
  if (totals.unbounded_rays != 0)
    notices_.push_back(subject + ": " + std::to_string(totals.unbounded_rays) +
                       " rays that hit nothing (alpha 0) are skipped");
  truncated_points_ += totals.truncated_points;
  noise_points_ += totals.left_out.all();
}

std::size_t CloudSteps::addTo(TrajectoryCoverage& coverage, const PointCloud& part) {
  std::size_t used = 0;
  for (std::size_t i = 0; i < part.points.size(); ++i) {
    const double stamp_s = part.stamps_s[i] + input_.time_offset_s;
    const auto sensor_W = sensorAt(stamp_s);
    coverage.add(stamp_s, part.points[i], sensor_W);
    used += sensor_W ? 1 : 0;
  }
  return used;
}

Eigen::Vector3d CloudSteps::inMetres(const Eigen::Vector3d& given) const {
  const Eigen::Vector3d unit_m = reader_->unit_m();
  return unit_m == Eigen::Vector3d(1, 1, 1) ? given : given.cwiseProduct(unit_m);
}

std::optional<Eigen::Vector3d> CloudSteps::sensorAt(double stamp_s) {
  const auto given = input_.trajectory->at(stamp_s, near_);
  return given ? std::optional(inMetres(*given)) : std::nullopt;
}

void CloudSteps::append(const PointCloud& part, ScanRecord& record) {
  for (std::size_t i = 0; i < part.points.size(); ++i) {
    if (input_.trajectory) {
      const auto sensor_W = sensorAt(part.stamps_s[i] + input_.time_offset_s);
      if (!sensor_W) continue;
      record.origins_W.push_back(*sensor_W);
    } else if (input_.ray_W) {
      record.origins_W.push_back(part.points[i] - *input_.ray_W);
    } else if (!part.sensors.empty()) {
      record.origins_W.push_back(part.sensors[i]);
    } else if (input_.read.rays) {
      record.origins_W.push_back(part.points[i] + part.ray_vectors[i]);
    }
    record.points_W.push_back(part.points[i]);
    const auto row = part.attributes.begin() + static_cast<std::ptrdiff_t>(i * input_.read.carry.size());
    if (!part.attributes.empty())
      record.attributes.insert(record.attributes.end(), row,
                               row + static_cast<std::ptrdiff_t>(input_.read.carry.size()));
  }
}

std::uint64_t CloudSteps::heldBytes() const {
  return steps_.capacity() * sizeof(Step) + (input_.trajectory ? input_.trajectory->heldBytes() : 0) +
         (reader_ ? reader_->heldBytes() : 0);
}

ScanRecord CloudSteps::read(std::size_t step) {
  const Step& wanted = steps_.at(step);
  checkSize(wanted.file);
  if (!reader_ || file_ != wanted.file) open(wanted.file);
  reader_->seek(wanted.place);
  ScanRecord record;
  record.path = path(step).string();
  record.stamp_s = wanted.stamp_s.value_or(0);
  record.truncated_points = step == 0 ? truncated_points_ : 0;
  record.noise_points = step == 0 ? noise_points_ : 0;
  record.step_m = reader_->step_m();
  record.points_W.reserve(wanted.returns);
  if (input_.read.rays || input_.trajectory || input_.ray_W) {
    record.origins_W.reserve(wanted.returns);
  } else {
    record.origins_W = {inMetres(input_.sensors_W[wanted.file])};
  }
  for (std::size_t done = 0; done < wanted.returns;) {
    const PointCloud part = reader_->next(std::min(kChunk, wanted.returns - done));
    if (part.points.empty())
      throw InputError("input.changed", forMessage(path(step).native()), "has fewer points than when it was first read",
                       "Wait until it is complete");
    append(part, record);
    done += part.points.size();
  }
  return record;
}

}  // namespace accessvdb::io
