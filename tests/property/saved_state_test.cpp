// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Saved states: a field that was saved and loaded goes on like one that was not, bit for bit; a file that is damaged
/// anywhere is refused.
#include "accessvdb/saved_state.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <ostream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "field/rules_version.h"
#include "field/state_head.h"
#include "field/state_sections.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

namespace fs = std::filesystem;

/// Scans, as scans or as rays that each have their own sensor position, and where they are interrupted.
struct Stream {
  FieldParams params;
  std::vector<Scan> scans;
  bool ray_cloud = false;
  std::size_t stop = 0;
};

void integrate(AccessibilityField& field, const Stream& stream, std::size_t from, std::size_t to) {
  for (std::size_t n = from; n < to; ++n) {
    const Scan& scan = stream.scans[n];
    if (!stream.ray_cloud) {
      field.integrateScan(scan.points_S, scan.T_W_S);
      continue;
    }
    std::vector<Eigen::Vector3d> points_W, sensors_W;
    for (const Eigen::Vector3f& p_S : scan.points_S) {
      points_W.push_back(scan.T_W_S * p_S.cast<double>());
      sensors_W.push_back(scan.T_W_S.translation() +
                          Eigen::Vector3d(0, 1e-5 * static_cast<double>(sensors_W.size()), 0));
    }
    field.integrateRays(points_W, sensors_W);
  }
}

FieldParams cpuParams(double voxel_size_m = 0.05) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.range_noise_m = 0.01;
  params.backend = BackendKind::Cpu;
  params.threads = 2;
  params.approach.num_directions = 36;
  return params;
}

/// BackendKind::Cuda with ACCESSVDB_STATE_DEVICE=cuda: the loaded field is on the GPU, all others on the CPU.
BackendKind loadBackend() { return backendNamedBy("ACCESSVDB_STATE_DEVICE"); }

Stream randomStream(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto oneOf = [&](auto... values) {
    const std::array all = {values...};
    return all[random() % all.size()];
  };
  Stream stream;
  stream.params = cpuParams(oneOf(0.02, 0.03, 0.05));
  stream.params.tsdf.max_weight = oneOf(5u, 4095u);
  stream.params.tsdf.clamp_min_m = oneOf(0.0, -0.02);
  stream.params.tsdf.region = oneOf(UpdateRegion::DoubleCone, UpdateRegion::FullCube);
  stream.params.tsdf.cleared_radius_voxels = oneOf(0.0, 2.5);
  stream.params.approach.num_directions = oneOf(36, 130, 180, 256);
  stream.params.approach.corridor_length_m = oneOf(0.0, 0.6);
  stream.params.approach.viewpoints = oneOf(false, false, true);
  stream.params.scoring.mean_positions = oneOf(true, true, false);
  stream.params.scoring.neighbourhood_weight = oneOf(true, true, false);
  // By number: coins fell on the same side for the first seeds.
  stream.params.mirror_distance = seed % 2 == 0;
  if (seed % 3 == 0) stream.params.origin_W = {{0.25, -0.125, 1.0 / 3}};
  stream.ray_cloud = oneOf(false, true);
  stream.scans = wallScans(seed, 6, oneOf(600, 1500));
  stream.stop = random() % (stream.scans.size() + 1);
  if (seed % 6 == 0) stream.params.window = FieldWindow{{0, 0}, {128, 128}};
  return stream;
}

std::string bytesOf(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
void writeBytes(const fs::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}
std::string plyOf(const AccessibilityField& field, const fs::path& file) {
  io::writePointsPly(file, field.snapshot(), {});
  return bytesOf(file);
}

/// The mirror of distances, which no label depends on, against the map.
void expectDistancesMirrored(const AccessibilityField& field) {
  if (!field.params().mirror_distance || field.deviceName() != "cpu") return;
  const DeviceView view = field.hostView();
  const auto distances = field.volume().distance();
  std::size_t observed = 0;
  for (auto voxel = distances->cbeginValueOn(); voxel; ++voxel, ++observed) {
    const Eigen::Vector3d ijk(voxel.getCoord().x(), voxel.getCoord().y(), voxel.getCoord().z());
    const Eigen::Vector3d p_W = field.origin_W() + field.params().tsdf.voxel_size_m * ijk;
    ASSERT_EQ(view.distanceAt(p_W.data()), *voxel);
  }
  EXPECT_EQ(observed, field.volume().activeVoxelCount());
}

/// @return what the stream ends with
FieldSnapshot expectGoesOn(const Stream& stream, const ScratchFolder& folder) {
  AccessibilityField straight(armTool(), stream.params);
  integrate(straight, stream, 0, stream.stop);
  straight.saveState(folder / "a.avst");
  AccessibilityField loaded = AccessibilityField::loadState(folder / "a.avst", armTool(), loadBackend(), 1);
  expectSame(straight.snapshot(), loaded.snapshot());
  expectSameMap(straight.volume(), loaded.volume());
  expectDistancesMirrored(loaded);
  EXPECT_EQ(straight.params().describe(), loaded.params().describe());
  loaded.saveState(folder / "b.avst");
  EXPECT_EQ(bytesOf(folder / "a.avst"), bytesOf(folder / "b.avst"));

  integrate(straight, stream, stream.stop, stream.scans.size());
  integrate(loaded, stream, stream.stop, stream.scans.size());
  expectSameMap(straight.volume(), loaded.volume());
  straight.update();
  loaded.update();
  expectSame(straight.snapshot(), loaded.snapshot());
  EXPECT_EQ(plyOf(straight, folder / "a.ply"), plyOf(loaded, folder / "b.ply"));
  expectDistancesMirrored(loaded);
  straight.saveState(folder / "a.avst");
  loaded.saveState(folder / "b.avst");
  EXPECT_EQ(bytesOf(folder / "a.avst"), bytesOf(folder / "b.avst"));
  return straight.snapshot();
}

/// A few streams; ACCESSVDB_STATE_STREAMS=N for more, ACCESSVDB_STATE_SEED for the first one's seed.
TEST(SavedState, GoesOnBitForBit) {
  const auto number = [](const char* name, unsigned long fallback) {
    const char* text = std::getenv(name);
    return text == nullptr ? fallback : std::strtoul(text, nullptr, 10);
  };
  const std::uint64_t first = number("ACCESSVDB_STATE_SEED", 1), count = number("ACCESSVDB_STATE_STREAMS", 6);
  const ScratchFolder folder;
  std::size_t accessible = 0, blocked = 0;
  for (std::uint64_t seed = first; seed < first + count && !HasFailure(); ++seed) {
    SCOPED_TRACE("ACCESSVDB_STATE_SEED=" + std::to_string(seed));
    const FieldSnapshot end = expectGoesOn(randomStream(seed), folder);
    accessible += end.count(PointLabel::Accessible);
    blocked += end.count(PointLabel::Blocked);
  }
  EXPECT_GT(accessible, 50u);
  EXPECT_GT(blocked, 50u);
}

/// With sets of orientations, which only then are part of the file.
TEST(SavedState, OfOrientationsGoesOnBitForBit) {
  const ScratchFolder folder;
  std::vector<ToolOrientation> list;
  for (int n = 0; n < 70; ++n) list.push_back(orientationOf(37.0 * n, 90 * std::sin(n), 11.0 * n));
  for (const OrientationSet& orientations :
       {OrientationSet::sphere(12.5), OrientationSet::pitch(-60, 90, 30), OrientationSet::of(list)}) {
    SCOPED_TRACE(orientations.text());
    Stream stream = {cpuParams(), wallScans(7, 6, 1500), false, 3};
    stream.params.approach.orientations = orientations;
    expectVaried(expectGoesOn(stream, folder));
    const SavedState state = inspectState(folder / "a.avst");
    EXPECT_EQ(state.params.describe(), AccessibilityField(armTool(), stream.params).params().describe());
    ASSERT_EQ(state.params.approach.orientations.list.size(), orientations.list.size());
    for (std::size_t n = 0; n < orientations.list.size(); ++n) {
      EXPECT_EQ(state.params.approach.orientations.list[n].R_WT, orientations.list[n].R_WT);
    }
  }
}

/// The number of rolls is part of the file where the tool rolls, whether it was chosen or follows from the rule.
TEST(SavedState, OfAToolThatRollsGoesOnBitForBit) {
  const ScratchFolder folder;
  for (const auto& [orientations, rolls, stored] : {std::tuple{OrientationSet::sphere(30), 0, 12},
                                                    {OrientationSet::sphere(30), 5, 5},
                                                    {OrientationSet::yaw(), 3, 3},
                                                    {OrientationSet::sphere(30), 1, 1}}) {
    SCOPED_TRACE(orientations.text() + ", rolls " + std::to_string(rolls));
    Stream stream = {cpuParams(), wallScans(7, 6, 1500), false, 3};
    stream.params.approach.orientations = orientations;
    stream.params.approach.rolls = rolls;
    expectVaried(expectGoesOn(stream, folder));
    EXPECT_EQ(inspectState(folder / "a.avst").params.approach.rolls, stored);
  }
}

TEST(SavedState, KeepsLabelsAfterUpdates) {
  const ScratchFolder folder;
  Stream stream = {cpuParams(), wallScans(3, 8, 1500), false, 5};
  for (const int budget : {0, 100}) {
    stream.params.update.budget_points = budget;
    AccessibilityField straight(armTool(), stream.params);
    const auto update_all = [](AccessibilityField& field) {
      while (field.update().backlog > 0) {
      }
    };
    const auto compare = [](const FieldSnapshot& a, const FieldSnapshot& b) {
      ASSERT_EQ(a.points.size(), b.points.size());
      for (std::size_t n = 0; n < a.points.size(); ++n) {
        ASSERT_EQ(a.points[n].position_W, b.points[n].position_W);
        ASSERT_EQ(a.points[n].label, b.points[n].label);
        if (a.points[n].label != PointLabel::Accessible) continue;
        ASSERT_EQ(a.points[n].score, b.points[n].score);
        ASSERT_EQ(a.points[n].direction, b.points[n].direction);
      }
    };
    for (std::size_t n = 0; n < stream.stop; ++n) {
      integrate(straight, stream, n, n + 1);
      update_all(straight);
    }
    straight.saveState(folder / "scored.avst");
    AccessibilityField loaded = AccessibilityField::loadState(folder / "scored.avst", armTool(), loadBackend());
    compare(straight.snapshot(), loaded.snapshot());
    const SurfacePoint first = straight.snapshot().accessible().at(0);
    ASSERT_TRUE(loaded.pointAt(first.position_W));
    EXPECT_EQ(loaded.pointAt(first.position_W)->direction, first.direction);
    loaded.saveState(folder / "again.avst");
    EXPECT_EQ(bytesOf(folder / "scored.avst"), bytesOf(folder / "again.avst"));
    for (std::size_t n = stream.stop; n < stream.scans.size(); ++n) {
      integrate(straight, stream, n, n + 1);
      integrate(loaded, stream, n, n + 1);
      update_all(straight);
      update_all(loaded);
      compare(straight.snapshot(), loaded.snapshot());
    }
    expectVaried(loaded.snapshot());
  }
}

TEST(SavedState, HasTheSameBytesForAnyNumberOfThreads) {
  const ScratchFolder folder;
  const std::vector<Scan> scans = wallScans(4, 5, 3000);
  for (const int threads : {1, 2, 5}) {
    Stream stream = {cpuParams(0.02), scans, false, 0};
    stream.params.threads = threads;
    AccessibilityField field(armTool(), stream.params);
    integrate(field, stream, 0, scans.size());
    field.saveState(folder / std::to_string(threads));
  }
  EXPECT_EQ(bytesOf(folder / "1"), bytesOf(folder / "2"));
  EXPECT_EQ(bytesOf(folder / "1"), bytesOf(folder / "5"));
  EXPECT_GT(bytesOf(folder / "1").size(), 1'000'000u);
}

TEST(SavedState, SaysWhatItIs) {
  const ScratchFolder folder;
  Stream stream = {cpuParams(0.1), wallScans(5, 3, 200), false, 0};
  stream.params.tsdf.max_range_m = 4.1;
  AccessibilityField field(armTool(), stream.params);
  integrate(field, stream, 0, 3);
  field.saveState(folder / "s.avst");
  const SavedState state = inspectState(folder / "s.avst");
  EXPECT_EQ(state.scans, 3u);
  EXPECT_EQ(state.points, field.snapshot().points.size());
  EXPECT_EQ(state.leaves, field.volume().leafCount());
  EXPECT_EQ(state.tool_sha256, armTool().sha256());
  EXPECT_FALSE(state.updated);
  EXPECT_EQ(state.params.describe(), field.params().describe());
  EXPECT_EQ(state.params.tsdf.max_range_m, 4.1);
  EXPECT_EQ(state.sha256.size(), 64u);
  field.update();
  field.saveState(folder / "s.avst");
  EXPECT_TRUE(inspectState(folder / "s.avst").updated);
  EXPECT_NE(inspectState(folder / "s.avst").sha256, state.sha256);
}

/// A small state, for damage.
class DamagedState : public testing::Test {
 protected:
  void SetUp() override {
    Stream stream = {cpuParams(0.1), wallScans(6, 2, 60), true, 0};
    stream.params.approach.num_directions = 8;
    stream.params.approach.viewpoints = true;  // so that there are sensor positions
    AccessibilityField field(pen(), stream.params);
    integrate(field, stream, 0, 2);
    field.saveState(file());
    good_ = bytesOf(file());
  }
  static ToolGeometry pen() { return boxTool({0, -0.1f, -0.1f}, {0.4f, 0.1f, 0.1f}); }
  [[nodiscard]] fs::path file() const { return folder_ / "state.avst"; }
  void load() const { (void)AccessibilityField::loadState(file(), pen(), BackendKind::Cpu, 1); }

  /// @return id and text of the error  @param bytes  of the file
  std::string refusalOf(const std::string& bytes) const {
    writeBytes(file(), bytes);
    try {
      load();
    } catch (const InputError& error) {
      return error.id() + " " + error.what();
    } catch (const UnusableInput& error) {
      return error.id() + " " + error.what();
    }
    return "";
  }

  /// Begin and length of the content of a section.
  struct Place {
    std::size_t begin, bytes;
  };
  [[nodiscard]] Place placeOf(const std::string& name) const {
    std::size_t at = internal::kStateMagic.size();
    while (at < good_.size()) {
      std::uint64_t bytes = 0;
      std::memcpy(&bytes, good_.data() + at + 8, 8);
      if (std::string(good_.c_str() + at) == name) return {at + 16, bytes};
      at += internal::kSectionFrameBytes + bytes;
    }
    ADD_FAILURE() << "no section " << name;
    return {0, 0};
  }
  /// The state with contents changed and the hashes made anew. @param change  (name, content)
  [[nodiscard]] std::string rehashed(const std::function<void(const std::string&, std::string&)>& change) const {
    std::ostringstream out;
    internal::SectionWriter writer(out);
    for (const std::string name : {"head", "leaves", "poses", "points"}) {
      const Place place = placeOf(name);
      std::string content = good_.substr(place.begin, place.bytes);
      change(name, content);
      writer.begin(name, content.size());
      writer.write(content.data(), content.size());
      writer.end();
    }
    return out.str();
  }
  [[nodiscard]] std::string withHead(const std::function<void(internal::StateHead&)>& change) const {
    return rehashed([&](const std::string& name, std::string& content) {
      if (name != "head") return;
      auto head = internal::headFrom({content.begin(), content.end()});
      ASSERT_TRUE(head);
      change(*head);
      const std::vector<char> bytes = internal::bytesOf(*head);
      content.assign(bytes.begin(), bytes.end());
    });
  }

  ScratchFolder folder_;
  std::string good_;
};

TEST_F(DamagedState, IsRefusedWhereverAByteDiffers) {
  EXPECT_NO_THROW(load());
  EXPECT_EQ(rehashed([](const auto&, auto&) {}), good_);
  std::mt19937_64 random(7);
  for (int n = 0; n < 300; ++n) {
    const std::size_t at = n < 200 ? random() % good_.size() : random() % 600;  // more of them in the head
    std::string bad = good_;
    bad[at] = static_cast<char>(bad[at] ^ (1 << random() % 8));
    ASSERT_NE(refusalOf(bad), "") << "byte " << at << " of " << good_.size();
  }
}

TEST_F(DamagedState, IsRefusedIfTruncatedOrTooLong) {
  std::mt19937_64 random(8);
  for (int n = 0; n < 100; ++n) {
    const std::size_t kept = n < 80 ? random() % good_.size() : static_cast<std::size_t>(n - 80);
    ASSERT_NE(refusalOf(good_.substr(0, kept)), "") << kept;
  }
  EXPECT_NE(refusalOf(good_ + "x"), "");
  EXPECT_NE(refusalOf(good_ + good_), "");
  EXPECT_NE(refusalOf("PLY"), "");
}

TEST_F(DamagedState, NamesTheSection) {
  for (const std::string name : {"head", "leaves", "poses", "points"}) {
    const Place place = placeOf(name);
    ASSERT_GT(place.bytes, 0u);
    std::string bad = good_;
    bad[place.begin + place.bytes + 5] ^= 1;  // of the hash
    EXPECT_EQ(refusalOf(bad).rfind("state.damaged", 0), 0u);
    EXPECT_NE(refusalOf(bad).find("\"" + name + "\""), std::string::npos) << refusalOf(bad);
  }
  EXPECT_EQ(refusalOf("not a state, but long enough").rfind("state.format", 0), 0u);
}

/// With right hashes, so that only the checks of the values are left.
TEST_F(DamagedState, IsRefusedForValuesThatNoFieldHas) {
  const auto at = [&](const std::string& section, std::size_t offset, const auto& value) {
    return rehashed([&](const std::string& name, std::string& content) {
      if (name == section) std::memcpy(content.data() + offset, &value, sizeof value);
    });
  };
  const std::string leaf_again = rehashed([](const std::string& name, std::string& content) {
    if (name != "leaves") return;  // the origin of the first leaf once more, where the second one begins
    std::uint32_t values = 0;
    std::memcpy(&values, content.data() + 12, 4);
    const std::size_t second = 80 + (values == 1 ? 2048u : 0u);
    std::memcpy(content.data() + second, content.data(), 12);
  });
  const std::size_t point_bytes = 12 + 48 + 4 + 36;
  const std::string point_again = rehashed([&](const std::string& name, std::string& content) {
    if (name == "points") std::memcpy(content.data() + point_bytes, content.data(), 12);
  });
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<std::string> all = {
      leaf_again,
      point_again,
      at("leaves", 0, std::int32_t{3}),
      at("leaves", 0, std::int32_t{1 << 30}),
      at("leaves", 12, std::uint32_t{2}),
      at("poses", 0, nan),
      at("points", 0, nan),
      at("points", 4, 1e9f),
      at("points", 12, std::int64_t{1} << 62),
      at("points", 36, std::int64_t{1} << 62),
      at("points", 60, std::uint32_t{0}),
      at("points", 64, std::uint32_t{9}),
      at("points", 68, ~std::uint32_t{0}),
      withHead([](internal::StateHead& head) { head.points += 1; }),
      withHead([](internal::StateHead& head) { head.points = std::uint64_t{1} << 40; }),
      withHead([](internal::StateHead& head) { head.leaves = ~std::uint64_t{0}; }),
      withHead([](internal::StateHead& head) { head.leaves_with_values = std::uint64_t{1} << 60; }),
      withHead([](internal::StateHead& head) { head.poses = std::uint64_t{1} << 61; }),
      withHead([](internal::StateHead& head) { head.params.tsdf.voxel_size_m = -1; }),
      withHead([&](internal::StateHead& head) { head.params.tsdf.voxel_size_m = nan; }),
      withHead([](internal::StateHead& head) { head.params.update.policy = UpdatePolicy::Paper; }),
      withHead([](internal::StateHead& head) { head.params.tsdf.region = UpdateRegion::Projective; }),
      withHead([](internal::StateHead& head) { head.schema = internal::kRolledStateSchema; }),  // without any
      withHead([](internal::StateHead& head) {
        head.schema = internal::kRolledStateSchema;
        head.params.approach.rolls = 65;
      }),
      withHead([&](internal::StateHead& head) { (*head.origin_W)[1] = nan; })};
  for (std::size_t n = 0; n < all.size(); ++n) {
    EXPECT_EQ(refusalOf(all[n]).rfind("state.damaged", 0), 0u) << n << ": " << refusalOf(all[n]);
  }
}

/// An age at which doubles no longer tell a tenth of a second from none: space would stay free for ever.
TEST_F(DamagedState, IsRefusedIfItIsOlderThanScansCanMakeIt) {
  const auto read = [&](double age_s, double free_for_s) {
    const Place place = placeOf("head");
    const std::string bytes = good_.substr(place.begin, place.bytes);
    internal::StateHead head = *internal::headFrom({bytes.begin(), bytes.end()});
    head.params.change.mode = ChangeMode::Full;
    head.params.change.free_for_s = free_for_s;
    head.params = head.params.resolved();
    head.schema = internal::kStateSchema + internal::kFullChangeSchema;
    head.age_s = age_s;
    return internal::headFrom(internal::bytesOf(head)).has_value();
  };
  EXPECT_TRUE(read(3600, 60));
  EXPECT_TRUE(read(1e9, 60));
  EXPECT_FALSE(read(1e12, 60));
  EXPECT_TRUE(read(1e6, 0.001));
  EXPECT_FALSE(read(1e7, 0.001));
  EXPECT_FALSE(read(std::numeric_limits<double>::quiet_NaN(), 60));
  EXPECT_FALSE(read(1, std::numeric_limits<double>::infinity()));
}

TEST_F(DamagedState, IsRefusedForOtherRulesAndAnotherTool) {
  const std::string rules = withHead([](internal::StateHead& head) { head.rules_version += 1; });
  EXPECT_EQ(refusalOf(rules).rfind("state.rules", 0), 0u) << refusalOf(rules);
  const std::string layout = withHead([](internal::StateHead& head) { head.schema += 100; });
  EXPECT_EQ(refusalOf(layout).rfind("state.rules", 0), 0u) << refusalOf(layout);
  writeBytes(file(), good_);
  try {
    (void)AccessibilityField::loadState(file(), armTool(), BackendKind::Cpu);
    ADD_FAILURE() << "another tool was accepted";
  } catch (const UnusableInput& error) {
    EXPECT_EQ(error.id(), "state.tool");
  }
  EXPECT_THROW((void)AccessibilityField::loadState(folder_ / "none", pen()), InputError);
}

TEST(SavedStateRefusal, OfHistoriesThatItDoesNotHold) {
  const ScratchFolder folder;
  FieldParams params = FieldParams::paper(0.05);
  params.backend = BackendKind::Cpu;
  const auto idOf = [&](const FieldParams& refused) -> std::string {
    try {
      AccessibilityField(armTool(), refused).saveState(folder / "s.avst");
    } catch (const InvalidArgument& error) {
      return error.id();
    }
    return "";
  };
  EXPECT_EQ(idOf(params), "usage.checkpoint");
  params = cpuParams();
  params.tsdf.region = UpdateRegion::Projective;
  EXPECT_EQ(idOf(params), "usage.checkpoint");
  EXPECT_TRUE(folder.names().empty());
  const AccessibilityField field(armTool(), cpuParams());
  EXPECT_THROW(field.saveState(folder / "no_folder" / "s.avst"), OutputError);
  try {
    field.saveState("/dev/full");
    ADD_FAILURE() << "a full disk was not noticed";
  } catch (const OutputError& error) {
    EXPECT_EQ(error.id(), "output.disk_full");
  }
  field.saveState(folder / "empty.avst");
  EXPECT_TRUE(
      AccessibilityField::loadState(folder / "empty.avst", armTool(), BackendKind::Cpu).snapshot().points.empty());
}

}  // namespace
}  // namespace accessvdb::test
