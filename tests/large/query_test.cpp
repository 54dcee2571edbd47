// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// query, info and render of a map in tiles: the answers of one piece.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>

#include "accessvdb/field_io.h"
#include "accessvdb/tiles.h"
#include "large/tiled_test.h"

namespace accessvdb::large_test {
namespace {

using nlohmann::json;

class TileQuery : public TiledTest {
 protected:
  /// Answers without what differs on purpose: a point's number, which counts in its tile.
  [[nodiscard]] json answers(const std::string& map) const {
    json found = json::parse(succeedQuietly({"query", "--map", path(map), "--points", path("positions"), "--json"}));
    for (json& answer : found) {
      if (answer.at("point").is_null()) continue;
      answer.at("point").erase("id");
      answer.at("point").erase("tile");
    }
    return found;
  }
  [[nodiscard]] std::string succeedQuietly(const Flags& arguments) const {
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return result.out;
  }
};

TEST_F(TileQuery, SaysWhatOnePieceSaysAnywhere) {
  succeed(map({"--tiles", "off"}, "one"));
  succeed(map({"--tiles", "6.4"}));
  const FieldSnapshot field = io::readPointsPly(path("one/points.ply"));
  const double v = field.voxel_size_m, edge_m = 6.4;
  std::mt19937_64 random(7);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto any = [&](double reach) -> Eigen::Vector3d {
    return Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)) * reach;
  };
  std::vector<Eigen::Vector3d> positions_W;
  for (int n = 0; n < 400; ++n) {
    positions_W.emplace_back(uniform(-8, 18), uniform(-7, 7), uniform(-2, 2));
    const SurfacePoint& point = field.points[random() % field.points.size()];
    positions_W.push_back(point.position_W);
    positions_W.push_back(point.position_W + any(4 * v));
  }
  // On both sides of the edges between tiles, where the nearest point may be another tile's.
  std::size_t at_edges = 0;
  for (const SurfacePoint& point : field.points) {
    const Eigen::Vector3d local = (point.position_W - field.origin_W) / edge_m;
    const double off_m =
        edge_m * std::min(std::abs(local.x() - std::round(local.x())), std::abs(local.y() - std::round(local.y())));
    if (off_m > 2 * v || at_edges > 800) continue;
    ++at_edges;
    positions_W.push_back(point.position_W + any(2 * v));
  }
  EXPECT_GT(at_edges, 200u);
  std::ofstream file(path("positions"));
  file.precision(17);
  for (const Eigen::Vector3d& p_W : positions_W) file << p_W.x() << " " << p_W.y() << " " << p_W.z() << "\n";
  file.close();

  const json expected = answers("one"), found = answers("out");
  ASSERT_EQ(expected.size(), positions_W.size());
  ASSERT_EQ(found.size(), positions_W.size());
  std::size_t with_point = 0, observed = 0, unknown = 0;
  for (std::size_t n = 0; n < positions_W.size() && !HasFailure(); ++n) {
    EXPECT_EQ(found[n], expected[n]);
    with_point += expected[n].at("point").is_null() ? 0 : 1;
    observed += expected[n].at("voxel") == "observed" ? 1 : 0;
    unknown += expected[n].at("voxel") == "unknown" ? 1 : 0;
  }
  EXPECT_GT(with_point, 400u);
  EXPECT_LT(with_point, positions_W.size() - 100);
  EXPECT_GT(observed, 400u);
  EXPECT_GT(unknown, 50u);
}

/// The number of a point, which is that in its tile's points.ply.
TEST_F(TileQuery, NumbersPointsWithinTheirTile) {
  succeed(map({"--tiles", "6.4"}));
  const tiles::Index index = tiles::readIndex(path("out"));
  EXPECT_TRUE(index.complete);
  std::vector<Eigen::Vector3d> positions_W;
  for (const tiles::IndexedTile& tile : index.tiles) {
    const FieldSnapshot part = io::readPointsPly(tile.folder / "points.ply");
    ASSERT_EQ(part.points.size(), tile.points);
    if (!part.points.empty()) positions_W.push_back(part.points[part.points.size() / 2].position_W);
  }
  ASSERT_GE(positions_W.size(), 4u);
  for (const tiles::StoredAnswer& answer : tiles::answersAt(index, positions_W)) {
    ASSERT_TRUE(answer.field.point && answer.tile);
    const FieldSnapshot part = io::readPointsPly(path("out/tiles/" + answer.tile->name() + "/points.ply"));
    EXPECT_EQ(part.points.at(answer.field.point->id).position_W, answer.field.position_W);
  }
}

}  // namespace
}  // namespace accessvdb::large_test
