// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// ScanSequence: scans and poses from files.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>

#include "accessvdb/program/scan_agreement.h"
#include "accessvdb/scan_io.h"
#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {

template <>
inline constexpr std::array kWords<io::PoseFormat> = {"auto", "tum", "kitti", "balm", "hba", "viewpoint"};
template <>
inline constexpr std::array kWords<io::Match> = {"auto", "order", "name", "time"};

io::Level levelFrom(const py::object& level) {
  if (py::isinstance<py::str>(level)) {
    if (level.cast<std::string>() == "imu") return {.from_imu = true};
    throw py::value_error("level must be \"imu\", or roll and pitch in radians");
  }
  if (!py::isinstance<py::sequence>(level) || py::len(level) != 2)
    throw py::type_error("level must be \"imu\", or roll and pitch in radians");
  const auto angles = py::reinterpret_borrow<py::sequence>(level);
  return {false, numberFrom("level", angles[0]), numberFrom("level", angles[1])};
}

namespace {

/// A sequence whose reads take turns, each without holding the interpreter's lock.
struct LockedScans {
  std::mutex turn;
  io::ScanSequence scans;
  std::optional<Eigen::Isometry3d> T_B_S;
  LockedScans(io::ScanSequence&& opened, const io::ScanInputOptions& options)
      : scans(std::move(opened)), T_B_S(options.T_B_S) {}
};

std::unique_ptr<LockedScans> openScans(
    const std::filesystem::path& scans, const std::optional<std::filesystem::path>& poses,
    const py::object& pose_format, const std::optional<std::filesystem::path>& calib, const py::object& sensor_at_W,
    const py::object& every, const py::object& allow_truncated, const py::object& sort_poses,
    const py::object& rays_per_step, const std::optional<std::filesystem::path>& trajectory,
    const py::object& time_offset_s, const std::optional<std::filesystem::path>& stations,
    const std::string& laz_command, const std::string& topic, const std::string& pose_topic,
    const std::string& fixed_frame, const py::object& T_B_S, const py::object& exclude_box_S, const py::object& deskew,
    const py::object& level, const py::object& ray_W, const py::object& match, const py::object& max_gap_s,
    const py::object& keep_noise, const std::vector<std::string>& carry) {
  io::ScanInputOptions options;
  options.scans = scans;
  if (poses) options.poses = *poses;
  options.pose_format = settingFrom<io::PoseFormat>("pose_format", pose_format);
  if (calib) options.calib = *calib;
  if (!sensor_at_W.is_none()) options.sensor_at_W = vector3("sensor_at_W", sensor_at_W);
  constexpr std::int64_t kMost = std::numeric_limits<int>::max();
  options.every = static_cast<int>(wholeNumberFrom("every", every, 1, kMost));
  options.allow_truncated = boolFrom("allow_truncated", allow_truncated);
  options.sort_poses = boolFrom("sort_poses", sort_poses);
  options.keep_noise = boolFrom("keep_noise", keep_noise);
  options.carry = carry;
  options.rays_per_step = static_cast<std::size_t>(wholeNumberFrom("rays_per_step", rays_per_step, 1, kMost));
  if (trajectory) options.trajectory = *trajectory;
  options.time_offset_s = numberFrom("time_offset_s", time_offset_s);
  if (stations) options.stations = *stations;
  options.laz_command = laz_command;
  options.topic = topic;
  options.pose_topic = pose_topic;
  options.fixed_frame = fixed_frame;
  if (!T_B_S.is_none()) options.T_B_S = poseOf("T_B_S", T_B_S);
  if (!exclude_box_S.is_none()) {
    if (!py::isinstance<py::sequence>(exclude_box_S) || py::len(exclude_box_S) != 2)
      throw py::type_error("exclude_box_S must be two corners, each of three numbers");
    const auto corners = py::reinterpret_borrow<py::sequence>(exclude_box_S);
    options.exclude_box_S =
        Eigen::AlignedBox3d(vector3("exclude_box_S", corners[0]), vector3("exclude_box_S", corners[1]));
  }
  options.deskew = settingFrom<io::Deskew>("deskew", deskew);
  if (!level.is_none()) options.level = levelFrom(level);
  options.match = settingFrom<io::Match>("match", match);
  options.max_gap_s = numberFrom("max_gap_s", max_gap_s);
  if (!ray_W.is_none()) options.ray_W = vector3("ray_W", ray_W);
  return withoutLock([&] { return std::make_unique<LockedScans>(io::ScanSequence::open(options), options); });
}

/// Python's convention: -1 is the last one.
std::shared_ptr<io::ScanRecord> readScan(LockedScans& s, std::int64_t step) {
  const auto size = static_cast<std::int64_t>(s.scans.size());
  const std::int64_t index = step < 0 ? step + size : step;
  if (index < 0 || index >= size) {
    throw py::index_error("scan " + std::to_string(step) + " of " + std::to_string(size));
  }
  return withoutLock([&] {
    const std::scoped_lock turn(s.turn);
    return std::make_shared<io::ScanRecord>(s.scans.read(static_cast<std::size_t>(index)));
  });
}

io::ScanAgreement agreementOf(LockedScans& s, double range_noise_m) {
  if (!(range_noise_m >= 0 && range_noise_m < 1e3))
    throw InvalidArgument("python.range_noise", "range_noise_m", "is not metres, 0 or more");
  return withoutLock([&] {
    const std::scoped_lock turn(s.turn);
    return io::measureAgreement(s.scans, range_noise_m, s.T_B_S).measure();
  });
}

void bindAgreement(py::module_& module) {
  using A = io::ScanAgreement;
  py::class_<A>(module, "ScanAgreement", "Whether scans agree about what is where: wrong poses make a wrong map.")
      .def_property_readonly(
          "verdict", [](const A& a) { return name(a.verdict); },
          "\"not_measured\", \"usual\", \"doubtful\", \"disagree\".")
      .def_readonly("why_not", &A::why_not, "Why it was not measured.")
      .def_property_readonly(
          "share", [](const A& a) { return a.counts.share(); },
          "Of the returns about which another scan says something, those that lie where it has a surface.")
      .def_readonly("scans", &A::scans, "How many were compared.")
      .def_readonly("outliers", &A::outliers, "Scans that do not agree with the others, which do.")
      .def_property_readonly(
          "fault",
          [](const A& a) -> std::optional<std::string> {
            return a.cure ? std::optional<std::string>(name(a.cure->fault)) : std::nullopt;
          },
          "How the poses seem to be wrong, or None: \"inverse\", \"quaternion_w_first\", \"quaternion_w_last\", "
          "\"inverse_extrinsic\", \"turned\", \"in_world\", \"time_offset\", \"unit\".")
      .def_property_readonly(
          "fault_value", [](const A& a) { return a.cure ? a.cure->value : 0; },
          "turned: degrees; time_offset: seconds to add; unit: factor for the positions of the poses.");
}

template <typename Scalar>
auto vectorsOf(std::vector<Eigen::Matrix<Scalar, 3, 1>> io::ScanRecord::*member) {
  return [member](const py::object& self) {
    const auto& vectors = self.cast<const io::ScanRecord&>().*member;
    return viewInto(self, py::dtype::of<Scalar>(), vectors.data(), vectors.size(), 3 * sizeof(Scalar), 3);
  };
}

void bindRecord(py::module_& module) {
  using R = io::ScanRecord;
  py::class_<R, std::shared_ptr<R>>(module, "ScanRecord",
                                    "One step: points_S with T_W_S, or, for a ray cloud, points_W with origins_W.")
      .def_property_readonly("points_S", vectorsOf<float>(&R::points_S), "(N, 3) float32, sensor frame, read-only.")
      .def_property_readonly(
          "T_W_S",
          [](const R& record) {
            const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> rows = record.T_W_S.matrix();
            return py::array_t<double>({4, 4}, rows.data());
          },
          "(4, 4) float64, sensor to world.")
      .def_property_readonly("points_W", vectorsOf<double>(&R::points_W), "(N, 3) float64, world frame, read-only.")
      .def_property_readonly("origins_W", vectorsOf<double>(&R::origins_W), "(N, 3) or (1, 3) float64, read-only.")
      .def_property_readonly(
          "attributes",
          [](const R& record) {
            const std::size_t points = record.points_W.empty() ? record.points_S.size() : record.points_W.size();
            const std::size_t width = points == 0 ? 0 : record.attributes.size() / points;
            return py::array_t<std::int32_t>({points, width}, record.attributes.data());
          },
          "(N, len(carry)) int32, a copy: what the returns carry.")
      .def_readonly("stamp_s", &R::stamp_s)
      .def_readonly("path", &R::path)
      .def_readonly("truncated_points", &R::truncated_points)
      .def_readonly("excluded_points", &R::excluded_points)
      .def_readonly("noise_points", &R::noise_points)
      .def_readonly("step_m", &R::step_m)
      .def_readonly("unposed_points", &R::unposed_points)
      .def_readonly("deskewed", &R::deskewed)
      .def_readonly("skipped", &R::skipped, "Why there are no points, or an empty text.");
}

}  // namespace

void bindScans(py::module_& module) {
  bindRecord(module);
  bindAgreement(module);
  py::class_<LockedScans>(module, "ScanSequence", "Scans with their poses, in order; files are read on demand.")
      .def(py::init(&openScans), py::arg("scans"), py::arg("poses") = py::none(), py::kw_only(),
           py::arg("pose_format") = "auto", py::arg("calib") = py::none(), py::arg("sensor_at_W") = py::none(),
           py::arg("every") = 1, py::arg("allow_truncated") = false, py::arg("sort_poses") = false,
           py::arg("rays_per_step") = 20000, py::arg("trajectory") = py::none(), py::arg("time_offset_s") = 0.0,
           py::arg("stations") = py::none(), py::arg("laz_command") = "", py::arg("topic") = "",
           py::arg("pose_topic") = "", py::arg("fixed_frame") = "", py::arg("T_B_S") = py::none(),
           py::arg("exclude_box_S") = py::none(), py::arg("deskew") = "auto", py::arg("level") = py::none(),
           py::arg("ray_W") = py::none(), py::arg("match") = "auto", py::arg("max_gap_s") = 0.2,
           py::arg("keep_noise") = false, py::arg("carry") = std::vector<std::string>(),
           "scans: a folder of .pcd, .ply, .bin, .las, .laz or .ptx files, one file, or a recording (.mcap, .db3, "
           ".bag). "
           "poses: TUM, KITTI, BALM or HBA. trajectory, stations: where the sensor was, for clouds in the world "
           "frame. topic, pose_topic, fixed_frame: for recordings. T_B_S: (4, 4), the sensor on what the poses "
           "are of. exclude_box_S: two corners; returns between them are left out. deskew: auto, on or off. level: "
           "\"imu\" "
           "or (roll, pitch) of the poses' frame in radians. ray_W: from the sensor to every point of a cloud whose "
           "rays are not known. match: auto, order, name or time. max_gap_s: the longest time without poses that is "
           "interpolated over. keep_noise: keep what is withheld, synthetic or noise in LAS. carry: names of what "
           "the returns carry, such as classification or tree_id.")
      .def("agreement", &agreementOf, py::arg("range_noise_m") = 0.0,
           "Reads a few scans of the whole sequence and compares them, as the program does before it maps.")
      .def("__len__", [](const LockedScans& s) { return s.scans.size(); })
      .def("__getitem__", &readScan, py::arg("step"))
      .def("__iter__",
           [](const py::object& self) {
             const auto builtins = py::module_::import("builtins");
             return builtins.attr("map")(self.attr("__getitem__"), builtins.attr("range")(py::len(self)));
           })
      .def_property_readonly(
          "notices", [](const LockedScans& s) { return s.scans.notices(); },
          "Frame, quaternion order, matching rule, repairs.")
      .def_property_readonly(
          "warnings",
          [](const LockedScans& s) {
            std::vector<std::pair<std::string, std::string>> warnings;
            for (const io::ScanWarning& warning : s.scans.warnings()) warnings.emplace_back(warning.id, warning.text);
            for (const io::ScanWarning& warning : s.scans.readWarnings())
              warnings.emplace_back(warning.id, warning.text);
            return warnings;
          },
          "(id, text) of what is most likely a mistake or a loss, of the scans that were read, too.")
      .def_property_readonly("matching_rule", [](const LockedScans& s) { return s.scans.matchingRule(); })
      .def_property_readonly(
          "paths", [](const LockedScans& s) { return s.scans.paths(); }, "Every file that is or will be read.")
      .def_property_readonly(
          "recorded_range_noise_m", [](const LockedScans& s) { return s.scans.recordedRangeNoise_m(); },
          "From range_noise.txt next to the scans, or None.");
}

}  // namespace accessvdb::python
