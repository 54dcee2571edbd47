// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The picture of a scene, read back: each panel shows its labels, and no error is hidden.
#include "eval/scene_picture.h"

#include <gtest/gtest.h>
#include <png.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <vector>

#include "accessvdb/error.h"

namespace accessvdb::eval {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

struct Pixels {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
  /// Pixels nearer to this colour than to any other hue: one channel pattern, whatever the shading.
  [[nodiscard]] int count(int x0, int y0, int x1, int y1, bool (*is)(int r, int g, int b)) const {
    int found = 0;
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        const auto at = static_cast<std::size_t>(y * width + x) * 3;
        found += is(rgb[at], rgb[at + 1], rgb[at + 2]) ? 1 : 0;
      }
    }
    return found;
  }
};
bool green(int r, int g, int b) { return g > r + 30 && g > b + 30; }
bool red(int r, int g, int b) { return r > g + 60 && r > b + 60; }
bool magenta(int r, int g, int b) { return r > g + 60 && b > g + 60; }
bool blue(int r, int g, int b) { return b > r + 60 && b > g + 60; }

/// Pixels of one panel of four: left or right, top or bottom; below the title and legend.
using Count = std::array<std::array<int, 2>, 2>;
Count countIn(const Pixels& p, bool (*is)(int, int, int)) {
  constexpr int kTitle = 44;
  const int middle_x = p.width / 2, middle_y = kTitle + (p.height - kTitle) / 2;
  return {{{p.count(0, kTitle, middle_x, middle_y, is), p.count(middle_x, kTitle, p.width, middle_y, is)},
           {p.count(0, middle_y, middle_x, p.height, is), p.count(middle_x, middle_y, p.width, p.height, is)}}};
}

class ScenePictures : public testing::Test {
 protected:
  void SetUp() override {
    file_ = fs::temp_directory_path() / ("accessvdb_scene_picture_" + std::to_string(::getpid()) + ".png");
    for (int i = 0; i < 3000; ++i) {  // a sphere
      const double z = 1 - (2 * i + 1.0) / 3000, angle = i * 2.399963229728653, flat = std::sqrt(1 - z * z);
      positions_.push_back(Vector3d(0.1 * flat * std::cos(angle) + 5, 0.1 * flat * std::sin(angle), 0.1 * z));
      truth_.push_back(z > 0 ? 1 : 0);
    }
    found_ = truth_;
    visible_.assign(positions_.size(), 1);
  }
  void TearDown() override { fs::remove(file_); }

  [[nodiscard]] ScenePicture picture() const {
    return {"a sphere", 0.006, positions_, {}, truth_, found_, visible_, {}};
  }
  Pixels drawn(const ScenePicture& what) {
    drawScenePicture(file_, what);
    png_image png = {};
    png.version = PNG_IMAGE_VERSION;
    EXPECT_NE(png_image_begin_read_from_file(&png, file_.c_str()), 0);
    png.format = PNG_FORMAT_RGB;
    Pixels pixels{static_cast<int>(png.width), static_cast<int>(png.height), {}};
    pixels.rgb.resize(PNG_IMAGE_SIZE(png));
    EXPECT_NE(png_image_finish_read(&png, nullptr, pixels.rgb.data(), 0, nullptr), 0);
    return pixels;
  }

  fs::path file_;
  std::vector<Vector3d> positions_;
  std::vector<std::uint8_t> truth_, found_, visible_;
};

TEST_F(ScenePictures, EachPanelShowsItsLabels) {
  const Pixels pixels = drawn(picture());
  const Count g = countIn(pixels, green), r = countIn(pixels, red);
  EXPECT_GT(g[0][0], 10000);
  EXPECT_GT(r[0][0], 10000);
  EXPECT_EQ(g[0][0], g[0][1]) << "truth and found are the same here";
  EXPECT_EQ(r[0][0], r[0][1]);
  EXPECT_GT(g[1][0], g[0][0] + r[0][0] / 2) << "all of it is visible";
  EXPECT_EQ(r[1][0], 0);
  EXPECT_EQ(g[1][1] + r[1][1], 0) << "right labels are pale among the errors";
  for (const auto is : {magenta, blue}) {
    const Count wrong = countIn(pixels, is);
    EXPECT_EQ(wrong[0][0] + wrong[0][1] + wrong[1][0] + wrong[1][1], 0);
  }
}

TEST_F(ScenePictures, ErrorsShowWhereverTheyAre) {
  // One of each kind, nearest to and farthest from a viewer on the +x side.
  std::size_t near = 0, far = 0;
  for (std::size_t n = 0; n < positions_.size(); ++n) {
    if (positions_[n].x() > positions_[near].x()) near = n;
    if (positions_[n].x() < positions_[far].x()) far = n;
  }
  const std::vector<Vector3d> viewpoints = {{6, 0, 0}, {6, 0.1, 0}, {6, -0.1, 0}};
  for (const bool swap : {false, true}) {
    found_ = truth_;
    truth_[swap ? far : near] = 0;
    found_[swap ? far : near] = 1;  // promised but not there
    truth_[swap ? near : far] = 1;
    found_[swap ? near : far] = 0;
    ScenePicture what = picture();
    what.viewpoints_W = viewpoints;
    const Pixels pixels = drawn(what);
    const Count m = countIn(pixels, magenta), b = countIn(pixels, blue);
    EXPECT_GT(m[1][1], 20);
    EXPECT_GT(b[1][1], 20);
    EXPECT_EQ(m[0][0] + m[0][1] + m[1][0] + b[0][0] + b[0][1] + b[1][0], 0) << "in other panels";
  }
}

TEST_F(ScenePictures, WithoutHprThereAreThreePanels) {
  ScenePicture what = picture();
  what.visible = {};
  found_[0] = found_[0] == 0 ? 1 : 0;  // the northern pole, accessible in truth
  const Count b = countIn(drawn(what), blue);
  EXPECT_GT(b[1][0], 20) << "errors have moved up";
  EXPECT_EQ(b[1][1], 0);
}

TEST_F(ScenePictures, SmallestSceneAndBadOnes) {
  positions_.resize(1);
  truth_ = found_ = visible_ = {1};
  EXPECT_GT(countIn(drawn(picture()), green)[0][0], 100);
  fs::remove(file_);

  found_ = {1, 0};
  EXPECT_THROW(drawScenePicture(file_, picture()), InvalidArgument);
  found_ = {1};
  const std::vector<Eigen::Vector3f> normals(2, Eigen::Vector3f(0, 0, 1));
  ScenePicture what = picture();
  what.normals_W = normals;
  EXPECT_THROW(drawScenePicture(file_, what), InvalidArgument);
  what = picture();
  what.voxel_size_m = 0;
  EXPECT_THROW(drawScenePicture(file_, what), InvalidArgument);
  EXPECT_THROW(drawScenePicture(file_, ScenePicture{}), InvalidArgument);
  EXPECT_FALSE(fs::exists(file_));
  EXPECT_THROW(drawScenePicture("/nowhere/at/all.png", picture()), OutputError);
}

}  // namespace
}  // namespace accessvdb::eval
