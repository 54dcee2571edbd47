// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Mesh files: every format and unit gives the same tool, and every bad file gives a readable error.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <chrono>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>

#include "accessvdb/error.h"
#include "accessvdb/tool_geometry.h"
#include "test_meshes.h"
#include "tool/tool_kernel.h"

namespace accessvdb {
namespace {

namespace fs = std::filesystem;

class MeshReader : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("accessvdb_mesh_" + std::to_string(::getpid()) + "_" +
                                           testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path write(const std::string& name, const std::string& content) {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << content;
    return folder_ / name;
  }
  fs::path folder_;
};

void append(std::string& out, const void* data, std::size_t size) { out.append(static_cast<const char*>(data), size); }

std::string stl(const test::Mesh& m, float scale) {
  std::string out(80, ' ');
  const auto count = std::uint32_t(m.triangles.size());
  append(out, &count, 4);
  for (const auto& t : m.triangles) {
    out.append(12, '\0');
    for (std::uint32_t v : t) {
      const Eigen::Vector3f p = scale * m.vertices[v];
      append(out, p.data(), 12);
    }
    out.append(2, '\0');
  }
  return out;
}

std::string lines(const test::Mesh& m, double scale, const char* vertex, const char* face, int first) {
  std::ostringstream out;
  out.precision(9);
  for (const auto& p : m.vertices)
    out << vertex << scale * p.x() << ' ' << scale * p.y() << ' ' << scale * p.z() << '\n';
  for (const auto& t : m.triangles) out << face << t[0] + first << ' ' << t[1] + first << ' ' << t[2] + first << '\n';
  return out.str();
}

std::string plyHeader(std::size_t vertices, std::size_t faces) {
  return "ply\nformat ascii 1.0\nelement vertex " + std::to_string(vertices) +
         "\nproperty float x\nproperty float y\nproperty float z\nelement face " + std::to_string(faces) +
         "\nproperty list uchar int vertex_indices\nend_header\n";
}

std::string ply(const test::Mesh& m, double scale) {
  return plyHeader(m.vertices.size(), m.triangles.size()) + lines(m, scale, "", "3 ", 0);
}

std::string off(const test::Mesh& m, double scale) {
  return "OFF\n" + std::to_string(m.vertices.size()) + " " + std::to_string(m.triangles.size()) + " 0\n" +
         lines(m, scale, "", "3 ", 0);
}

std::string dae(const test::Mesh& m, double scale, const std::string& unit, const std::string& up,
                const std::string& translate) {
  std::ostringstream points, indices;
  points.precision(9);
  for (const auto& p : m.vertices) points << scale * p.x() << ' ' << scale * p.y() << ' ' << scale * p.z() << ' ';
  for (const auto& t : m.triangles) indices << t[0] << ' ' << t[1] << ' ' << t[2] << ' ';
  const std::string n = std::to_string(m.vertices.size()), n3 = std::to_string(3 * m.vertices.size());
  return "<?xml version=\"1.0\"?>\n<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\">"
         "<asset>" +
         unit + "<up_axis>" + up +
         "</up_axis></asset><library_geometries><geometry id=\"g\"><mesh>"
         "<source id=\"s\"><float_array id=\"a\" count=\"" +
         n3 + "\">" + points.str() +
         "</float_array>"
         "<technique_common><accessor source=\"#a\" count=\"" +
         n +
         "\" stride=\"3\"><param name=\"X\" type=\"float\"/>"
         "<param name=\"Y\" type=\"float\"/><param name=\"Z\" type=\"float\"/></accessor></technique_common></source>"
         "<vertices id=\"v\"><input semantic=\"POSITION\" source=\"#s\"/></vertices><triangles count=\"" +
         std::to_string(m.triangles.size()) + "\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><p>" +
         indices.str() +
         "</p></triangles></mesh></geometry></library_geometries><library_visual_scenes>"
         "<visual_scene id=\"w\"><node id=\"n\"><translate>" +
         translate +
         "</translate><instance_geometry url=\"#g\"/>"
         "</node></visual_scene></library_visual_scenes><scene><instance_visual_scene url=\"#w\"/></scene></COLLADA>";
}

std::string gltfBuffer(const test::Mesh& m) {
  std::string bytes;
  for (const auto& p : m.vertices) append(bytes, p.data(), 12);
  for (const auto& t : m.triangles) append(bytes, t.data(), 12);
  return bytes;
}

std::string gltf(const test::Mesh& m, const std::string& buffer_uri) {
  const std::size_t nv = m.vertices.size(), nt = m.triangles.size();
  const auto n = [](std::size_t value) { return std::to_string(value); };
  return "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],"
         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],\"buffers\":[{" +
         (buffer_uri.empty() ? "" : "\"uri\":\"" + buffer_uri + "\",") + "\"byteLength\":" + n(12 * nv + 12 * nt) +
         "}],\"bufferViews\":[{\"buffer\":0,\"byteOffset\":0,\"byteLength\":" + n(12 * nv) +
         "},{\"buffer\":0,\"byteOffset\":" + n(12 * nv) + ",\"byteLength\":" + n(12 * nt) +
         "}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":" + n(nv) +
         ",\"type\":\"VEC3\",\"min\":[-9,-9,-9],\"max\":[9,9,9]},{\"bufferView\":1,\"componentType\":5125,\"count\":" +
         n(3 * nt) + ",\"type\":\"SCALAR\"}]}";
}

std::string glb(const test::Mesh& m) {
  std::string json = gltf(m, ""), buffer = gltfBuffer(m), out = "glTF";
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const std::uint32_t header[2] = {2, std::uint32_t(12 + 8 + json.size() + 8 + buffer.size())};
  const std::uint32_t json_chunk[2] = {std::uint32_t(json.size()), 0x4E4F534A};
  const std::uint32_t bin_chunk[2] = {std::uint32_t(buffer.size()), 0x004E4942};
  append(out, header, 8);
  append(out, json_chunk, 8);
  out += json;
  append(out, bin_chunk, 8);
  return out + buffer;
}

/// Different extents, off the origin, no symmetry: any swap of axes or units shows.
test::Mesh sample() {
  test::Mesh m = test::box({0.0137f, -0.0441f, -0.0213f}, {0.3119f, 0.0523f, 0.0619f});
  m.add(test::torus({0.4013f, 0.0171f, 0.0373f}, 0.071, 0.0223, 9, 7));
  return m;
}

FieldParams kernelParams() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.01;
  params.approach.num_directions = 36;
  return params;
}

bool sameKernel(const ToolGeometry& a, const ToolGeometry& b) {
  const auto ka = internal::ToolKernel::make(a, kernelParams()), kb = internal::ToolKernel::make(b, kernelParams());
  return ka.column_begin == kb.column_begin && ka.columns.size() == kb.columns.size() &&
         std::memcmp(ka.columns.data(), kb.columns.data(), 16 * ka.columns.size()) == 0;
}

template <typename Expected>
void expectRefused(const fs::path& path, const std::string& id, const std::string& word = "",
                   std::optional<LengthUnit> unit = LengthUnit::Metre, const ToolPose& pose = {}) {
  try {
    (void)ToolGeometry::fromMesh(path, unit, pose);
    FAIL() << path << " was read";
  } catch (const Expected& error) {
    EXPECT_EQ(error.id(), id) << error.what();
    EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    EXPECT_LT(std::string(error.what()).size(), 2000u);
  } catch (const std::exception& error) {
    FAIL() << path << ": another kind of error: " << error.what();
  }
}

TEST_F(MeshReader, EveryFormatAndUnitGivesTheSameTool) {
  const test::Mesh m = sample();
  const ToolGeometry reference = ToolGeometry::fromTriangles(m.vertices, m.triangles, "reference");
  const std::string mm = "<unit name=\"millimeter\" meter=\"0.001\"/>", none;
  struct Case {
    std::string name, content;
    std::optional<LengthUnit> unit;
  };
  const std::vector<Case> cases = {
      {"m.stl", stl(m, 1), LengthUnit::Metre},
      {"cm.stl", stl(m, 100), LengthUnit::Centimetre},
      {"mm.STL", stl(m, 1000), LengthUnit::Millimetre},
      {"in.stl", stl(m, float(1 / 0.0254)), LengthUnit::Inch},
      {"mm.obj", lines(m, 1000, "v ", "f ", 1), LengthUnit::Millimetre},
      {"cm.ply", ply(m, 100), LengthUnit::Centimetre},
      {"in.off", off(m, 1 / 0.0254), LengthUnit::Inch},
      {"m.dae", dae(m, 1, none, "Z_UP", "0 0 0"), {}},
      {"mm.dae", dae(m, 1000, mm, "Z_UP", "0 0 0"), {}},
      {"mm_y.dae", dae(m, 1000, mm, "Y_UP", "0 0 0"), LengthUnit::Millimetre},
      {"wrong_unit.dae", dae(m, 1000, none, "Z_UP", "0 0 0"), LengthUnit::Millimetre},
      {"moved.dae", dae(m, 1000, mm, "X_UP", "500 0 0"), {}},
      {"side.gltf", gltf(m, "side.bin"), {}},
      {"m.glb", glb(m), {}},
      {"mm.glb", glb([&] {
         test::Mesh big = m;
         for (auto& p : big.vertices) p *= 1000;
         return big;
       }()),
       LengthUnit::Millimetre},
  };
  write("side.bin", gltfBuffer(m));
  for (const Case& c : cases) {
    ToolPose pose;
    if (c.name == "moved.dae") pose.tip = Eigen::Vector3d(500, 0, 0);  // in the file's own unit
    const ToolGeometry tool = ToolGeometry::fromMesh(write(c.name, c.content), c.unit, pose);
    EXPECT_TRUE(tool.watertight()) << c.name;
    EXPECT_EQ(tool.name(), c.name);
    // Relative 1e-6: a scaled float32 coordinate is rounded several times.
    EXPECT_LT((tool.min_T() - reference.min_T()).norm(), 1e-6) << c.name;
    EXPECT_LT((tool.max_T() - reference.max_T()).norm(), 1e-6) << c.name;
    EXPECT_TRUE(sameKernel(tool, reference)) << c.name;
  }
}

TEST_F(MeshReader, PoseTurnsTipAxisAndUpIntoTheToolFrame) {
  // In the file the body runs along -y and up is +x.
  const test::Mesh m = sample();
  test::Mesh turned;
  turned.triangles = m.triangles;
  const Eigen::Vector3f tip(1.5f, -0.25f, 0.5f);  // x_T = -y, z_T = x, so y_T = z_T x x_T = x cross -y = -z
  for (const auto& p : m.vertices) turned.vertices.push_back(tip + Eigen::Vector3f(p.z(), -p.x(), -p.y()));
  ToolPose pose;
  pose.tip = tip.cast<double>();
  pose.axis = {0, -3, 0};
  pose.up = {0.2, -0.7, 0};  // made perpendicular to the axis
  const ToolGeometry tool = ToolGeometry::fromMesh(write("a.stl", stl(turned, 1)), LengthUnit::Metre, pose);
  const ToolGeometry reference = ToolGeometry::fromTriangles(m.vertices, m.triangles, "reference");
  EXPECT_LT((tool.min_T() - reference.min_T()).norm(), 5e-7);  // float32 rounding near 1.5 m
  EXPECT_LT((tool.max_T() - reference.max_T()).norm(), 5e-7);
  EXPECT_TRUE(sameKernel(tool, reference));
  ASSERT_FALSE(tool.notes().empty());
  EXPECT_NE(tool.notes()[0].find("axis (0, -1, 0), up (1, 0, 0)"), std::string::npos) << tool.notes()[0];
}

TEST_F(MeshReader, MirroredNodeStillFacesOutwards) {
  // Boxes that share an edge are closed but not manifold, so their orientation depends only on the reader.
  test::Mesh m = test::box({0, 0, 0}, {0.1f, 0.1f, 0.1f});
  m.add(test::box({0.1f, 0.1f, 0}, {0.2f, 0.2f, 0.1f}));
  for (const char* scale : {"1 1 1", "-1 1 1", "-1 -2 -1"}) {
    const std::string placed = "0 0 0</translate><scale>" + std::string(scale) + "</scale><translate>0 0 0";
    const ToolGeometry tool = ToolGeometry::fromMesh(write("a.dae", dae(m, 1, "", "Z_UP", placed)), {});
    ASSERT_TRUE(tool.watertight());
    double volume = 0;
    for (const auto& t : tool.triangles()) {
      const Eigen::Vector3d a = tool.vertices_T()[t[0]].cast<double>(), b = tool.vertices_T()[t[1]].cast<double>(),
                            c = tool.vertices_T()[t[2]].cast<double>();
      volume += a.dot(b.cross(c)) / 6;
    }
    EXPECT_GT(volume, 0.0019) << scale;
  }
}

TEST_F(MeshReader, RefusesPosesAndUnitsThatMakeNoSense) {
  const fs::path path = write("a.stl", stl(sample(), 1));
  expectRefused<InvalidArgument>(path, "tool.unit", "LengthUnit", {});
  expectRefused<InvalidArgument>(path, "tool.unit", "0.4809", {});  // the extents as a hint
  expectRefused<InvalidArgument>(path, "tool.pose", "zero", LengthUnit::Metre, {{}, {0, 0, 0}, {0, 0, 1}});
  expectRefused<InvalidArgument>(path, "tool.pose", "finite", LengthUnit::Metre, {{}, {std::nan(""), 0, 1}, {0, 0, 1}});
  expectRefused<UnusableInput>(write("large.stl", stl(sample(), 1000)), "tool.size", "LengthUnit");
  expectRefused<UnusableInput>(path, "tool.size", "m large", LengthUnit::Millimetre);
}

TEST_F(MeshReader, RefusesFilesThatAreNoMesh) {
  const std::string good = stl(sample(), 1);
  expectRefused<InputError>(folder_ / "missing.stl", "input.unreadable", "missing.stl");
  expectRefused<InputError>(folder_, "input.unreadable");
  fs::create_directories(folder_ / "folder.stl");
  expectRefused<InputError>(folder_ / "folder.stl", "input.unreadable", "folder");
  ASSERT_EQ(::mkfifo((folder_ / "pipe.stl").c_str(), 0600), 0);
  expectRefused<InputError>(folder_ / "pipe.stl", "input.unreadable", "regular file");
  expectRefused<InputError>(write("empty.obj", ""), "input.empty");
  expectRefused<InputError>(write("lfs.stl", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"),
                            "input.lfs_pointer", "git lfs pull");
  expectRefused<InputError>(write("tool.lwo", "FORM"), "tool.format", ".lwo");
  expectRefused<InputError>(write("tool", good), "tool.format");
  expectRefused<InputError>(write("cut.stl", good.substr(0, good.size() - 50)), "tool.malformed", "announces");
  expectRefused<InputError>(write("cut_text.stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0"),
                            "tool.malformed", "truncated");
  expectRefused<InputError>(write("utf16.obj", std::string("\xff\xfev\0 \0", 6)), "tool.encoding");
  // Content of other formats that assimp knows.
  expectRefused<InputError>(write("q3d.stl", "quick3Do" + std::string(100, '\1')), "tool.malformed");
  expectRefused<UnusableInput>(write("csm.obj", "$Filename test\n$Order a\n$Points\n1 2 3\n"), "tool.no_faces");
  fs::resize_file(write("huge.stl", "x"), (std::uint64_t{256} << 20) + 1);
  expectRefused<InputError>(folder_ / "huge.stl", "input.unreadable", "at most");
}

TEST_F(MeshReader, RefusesMeshesWithoutUsableFaces) {
  expectRefused<UnusableInput>(write("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\np 1 2 3\n"), "tool.no_faces");
  expectRefused<UnusableInput>(write("line.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\n"), "tool.no_faces");
  expectRefused<UnusableInput>(write("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "tool.no_faces", "area");
  test::Mesh bad = sample();
  bad.vertices[2].x() = std::numeric_limits<float>::quiet_NaN();
  expectRefused<UnusableInput>(write("nan.stl", stl(bad, 1)), "tool.nonfinite");
  bad.vertices[2].x() = std::numeric_limits<float>::infinity();
  expectRefused<UnusableInput>(write("inf.stl", stl(bad, 1)), "tool.nonfinite");
}

TEST_F(MeshReader, PlyMustHoldWhatItsHeaderSays) {
  const test::Mesh m = sample();
  const std::string body = lines(m, 1, "", "3 ", 0);
  const std::size_t nv = m.vertices.size(), nt = m.triangles.size();
  EXPECT_NO_THROW((void)ToolGeometry::fromMesh(write("good.ply", plyHeader(nv, nt) + body), LengthUnit::Metre));
  expectRefused<InputError>(write("more.ply", plyHeader(nv, nt + 5) + body), "tool.malformed");
  expectRefused<InputError>(write("many.ply", plyHeader(nv, 4000000000) + body), "tool.malformed", "announces");
  expectRefused<InputError>(write("overflow.ply", plyHeader(nv, std::size_t(1) << 62) + body), "tool.malformed");
  expectRefused<InputError>(write("range.ply", plyHeader(3, 1) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"), "tool.malformed");
  expectRefused<InputError>(write("no_end.ply", "ply\nformat ascii 1.0\nelement vertex 3\n"), "tool.malformed");
  expectRefused<InputError>(write("strips.ply",
                                  "ply\nformat ascii 1.0\nelement tristrips 1\nproperty list int int vertex_indices\n"
                                  "end_header\n3 0 1 2\n"),
                            "tool.format", "strips");
}

TEST_F(MeshReader, GltfStaysInsideItsFolder) {
  const test::Mesh m = sample();
  write("secret/other.bin", gltfBuffer(m));
  write("mesh/side.bin", gltfBuffer(m));
  EXPECT_NO_THROW((void)ToolGeometry::fromMesh(write("mesh/good.gltf", gltf(m, "side.bin")), {}));
  expectRefused<InputError>(write("mesh/up.gltf", gltf(m, "../secret/other.bin")), "tool.malformed", "", {});
  expectRefused<InputError>(write("mesh/absolute.gltf", gltf(m, (folder_ / "secret/other.bin").string())),
                            "tool.malformed", "", {});
  fs::create_symlink(folder_ / "secret/other.bin", folder_ / "mesh/link.bin");
  expectRefused<InputError>(write("mesh/link.gltf", gltf(m, "link.bin")), "tool.malformed", "", {});
}

/// Both crashed assimp 5.2.5: an assertion in its triangulation, and an index that parses to a huge number.
TEST_F(MeshReader, SurvivesWhatEndsItsParser) {
  const test::Mesh m = test::box({0, 0, 0}, {0.1f, 0.2f, 0.3f});
  std::string broken = ply(m, 1);
  broken.replace(broken.find("\n3 0 4 2\n"), 3, "\nx ");
  expectRefused<InputError>(write("abort.ply", broken), "tool.malformed", "crashes its reader");
  broken = dae(m, 1, "", "Z_UP", "0 0 0");
  broken.replace(broken.find(" 3 7 5 "), 7, " 3 T 5 ");
  expectRefused<InputError>(write("index.dae", broken), "tool.malformed", "", {});
}

/// Every byte flip or truncation must give a tool or an Error; anything else crashes this program. Deterministic.
TEST_F(MeshReader, SurvivesDamagedFiles) {
  const test::Mesh m = test::box({0, 0, 0}, {0.1f, 0.2f, 0.3f});
  const std::map<std::string, std::string> originals = {{"a.dae", dae(m, 1, "<unit meter=\"1\"/>", "Z_UP", "0 0 0")},
                                                        {"a.ply", ply(m, 1)},
                                                        {"a.obj", lines(m, 1, "v ", "f ", 1)},
                                                        {"a.off", off(m, 1)},
                                                        {"a.glb", glb(m)},
                                                        {"a.stl", stl(m, 1)}};
  std::uint64_t state = 1;
  const auto random = [&](std::size_t below) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return std::size_t((state >> 33) % below);
  };
  int read = 0, refused = 0;
  for (const auto& [name, original] : originals) {
    for (int n = 0; n < 40; ++n) {
      std::string damaged = original;
      for (std::size_t flips = 1 + random(4); flips > 0; --flips) damaged[random(damaged.size())] = char(random(256));
      if (n % 4 == 3) damaged.resize(random(damaged.size()) + 1);
      try {
        (void)ToolGeometry::fromMesh(write(name, damaged), LengthUnit::Metre);
        ++read;
      } catch (const Error&) {
        ++refused;
      }
    }
  }
  EXPECT_EQ(read + refused, 240);
  EXPECT_GT(read, 10);
  EXPECT_GT(refused, 10);
}

TEST(MeshData, EveryFileGetsAnAnswer) {
  int files = 0;
  for (const char* folder : {"bad_inputs", "meshes", "tools"}) {
    const fs::path path = test::testData() / folder;
    if (!fs::is_directory(path)) GTEST_SKIP() << "missing: " << path;
    for (const auto& entry : fs::directory_iterator(path)) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
      // Without the memory limit, which sanitizers do not tolerate, it fills the machine until the time-out.
      if (entry.path().filename() == "OutOfMemory.off") continue;
#endif
      ++files;
      try {
        const ToolGeometry tool = ToolGeometry::fromMesh(entry.path(), LengthUnit::Metre);
        EXPECT_FALSE(tool.triangles().empty()) << entry.path();
      } catch (const Error& error) {
        EXPECT_TRUE(error.code() == ErrorCode::Input || error.code() == ErrorCode::Unusable) << error.what();
        EXPECT_FALSE(error.advice().empty()) << error.what();
      }
    }
  }
  EXPECT_GT(files, 15);
  const auto bad = [](const char* name) { return test::testData() / "bad_inputs" / name; };
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  expectRefused<InputError>(bad("OutOfMemory.off"), "tool.malformed", "memory");
#endif
  expectRefused<InputError>(bad("malformed.obj"), "tool.malformed");
  for (const char* name : {"empty.obj", "empty.ply"}) expectRefused<InputError>(bad(name), "input.empty");
  for (const char* name : {"point_cloud.obj", "points.ply", "issue623.ply"}) {
    expectRefused<UnusableInput>(bad(name), "tool.no_faces");
  }
  expectRefused<InputError>(bad("box_UTF16BE.obj"), "tool.encoding");
}

/// None of these tools has its tip at the mesh's origin and its body along +x, as their README says.
TEST(MeshData, RealToolsAreWarnedAbout) {
  const auto warning = [](const fs::path& path, const ToolPose& pose) {
    std::string found;
    const ToolGeometry tool = ToolGeometry::fromMesh(path, LengthUnit::Metre, pose);
    for (const std::string& note : tool.notes()) {
      if (note.starts_with("warning: ")) found += note;
    }
    return found;
  };
  const fs::path cutter = test::testData() / "tools" / "new_cutter_decimated.stl";
  if (!fs::exists(cutter)) GTEST_SKIP() << "missing: " << cutter;
  EXPECT_NE(warning(cutter, {}).find("on the far side of the tip"), std::string::npos) << warning(cutter, {});
  const ToolPose from_its_shape = {Eigen::Vector3d(-0.096, -0.12, -0.006), {0, 1, 0}, {0, 0, 1}};
  EXPECT_EQ(warning(cutter, from_its_shape), "");
}

/// The orchard cutter, z up as STL (decimated) and y up as OBJ. Mouth, axis and up are taken from its shape.
TEST(MeshData, SameCutterFromStlAndObj) {
  const fs::path a = test::testData() / "tools" / "new_cutter_decimated.stl",
                 b = test::testData() / "tools" / "new-cutter.obj";
  for (const auto& path : {a, b}) {
    if (!fs::exists(path)) GTEST_SKIP() << "missing: " << path;
  }
  const ToolGeometry from_stl =
      ToolGeometry::fromMesh(a, LengthUnit::Metre, {Eigen::Vector3d(-0.096, -0.12, -0.006), {0, 1, 0}, {0, 0, 1}});
  const ToolGeometry from_obj =
      ToolGeometry::fromMesh(b, LengthUnit::Metre, {Eigen::Vector3d(-0.096, -0.006, 0.12), {0, 0, -1}, {0, 1, 0}});
  EXPECT_TRUE(from_stl.watertight());
  EXPECT_TRUE(from_obj.watertight());
  EXPECT_LT((from_stl.min_T() - from_obj.min_T()).norm(), 0.0005);  // decimation moved vertices by up to 0.3 mm
  EXPECT_LT((from_stl.max_T() - from_obj.max_T()).norm(), 0.0005);
  const auto ka = internal::ToolKernel::make(from_stl, kernelParams()),
             kb = internal::ToolKernel::make(from_obj, kernelParams());
  for (std::size_t d = 0; d < 36; ++d) {
    std::map<std::array<int, 3>, int> seen;
    for (const auto* kernel : {&ka, &kb}) {
      for (std::uint32_t n = kernel->column_begin[d]; n < kernel->column_begin[d + 1]; ++n) {
        const auto& column = kernel->columns[n];
        for (int bit = 0; bit < 64; ++bit) {
          if (column.bits >> bit & 1) ++seen[{column.dx, column.dy, column.dz + bit}];
        }
      }
    }
    const auto different = std::count_if(seen.begin(), seen.end(), [](const auto& cell) { return cell.second != 2; });
    // 0.3 mm of a 10 mm cell, over the share of cells that the surface passes: a few per cent of all.
    EXPECT_LT(double(different), 0.04 * double(ka.voxel_count[d])) << "direction " << d;
  }
}

}  // namespace
}  // namespace accessvdb
