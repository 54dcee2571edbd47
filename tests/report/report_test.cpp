// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Areas against spheres and walls whose area is known, and the bytes of the page.
#include "accessvdb/program/html_report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <sstream>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/approaches.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/next_views.h"
#include "report/point_packer.h"
#include "report/surface_area.h"
#include "report/text_coding.h"
#include "support/scratch_folder.h"

namespace accessvdb {
namespace {

namespace fs = std::filesystem;

std::string textOf(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

/// What the page says about the field, without its points.
nlohmann::json factsOf(const fs::path& html) {
  const std::string text = textOf(html), mark = "id=\"facts\">";
  const std::size_t begin = text.find(mark) + mark.size();
  return nlohmann::json::parse(text.substr(begin, text.find("</script>", begin) - begin));
}

double areaIn_m2(const nlohmann::json& facts) {
  double area_m2 = 0;
  for (const nlohmann::json& each : facts.at("classes")) area_m2 += each.at("area_m2").get<double>();
  return area_m2;
}

/// A sensor position and what is seen from there, world frame.
using Scans = std::vector<std::pair<Eigen::Vector3d, std::vector<Eigen::Vector3d>>>;

/// A sphere around the origin, from six sides.
Scans scansOfSphere(double radius_m, double range_noise_m) {
  std::mt19937 random(1);
  std::normal_distribution<double> gauss;  // its own deviation must not be 0
  Scans scans;
  for (int view = 0; view < 6; ++view) {
    Eigen::Vector3d towards = Eigen::Vector3d::Zero();
    towards[view / 2] = view % 2 == 0 ? 1 : -1;
    const Eigen::Vector3d sensor = 2 * towards;
    std::vector<Eigen::Vector3d> points;
    constexpr int kPoints = 60'000;  // 12 for each square of 2 cm: Fibonacci's spiral
    for (int n = 0; n < kPoints; ++n) {
      const double z = 1 - (2 * n + 1.0) / kPoints, angle = n * std::numbers::pi * (3 - std::sqrt(5.0));
      const double r = std::sqrt(1 - z * z);
      const Eigen::Vector3d normal(r * std::cos(angle), r * std::sin(angle), z);
      if (normal.dot(towards) <= 0.5) continue;
      const Eigen::Vector3d exact = radius_m * normal;
      points.push_back(range_noise_m > 0
                           ? Eigen::Vector3d(exact + range_noise_m * gauss(random) * (exact - sensor).normalized())
                           : exact);
    }
    scans.emplace_back(sensor, points);
  }
  return scans;
}

class ReportArea : public ::testing::Test {
 protected:
  /// Area that the page gives for scans of points that are seen from the positions beside them.
  double areaOf(const Scans& scans_W, double voxel_size_m = 0.02, double range_noise_m = 0.005) {
    FieldParams params;
    params.tsdf.voxel_size_m = voxel_size_m;
    params.tsdf.range_noise_m = range_noise_m;
    params.backend = BackendKind::Cpu;
    AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
    for (const auto& [sensor_W, points_W] : scans_W) {
      std::vector<Eigen::Vector3f> points_S;
      for (const Eigen::Vector3d& p_W : points_W) points_S.push_back((p_W - sensor_W).cast<float>());
      Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
      T_W_S.translation() = sensor_W;
      field.integrateScan(points_S, T_W_S);
    }
    field.update();
    field.write(folder_.path() / "field");
    io::writeHtmlReport(folder_.path() / "x.html", folder_.path() / "field");
    return areaIn_m2(factsOf(folder_.path() / "x.html"));
  }
  test::ScratchFolder folder_;
};

// What docs/report.md, "Area" says of surfaces that bend little from voxel to voxel, where no voxel lacks a return.
TEST_F(ReportArea, OfASphereIsWithinATwentieth) {
  const double radius_m = 0.4;
  const double exact_m2 = 4 * std::numbers::pi * radius_m * radius_m;
  EXPECT_NEAR(areaOf(scansOfSphere(radius_m, 0)), exact_m2, 0.05 * exact_m2);
}

// No bound is promised with noise; docs/report.md quotes what this prints.
TEST_F(ReportArea, OfANoisySphereIsStated) {
  const double radius_m = 0.4, exact_m2 = 4 * std::numbers::pi * radius_m * radius_m;
  double before = 0;
  for (const double voxel_size_m : {0.1, 0.05, 0.02}) {
    const double ratio = areaOf(scansOfSphere(radius_m, 0.02), voxel_size_m, 0.02) / exact_m2;
    std::printf("20 mm of noise, voxels of %g m: %.2f times the area\n", voxel_size_m, ratio);
    EXPECT_GT(ratio, std::max(1.0, before)) << "finer voxels see more layers";
    before = ratio;
  }
}

TEST_F(ReportArea, OfAWallAtAnyAngleIsWithinATenth) {
  for (const double angle_deg : {0.0, 20.0, 45.0}) {
    const double angle = angle_deg * std::numbers::pi / 180;
    const Eigen::Vector3d along(-std::sin(angle), std::cos(angle), 0), normal(std::cos(angle), std::sin(angle), 0);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 400; ++i) {
      for (int j = 0; j < 300; ++j) {  // 2 m by 1.5 m, 16 returns per voxel's face; off the faces of the voxels
        points.push_back(2 * normal + (0.005 * i - 1) * along + Eigen::Vector3d(0, 0, 0.005 * j - 0.7513));
      }
    }
    EXPECT_NEAR(areaOf({{Eigen::Vector3d::Zero(), points}}), 2 * 1.5, 0.1 * 2 * 1.5) << angle_deg << " degrees";
  }
}

constexpr double kUnit = 1;

TEST(ReportAreaOfAPoint, IsThePlaneInsideItsVoxel) {
  const Eigen::Vector3d middle(0.5, 0.5, 0.5);
  EXPECT_NEAR(internal::areaOfPoint_m2(middle, {0, 0, -1}, 0.1), 0.01, 1e-12);
  EXPECT_NEAR(internal::areaOfPoint_m2(middle, Eigen::Vector3f(1, 1, 0).normalized(), 0.1), 0.01 * std::sqrt(2.0),
              1e-9);
  // A hexagon through six edges, and a triangle near a corner.
  const Eigen::Vector3f diagonal = Eigen::Vector3f(1, 1, 1).normalized();
  EXPECT_NEAR(internal::areaOfPoint_m2(middle, diagonal, kUnit), 0.75 * std::sqrt(3.0), 1e-6);
  EXPECT_NEAR(internal::areaOfPoint_m2({0.1, 0.1, 0.1}, diagonal, kUnit), 0.09 * std::sqrt(3.0) / 2, 1e-6);
  // In a face, whichever way it looks: within what the place is moved by.
  for (const float sign : {-1.0f, 1.0f}) {
    for (const double z : {0.0, 1.0}) {
      EXPECT_NEAR(internal::areaOfPoint_m2({0.3, 0.7, z}, {0, 0, sign}, kUnit), 1, 1e-9);
    }
    EXPECT_NEAR(internal::areaOfPoint_m2({0, 0.4, 0.2}, {sign * std::sqrt(0.5f), 0, sign * std::sqrt(0.5f)}, kUnit),
                0.2 * std::sqrt(2.0), 1e-5);
  }
}

/// The voxels that a plane cuts share it without gaps: whatever place in each is taken, the sum is its area.
TEST(ReportAreaOfAPoint, TheVoxelsOfAPlaneShareIt) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> in(0, 1);
  for (const Eigen::Vector3d& tilt : {Eigen::Vector3d(0.31, -0.52, 0.795), Eigen::Vector3d(0.02, 0.9, -0.43),
                                      Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.577, 0.577, 0.578)}) {
    const Eigen::Vector3d n = tilt.normalized();
    const Eigen::Vector3d p(6.1, 6.2, 6.3);
    double sum = 0;
    constexpr int kEdge = 12;  // a cube of voxels: the plane inside it is as large as one voxel of that edge says
    for (int x = 0; x < kEdge; ++x) {
      for (int y = 0; y < kEdge; ++y) {
        for (int z = 0; z < kEdge; ++z) {
          const Eigen::Vector3d corner(x, y, z);
          // A place in the voxel on the plane: random ones, dropped onto it along its main axis.
          int axis = 0;
          n.cwiseAbs().maxCoeff(&axis);
          for (int attempt = 0; attempt < 400; ++attempt) {
            Eigen::Vector3d place(in(random), in(random), in(random));
            place[axis] -= n.dot(corner + place - p) / n[axis];
            if (place[axis] <= 0 || place[axis] >= 1) continue;
            sum += internal::areaOfPoint_m2(place, n.cast<float>(), kUnit);
            break;
          }
        }
      }
    }
    const double whole = internal::areaOfPoint_m2(p / kEdge, n.cast<float>(), kEdge);
    // Voxels of which less than 1 in 400 places lies on the plane may be missing.
    EXPECT_NEAR(sum, whole, 0.002 * whole) << tilt.transpose();
  }
}

TEST(ReportAreaOfAPoint, MeanOverAllPlanes) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> in(0, 1);
  std::normal_distribution<float> part;
  double sum = 0;
  constexpr int kPlanes = 400000;
  for (int n = 0; n < kPlanes; ++n) {
    const Eigen::Vector3f normal = Eigen::Vector3f(part(random), part(random), part(random)).normalized();
    sum += internal::areaOfPoint_m2({in(random), in(random), in(random)}, normal, kUnit);
  }
  std::printf("mean area of a plane in a voxel: %.4f v^2\n", sum / kPlanes);
  EXPECT_NEAR(internal::areaOfPoint_m2({0.2, 0.2, 0.2}, {0, 0, 0}, kUnit), sum / kPlanes, 0.002);
}

TEST(ReportText, NothingEndsTheScript) {
  const std::string text = internal::scriptJson({{"<a>", "</script>\xe2\x80\xa8\xe2\x80\xa9\xff"}});
  EXPECT_EQ(text.find('<'), std::string::npos);
  for (const char c : text) EXPECT_TRUE(c >= 0x20 && c < 0x7f);
  EXPECT_EQ(nlohmann::json::parse(text).at("<a>").get<std::string>().substr(0, 9), "</script>");
}

TEST(ReportText, HashesAsThePolicyWritesThem) {
  // printf 'x' | openssl dgst -sha256 -binary | base64
  EXPECT_EQ(internal::policyHash("x"), "'sha256-LXEWQrcmsEQBYnyp+6wy9chTD7GQPMTbAiWHF5IaSIE='");
  EXPECT_EQ(internal::base64(""), "");
  EXPECT_EQ(internal::base64("ab"), "YWI=");
}

TEST(ReportNormals, AreKeptToWithinEighteenDegrees) {
  // Half a cell is 1/14 along both edges of the unfolded octahedron. In the middle of a face, at (1, 1, 1) / 3, that is
  // (1, 1, -2) / 14, or 17.4 degrees.
  for (int n = 0; n < 2000; ++n) {
    const double z = 1 - (2 * n + 1.0) / 2000, angle = 2.4 * n, r = std::sqrt(1 - z * z);
    const Eigen::Vector3f normal = Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle), z).cast<float>();
    const int code = internal::octahedralByte(normal);
    ASSERT_LT(code, 225);
    Eigen::Vector3f back(static_cast<float>(code % 15) / 7 - 1, static_cast<float>(code / 15) / 7 - 1, 0);
    back.z() = 1 - std::abs(back.x()) - std::abs(back.y());
    if (back.z() < 0) {
      const Eigen::Vector2f folded(1 - std::abs(back.y()), 1 - std::abs(back.x()));
      back.x() = std::copysign(folded.x(), back.x());
      back.y() = std::copysign(folded.y(), back.y());
    }
    EXPECT_GT(back.normalized().dot(normal), std::cos(18 * std::numbers::pi / 180)) << normal.transpose();
  }
  EXPECT_EQ(internal::octahedralByte({0, 0, 0}), 255);
}

TEST(ReportBytes, AreTheSameForTheSameFolder) {
  const test::ScratchFolder folder;
  FieldSnapshot field;
  field.voxel_size_m = 0.1;
  for (std::uint32_t id = 0; id < 3000; ++id) {
    SurfacePoint point;
    point.id = id;
    point.position_W = {0.1 * (id % 50), 0.1 * (id / 50), 0};
    field.points.push_back(point);
  }
  fs::create_directory(folder.path() / "field");
  io::writePointsPly(folder.path() / "field" / "points.ply", field, {});
  io::HtmlReportOptions options;
  options.most_points = 1000;
  const io::HtmlReport first = io::writeHtmlReport(folder.path() / "a.html", folder.path() / "field", options);
  (void)io::writeHtmlReport(folder.path() / "b.html", folder.path() / "field", options);
  EXPECT_EQ(textOf(folder.path() / "a.html"), textOf(folder.path() / "b.html"));
  EXPECT_EQ(first.points, 3000u);
  EXPECT_LE(first.drawn, 1000u);
  EXPECT_GT(first.cell_m, 0.1);
  options.most_points = 1;
  EXPECT_THROW((void)io::writeHtmlReport(folder.path() / "c.html", folder.path() / "field", options), InvalidArgument);
}

/// A folder `field` with points in a row, and the approaches to one of them, in `list`.
class ReportApproaches : public ::testing::Test {
 protected:
  ReportApproaches() {
    FieldSnapshot field;
    field.voxel_size_m = 0.1;
    for (std::uint32_t id = 0; id < 20; ++id) {
      SurfacePoint point;
      point.id = id;
      point.position_W = {0.1 * id, 1.0 / 3, 4.5e6};  // as far as UTM
      point.label = PointLabel::Accessible;
      point.reason = PointReason::None;
      point.score = 0;
      point.direction_W = {1, 0, 0};
      field.points.push_back(point);
    }
    fs::create_directory(folder_.path() / "field");
    io::writePointsPly(folder_.path() / "field" / "points.ply", field, {{"tool", "tools/long saw.stl"}});
    ApproachTarget target;
    target.point = 7;
    target.position_W = field.points[7].position_W;
    target.why = "of room";
    ApproachPath path;
    path.contact_T_WT =
        Eigen::Translation3d(target.position_W) * Eigen::Quaterniond(0.5, -0.5, 0.1, std::sqrt(1 - 0.25 - 0.25 - 0.01));
    path.pre_contact_T_WT = path.contact_T_WT * Eigen::Translation3d(0.3, 0, 0);
    path.retreat_T_WT = path.contact_T_WT * Eigen::Translation3d(0.6, 0, 0);
    target.approaches = {path, path};
    found_.targets = {target};
    options_.approaches = folder_.path() / "list";
  }

  nlohmann::json shown(const std::string& tool = "long_saw") {
    fs::create_directories(folder_.path() / "list");
    io::writeApproaches(folder_.path() / "list", found_, {tool});
    page_ = io::writeHtmlReport(folder_.path() / "x.html", folder_.path() / "field", options_);
    return factsOf(folder_.path() / "x.html").at("approaches").at("targets");
  }

  test::ScratchFolder folder_;
  Approaches found_;
  io::HtmlReportOptions options_;
  io::HtmlReport page_;
};

TEST_F(ReportApproaches, PosesAreThoseOfTheLibrary) {
  const nlohmann::json target = shown().at(0);
  EXPECT_TRUE(page_.warnings.empty() || page_.warnings[0].first.rfind("approaches.", 0) != 0);
  EXPECT_EQ(target.at("point"), 7);
  EXPECT_EQ(target.at("tool"), 0);
  EXPECT_EQ(target.at("approaches").size(), 2u);
  const ApproachPath& path = found_.targets[0].approaches[0];
  for (const auto& [name, T_WT] : {std::pair{"pre_contact", path.pre_contact_T_WT},
                                   {"contact", path.contact_T_WT},
                                   {"retreat", path.retreat_T_WT}}) {
    const auto n = target.at("approaches").at(1).at(name).get<std::vector<double>>();
    EXPECT_EQ(Eigen::Vector3d(n[0], n[1], n[2]), Eigen::Vector3d(T_WT.translation())) << name;
    // Of the quaternion, which both sides may scale to length 1.
    EXPECT_TRUE(Eigen::Quaterniond(n[3], n[4], n[5], n[6]).toRotationMatrix().isApprox(T_WT.linear(), 1e-14)) << name;
  }
  const std::string before = textOf(folder_.path() / "x.html");
  (void)shown();
  EXPECT_EQ(textOf(folder_.path() / "x.html"), before);
}

TEST_F(ReportApproaches, ViewsAreThoseOfTheLibrary) {
  NextView view;
  view.T_W_S = found_.targets[0].approaches[0].retreat_T_WT;
  view.resolves = 12.5;
  view.of_confidence = 1.5;
  view.of_unseen = 4;
  view.of_unknown = 7;
  view.travel_m = 2.25;
  view.way_is_free = true;
  NextViews views;
  views.views = {NextView(), view};
  views.confidence = 3;
  views.unseen = 5;
  views.unknown = 9;
  fs::create_directories(folder_.path() / "views");
  io::writeViews(folder_.path() / "views", views);
  io::HtmlReportOptions options;
  options.views = folder_.path() / "views";
  page_ = io::writeHtmlReport(folder_.path() / "x.html", folder_.path() / "field", options);
  // The map has none of them.
  ASSERT_FALSE(page_.warnings.empty());
  EXPECT_EQ(page_.warnings[0].first, "views.counts");
  const nlohmann::json facts = factsOf(folder_.path() / "x.html").at("views");
  EXPECT_EQ(facts.at("unresolved_points"), 17);
  nlohmann::json shown = facts.at("views").at(1);
  const auto n = shown.at("pose").get<std::vector<double>>();
  EXPECT_EQ(Eigen::Vector3d(n[0], n[1], n[2]), Eigen::Vector3d(view.T_W_S.translation()));
  EXPECT_TRUE(Eigen::Quaterniond(n[3], n[4], n[5], n[6]).toRotationMatrix().isApprox(view.T_W_S.linear(), 1e-14));
  shown.erase("pose");
  EXPECT_EQ(shown, (nlohmann::json{{"resolves", 12.5},
                                   {"of_confidence", 1.5},
                                   {"of_unseen", 4.0},
                                   {"of_unknown", 7.0},
                                   {"travel_m", 2.25},
                                   {"way_is_free", true}}));
}

TEST_F(ReportApproaches, OfAnotherToolAreSaidToBe) {
  EXPECT_TRUE(shown("saw").at(0).at("tool").is_null());
  ASSERT_FALSE(page_.warnings.empty());
  EXPECT_EQ(page_.warnings[0].first, "approaches.tool");
}

TEST_F(ReportApproaches, OfAnotherMapLeaveNoPage) {
  found_.targets[0].point = 8;
  try {
    (void)shown();
    FAIL();
  } catch (const UnusableInput& error) {
    EXPECT_EQ(error.id(), "approaches.other_map");
  }
  found_.targets[0].point = 7;
  found_.targets[0].approaches[1].retreat_T_WT.translation().x() = std::nan("");
  EXPECT_THROW((void)shown(), InputError);
  EXPECT_FALSE(fs::exists(folder_.path() / "x.html"));
}

}  // namespace
}  // namespace accessvdb
