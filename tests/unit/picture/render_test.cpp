// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pictures: they decode, accessible is green and blocked red, at the positions given by the camera.
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>

#include "accessvdb/error.h"
#include "accessvdb/render.h"
#include "accessvdb/tool_geometry.h"
#include "picture/picture_text.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using test::ScratchFolder;

struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
  explicit Picture(const std::filesystem::path& path) {
    png_image png = {};
    png.version = PNG_IMAGE_VERSION;
    if (!png_image_begin_read_from_file(&png, path.c_str())) {
      ADD_FAILURE() << png.message;
      return;
    }
    png.format = PNG_FORMAT_RGB;
    width = static_cast<int>(png.width);
    height = static_cast<int>(png.height);
    rgb.resize(PNG_IMAGE_SIZE(png));
    EXPECT_TRUE(png_image_finish_read(&png, nullptr, rgb.data(), 0, nullptr)) << png.message;
  }
  [[nodiscard]] char colourAt(int x, int y) const {  ///< 'g', 'r', 'n' for neutral grey, 'w' for paper
    const std::uint8_t* p =
        rgb.data() + 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x));
    if (p[1] > 1.5 * p[0]) return 'g';
    if (p[0] > 1.5 * p[1]) return 'r';
    return p[0] > 230 ? 'w' : 'n';
  }
};

/// A flat square of side 1 m around (0,0): quarter x<0,y>0 accessible, x>0,y>0 blocked, y<0 not scored.
FieldSnapshot quarters() {
  FieldSnapshot field;
  field.voxel_size_m = 0.01;
  field.origin_W = {500000, 5600000, 300};
  for (int i = -50; i <= 50; ++i) {
    for (int j = -50; j <= 50; ++j) {
      SurfacePoint point;
      point.position_W = field.origin_W + Eigen::Vector3d(i * 0.01, j * 0.01, 0);
      point.normal_W = {0, 0, 1};
      point.label = j < 0 ? PointLabel::Unscored : i < 0 ? PointLabel::Accessible : PointLabel::Blocked;
      field.points.push_back(point);
    }
  }
  return field;
}

TEST(RenderField, TopViewHasXToTheRightAndYUp) {
  const ScratchFolder folder;
  io::renderField(folder / "a.png", quarters(), {.width_px = 800, .height_px = 600, .view_W = {0, 0, 1}});
  const Picture picture(folder / "a.png");
  ASSERT_EQ(picture.width, 800);
  ASSERT_EQ(picture.height, 600);
  // Around the middle: the square is 540 pixels wide (600 less 5 % margins), so 100 pixels are 0.19 m.
  EXPECT_EQ(picture.colourAt(300, 200), 'g');
  EXPECT_EQ(picture.colourAt(500, 200), 'r');
  EXPECT_EQ(picture.colourAt(300, 400), 'n');
  EXPECT_EQ(picture.colourAt(500, 400), 'n');
  EXPECT_EQ(picture.colourAt(400 - 290, 200), 'w');
  EXPECT_EQ(picture.colourAt(400 + 290, 200), 'w');
  // No holes: inside a quarter, every pixel has its colour.
  for (int x = 160; x < 380; x += 3) {
    for (int y = 60; y < 280; y += 3) EXPECT_EQ(picture.colourAt(x, y), 'g') << x << "," << y;
  }
}

TEST(RenderField, NearerPointsHideFartherOnes) {
  const ScratchFolder folder;
  FieldSnapshot field = quarters();
  const std::size_t size = field.points.size();
  for (std::size_t i = 0; i < size; ++i) {  // a blocked sheet below everything, drawn last
    SurfacePoint below = field.points[i];
    below.position_W.z() -= 0.2;
    below.label = PointLabel::Blocked;
    field.points.push_back(below);
  }
  const io::RenderOptions top = {.width_px = 800, .height_px = 600, .view_W = {0, 0, 5}};
  io::renderField(folder / "a.png", field, top);
  EXPECT_EQ(Picture(folder / "a.png").colourAt(300, 200), 'g');
  io::renderField(folder / "b.png", field, {.width_px = 800, .height_px = 600, .view_W = {0, 0, -1}});
  EXPECT_EQ(Picture(folder / "b.png").colourAt(300, 200), 'r');
}

TEST(RenderField, FarPointsDoNotShrinkThePicture) {
  const ScratchFolder folder;
  FieldSnapshot field = quarters();
  for (int i = 0; i < 20; ++i) {
    SurfacePoint far = field.points.front();
    far.position_W += Eigen::Vector3d(50 + i, -80, 3 * i);
    field.points.push_back(far);
  }
  io::renderField(folder / "a.png", field, {.width_px = 800, .height_px = 600, .view_W = {0, 0, 1}});
  const Picture picture(folder / "a.png");
  EXPECT_EQ(picture.colourAt(300, 200), 'g');
  EXPECT_EQ(picture.colourAt(500, 200), 'r');
}

TEST(RenderField, EmptyAndSinglePointFieldsMakePictures) {
  const ScratchFolder folder;
  FieldSnapshot field;
  field.voxel_size_m = 0.01;
  io::renderField(folder / "empty.png", field, {.width_px = 320, .height_px = 200});
  EXPECT_EQ(Picture(folder / "empty.png").colourAt(160, 60), 'w');
  field.points.push_back(quarters().points.back());
  io::renderField(folder / "one.png", field, {.width_px = 320, .height_px = 200});
  EXPECT_EQ(Picture(folder / "one.png").colourAt(160, 100), 'r');
}

TEST(RenderField, BadOptionsAreRefused) {
  const ScratchFolder folder;
  const auto refused = [&](const io::RenderOptions& options) {
    EXPECT_THROW(io::renderField(folder / "a.png", quarters(), options), InvalidArgument);
  };
  refused({.view_W = {0, 0, 0}});
  refused({.view_W = {std::nan(""), 0, 1}});
  refused({.view_W = {INFINITY, 0, 1}});
  refused({.width_px = 0});
  refused({.height_px = -5});
  refused({.width_px = 1 << 30});
  EXPECT_TRUE(folder.names().empty());
  if (std::filesystem::exists("/dev/full")) {
    EXPECT_THROW(io::renderField("/dev/full", quarters()), OutputError);
  }
}

TEST(RenderTool, ShowsTheBodyAlongXAndTheTip) {
  const ScratchFolder folder;
  // A flat plate from the tip along +x, seen from above: x runs to the right.
  const auto tool = ToolGeometry::fromTriangles({{0, -0.1f, 0}, {0.6f, -0.1f, 0}, {0.6f, 0.1f, 0}, {0, 0.1f, 0.001f}},
                                                {{0, 1, 2}, {0, 2, 3}}, "plate");
  io::renderTool(folder / "tool.png", tool, {.width_px = 800, .height_px = 600, .view_W = {0, 0, 1}});
  const Picture picture(folder / "tool.png");
  int left_neutral = 0, right_neutral = 0, green = 0, red = 0;
  for (int y = 100; y < 600; ++y) {
    for (int x = 0; x < 800; ++x) {
      const char colour = picture.colourAt(x, y);
      if (colour == 'n') ++(x < 400 ? left_neutral : right_neutral);
      if (colour == 'g') ++green;
      if (colour == 'r') ++red;
    }
  }
  // The plate (0.6 m) and the axes (0.24 m) are framed: 76 % of 800 pixels are 0.6 m, so the plate has 608 x 203.
  EXPECT_GT(left_neutral, 0.8 * 304 * 203);
  EXPECT_GT(right_neutral, 0.8 * 304 * 203);
  EXPECT_LT(left_neutral + right_neutral, 1.1 * 608 * 203);
  // The x and y axes: 243 pixels long, at least one pixel wide in full colour.
  EXPECT_GT(red, 243);
  EXPECT_GT(green, 243);
}

TEST(PictureText, NumbersReadWell) {
  EXPECT_EQ(internal::groupedText(0), "0");
  EXPECT_EQ(internal::groupedText(999), "999");
  EXPECT_EQ(internal::groupedText(1000), "1 000");
  EXPECT_EQ(internal::groupedText(1234567), "1 234 567");
  EXPECT_EQ(internal::fixedText(12.345, 1), "12.3");
}

}  // namespace
}  // namespace accessvdb
