// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Repairs, watertightness, digest and notes of meshes given as triangles.
#include "accessvdb/tool_geometry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include "accessvdb/error.h"
#include "support/scratch_folder.h"
#include "test_meshes.h"
#include "tool/mesh_repair.h"

namespace accessvdb {
namespace {

ToolGeometry toolOf(const test::Mesh& mesh) { return ToolGeometry::fromTriangles(mesh.vertices, mesh.triangles, "t"); }

bool hasNote(const ToolGeometry& tool, const std::string& part) {
  return std::any_of(tool.notes().begin(), tool.notes().end(),
                     [&](const std::string& note) { return note.find(part) != note.npos; });
}

double volumeOf(const ToolGeometry& tool) {
  double volume = 0;
  for (const auto& t : tool.triangles()) {
    const Eigen::Vector3d a = tool.vertices_T()[t[0]].cast<double>(), b = tool.vertices_T()[t[1]].cast<double>(),
                          c = tool.vertices_T()[t[2]].cast<double>();
    volume += (a.x() * (b.y() * c.z() - b.z() * c.y()) - a.y() * (b.x() * c.z() - b.z() * c.x()) +
               a.z() * (b.x() * c.y() - b.y() * c.x())) /
              6;
  }
  return volume;
}

const test::Mesh kBox = test::box({0, -0.1f, -0.2f}, {0.5f, 0.1f, 0.2f});  // 0.04 m3

/// As in an STL: three separate vertices per triangle.
test::Mesh soupOf(const test::Mesh& mesh) {
  test::Mesh soup;
  for (const auto& t : mesh.triangles) {
    const auto base = std::uint32_t(soup.vertices.size());
    for (std::uint32_t v : t) soup.vertices.push_back(mesh.vertices[v]);
    soup.triangles.push_back({base, base + 1, base + 2});
  }
  return soup;
}

TEST(ToolGeometry, TriangleSoupIsWeldedAndClosed) {
  const ToolGeometry tool = toolOf(soupOf(kBox));
  EXPECT_TRUE(tool.watertight());
  EXPECT_EQ(tool.vertices_T().size(), 8u);
  EXPECT_EQ(tool.triangles().size(), 12u);
  EXPECT_NEAR(volumeOf(tool), 0.04, 1e-8);
  EXPECT_FLOAT_EQ(tool.reach_m(), std::sqrt(0.25f + 0.01f + 0.04f));
  EXPECT_EQ(tool.name(), "t");
  EXPECT_TRUE(tool.notes().empty());
}

TEST(ToolGeometry, NearVerticesAreJoinedWhereThatClosesTheMesh) {
  test::Mesh soup = soupOf(kBox);
  for (std::size_t n = 0; n < soup.vertices.size(); ++n) soup.vertices[n].x() += 1e-7f * float(n % 3);
  const ToolGeometry tool = toolOf(soup);
  EXPECT_TRUE(tool.watertight());
  EXPECT_TRUE(hasNote(tool, "joined"));
  for (std::size_t n = 0; n < soup.vertices.size(); ++n) soup.vertices[n].x() += 1e-4f * float(n % 3);
  EXPECT_FALSE(toolOf(soup).watertight()) << "a gap of a tenth of a millimetre is a gap";
}

TEST(ToolGeometry, OpenMeshIsCountedAndSaidToBeOpen) {
  test::Mesh open = kBox;
  open.triangles.pop_back();
  const ToolGeometry tool = toolOf(open);
  EXPECT_FALSE(tool.watertight());
  EXPECT_TRUE(hasNote(tool, "3 open edges"));
}

TEST(ToolGeometry, FlippedTrianglesAreTurnedAndCounted) {
  for (std::size_t flips : {1u, 3u, 5u}) {
    test::Mesh mesh = kBox;
    for (std::size_t n = 0; n < flips; ++n) std::swap(mesh.triangles[2 * n][0], mesh.triangles[2 * n][1]);
    const ToolGeometry tool = toolOf(mesh);
    EXPECT_TRUE(tool.watertight());
    EXPECT_TRUE(hasNote(tool, std::to_string(flips) + " triangles flipped")) << flips;
    EXPECT_NEAR(volumeOf(tool), 0.04, 1e-8);
  }
}

TEST(ToolGeometry, InsideOutShellFacesOutwardsAgain) {
  test::Mesh mesh = kBox;
  for (auto& t : mesh.triangles) std::swap(t[0], t[1]);
  mesh.add(test::box({0.4f, -0.05f, -0.05f}, {0.9f, 0.05f, 0.05f}));
  EXPECT_NEAR(volumeOf(toolOf(mesh)), 0.04 + 0.005, 1e-8);
}

TEST(ToolGeometry, DuplicatesAndTrianglesWithoutAreaAreLeftOut) {
  test::Mesh mesh = kBox;
  mesh.triangles.push_back({mesh.triangles[3][1], mesh.triangles[3][2], mesh.triangles[3][0]});
  mesh.triangles.push_back({2, 2, 5});
  mesh.triangles.push_back({0, 1, 1});
  const ToolGeometry tool = toolOf(mesh);
  EXPECT_TRUE(tool.watertight());
  EXPECT_EQ(tool.triangles().size(), 12u);
  EXPECT_TRUE(hasNote(tool, "2 triangles without area removed"));
  EXPECT_TRUE(hasNote(tool, "1 duplicate"));
}

TEST(ToolGeometry, NeedleThatClosesTheSurfaceIsKept) {
  // A vertex halfway along the edge 0-1 is used on one side only; a triangle without area joins the two sides.
  test::Mesh mesh = kBox;
  mesh.vertices.push_back(0.5f * (mesh.vertices[0] + mesh.vertices[1]));
  mesh.triangles[0] = {0, 2, 8};  // was 0 2 1
  mesh.triangles.push_back({8, 2, 1});
  EXPECT_FALSE(toolOf(mesh).watertight());
  mesh.triangles.push_back({0, 8, 1});
  const ToolGeometry tool = toolOf(mesh);
  EXPECT_TRUE(tool.watertight());
  EXPECT_TRUE(hasNote(tool, "1 triangles without area kept"));
  EXPECT_NEAR(volumeOf(tool), 0.04, 1e-8);
}

TEST(ToolGeometry, ShellsThatTouchAlongAnEdgeAreClosed) {
  test::Mesh mesh = test::box({0, 0, 0}, {0.1f, 0.1f, 0.1f});
  mesh.add(test::box({0.1f, 0.1f, 0}, {0.2f, 0.2f, 0.1f}));
  EXPECT_TRUE(toolOf(mesh).watertight());
}

TEST(ToolGeometry, OneSidedSurfaceHasNoInside) {
  // The six-vertex projective plane: every edge has two triangles, yet it cannot be oriented.
  test::Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {0.1f, 0, 0}, {0, 0.1f, 0}, {0, 0, 0.1f}, {0.1f, 0.1f, 0.02f}, {0.03f, 0.1f, 0.1f}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 1},
                    {1, 2, 4}, {2, 3, 5}, {3, 4, 1}, {4, 5, 2}, {5, 1, 3}};
  EXPECT_FALSE(toolOf(mesh).watertight());
}

TEST(ToolGeometry, DigestDependsOnShapeAlone) {
  const std::string digest = toolOf(kBox).sha256();
  EXPECT_EQ(digest.size(), 64u);
  EXPECT_EQ(digest.find_first_not_of("0123456789abcdef"), digest.npos);
  EXPECT_EQ(ToolGeometry::fromTriangles(kBox.vertices, kBox.triangles, "other name").sha256(), digest);
  test::Mesh moved = kBox;
  moved.vertices[3].z() = std::nextafter(moved.vertices[3].z(), 1.f);
  EXPECT_NE(toolOf(moved).sha256(), digest);
  test::Mesh fewer = kBox;
  fewer.triangles.pop_back();
  EXPECT_NE(toolOf(fewer).sha256(), digest);
}

TEST(ToolGeometry, NotesWhatLooksLikeAWrongTipOrAxis) {
  EXPECT_TRUE(hasNote(toolOf(test::box({0.1f, -0.1f, -0.1f}, {0.5f, 0.1f, 0.1f})), "tip is 0.1 m away"));
  EXPECT_FALSE(hasNote(toolOf(test::box({0.03f, -0.1f, -0.1f}, {0.5f, 0.1f, 0.1f})), "tip"));
  EXPECT_TRUE(hasNote(toolOf(test::box({-0.5f, -0.1f, -0.1f}, {0.02f, 0.1f, 0.1f})), "far side of the tip"));
  // A hook reaches past the tip, but its centroid does not: nothing is wrong with it.
  EXPECT_FALSE(hasNote(toolOf(test::box({-0.2f, -0.1f, -0.02f}, {0.3f, 0.1f, 0.1f})), "warning"));
}

TEST(ToolGeometry, TheTipBetweenTheFingersOfAGripperIsNoMistake) {
  test::Mesh fingers = test::box({0, 0.1f, -0.02f}, {0.4f, 0.14f, 0.02f});
  const test::Mesh other = test::box({0, -0.14f, -0.02f}, {0.4f, -0.1f, 0.02f});
  for (const auto& t : other.triangles) fingers.triangles.push_back({t[0] + 8, t[1] + 8, t[2] + 8});
  fingers.vertices.insert(fingers.vertices.end(), other.vertices.begin(), other.vertices.end());
  EXPECT_FALSE(hasNote(toolOf(fingers), "warning"));
  for (Eigen::Vector3f& p : fingers.vertices) p.y() += 0.3f;
  EXPECT_TRUE(hasNote(toolOf(fingers), "tip is 0.16 m away"));
}

/// A closed bar along the mesh's x, from 20 to 320 millimetres, off the axis by 40 in y.
std::filesystem::path writeBar(const test::ScratchFolder& folder) {
  const test::Mesh bar = test::box({20, 35, -5}, {320, 45, 5});
  std::ofstream file(folder / "bar.obj");
  for (const Eigen::Vector3f& p : bar.vertices) file << "v " << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
  for (const auto& t : bar.triangles) file << "f " << t[0] + 1 << ' ' << t[1] + 1 << ' ' << t[2] + 1 << '\n';
  return folder / "bar.obj";
}

TEST(ToolGeometry, ADefaultTipOffTheMeshIsWarnedOfWithTheLikelyOne) {
  const test::ScratchFolder folder;
  const auto bar = writeBar(folder);
  const ToolGeometry tool = ToolGeometry::fromMesh(bar, LengthUnit::Millimetre, {});
  EXPECT_TRUE(
      hasNote(tool, "warning: the mesh's origin, which is the tip unless ToolPose::tip is set, is 0.04031 m away"));
  EXPECT_TRUE(
      hasNote(tool,
              "the other may be the mount: ToolPose::tip=20,40,0 ToolPose::axis=1,0,0, or ToolPose::tip=320,40,0 "
              "ToolPose::axis=-1,0,0; or check LengthUnit"));
  // A tip that somebody chose may be a little off: 35 mm of 300 is not, 25 mm is.
  const auto chosen = [&](double y) {
    return ToolGeometry::fromMesh(bar, LengthUnit::Millimetre, {.tip = Eigen::Vector3d(20, y, 0)});
  };
  EXPECT_TRUE(hasNote(chosen(0), "warning: the tip is 0.035 m away"));
  EXPECT_FALSE(hasNote(chosen(10), "warning"));
  EXPECT_FALSE(hasNote(chosen(40), "warning"));  // what was suggested
}

TEST(ToolGeometry, AnAxisThatRunsTheWrongWayIsWarnedOfWithTheLikelyOne) {
  const test::ScratchFolder folder;
  const auto bar = writeBar(folder);
  ToolPose pose = {.tip = Eigen::Vector3d(320, 40, 0)};
  const ToolGeometry tool = ToolGeometry::fromMesh(bar, LengthUnit::Millimetre, pose);
  EXPECT_TRUE(hasNote(tool, "warning: the tool's centroid is 0.15 m on the far side of the tip"));
  EXPECT_TRUE(
      hasNote(tool, "ToolPose::tip=20,40,0 ToolPose::axis=1,0,0, or ToolPose::tip=320,40,0 ToolPose::axis=-1,0,0"));
  pose.axis = -pose.axis;  // what was suggested
  EXPECT_FALSE(hasNote(ToolGeometry::fromMesh(bar, LengthUnit::Millimetre, pose), "warning"));
}

TEST(ToolGeometry, AnAxisAlongUpPicksAnotherUp) {
  const test::ScratchFolder folder;
  const auto bar = writeBar(folder);
  ToolPose pose = {.tip = Eigen::Vector3d(0, 0, 5), .axis = {0, 0, -1}};
  const ToolGeometry tool = ToolGeometry::fromMesh(bar, LengthUnit::Millimetre, pose);
  EXPECT_TRUE(hasNote(tool, "(1,0,0) of the mesh is up instead"));
  EXPECT_TRUE(tool.min_T().isApprox(Eigen::Vector3f(0, 0.035f, 0.02f), 1e-5f)) << tool.min_T().transpose();
  EXPECT_TRUE(tool.max_T().isApprox(Eigen::Vector3f(0.01f, 0.045f, 0.32f), 1e-5f)) << tool.max_T().transpose();
}

TEST(ToolGeometry, ControlCharactersInANameAreEscaped) {
  EXPECT_EQ(ToolGeometry::fromTriangles(kBox.vertices, kBox.triangles, "a\nb\x7f").name(), "a\\x0ab\\x7f");
}

TEST(ToolGeometry, BuiltInToolsAreNotWarnedOf) {
  for (const char* name : {"builtin:pencil", "builtin:pruner"})
    EXPECT_FALSE(hasNote(ToolGeometry::builtin(name), "warning")) << name;
}

TEST(ToolGeometry, RefusesWhatIsNoSurface) {
  test::Mesh mesh = kBox;
  mesh.vertices[2].y() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)toolOf(mesh), UnusableInput);
  mesh.vertices[2].y() = std::numeric_limits<float>::infinity();
  EXPECT_THROW((void)toolOf(mesh), UnusableInput);
  mesh = kBox;
  mesh.triangles[4][1] = 8;
  EXPECT_THROW((void)toolOf(mesh), InvalidArgument);
  mesh.triangles = {{0, 0, 1}, {2, 3, 3}};
  EXPECT_THROW((void)toolOf(mesh), UnusableInput);
  mesh.triangles.clear();
  EXPECT_THROW((void)toolOf(mesh), UnusableInput);
}

}  // namespace
}  // namespace accessvdb
