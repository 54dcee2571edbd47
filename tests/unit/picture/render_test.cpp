// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pictures: they decode, accessible is green and blocked red, at the positions given by the camera.
#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/render.h"
#include "accessvdb/tool_geometry.h"
#include "picture/picture_text.h"
#include "unit/io/sample_field.h"
#include "unit/tool/test_meshes.h"

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
  [[nodiscard]] bool isBlueAt(int x, int y) const {
    const std::size_t n = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    return rgb[3 * n + 2] > rgb[3 * n + 1];
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

TEST(RenderField, ByReasonEachReasonHasItsColour) {
  const ScratchFolder folder;
  FieldSnapshot field = quarters();
  for (SurfacePoint& point : field.points) {
    if (point.label == PointLabel::Accessible) point.reason = PointReason::None;
    if (point.label == PointLabel::Blocked) point.reason = PointReason::Tool;
    if (point.label == PointLabel::Unscored) {
      point.reason = point.position_W.x() < field.origin_W.x() ? PointReason::Confidence : PointReason::Normal;
    }
  }
  const auto middles = [&](io::RenderColour colour) {
    io::renderField(folder / "a.png", field,
                    {.width_px = 800, .height_px = 600, .view_W = {0, 0, 1}, .colour = colour});
    const Picture picture(folder / "a.png");
    std::vector<std::array<std::uint8_t, 3>> found;
    for (const auto& [x, y] : {std::pair(300, 200), {500, 200}, {300, 400}, {500, 400}}) {
      const std::uint8_t* p = picture.rgb.data() + 3 * (y * 800 + x);
      found.push_back({p[0], p[1], p[2]});
    }
    return found;
  };
  const auto apart = [](const std::array<std::uint8_t, 3>& a, const std::array<std::uint8_t, 3>& b) {
    return std::abs(a[0] - b[0]) + std::abs(a[1] - b[1]) + std::abs(a[2] - b[2]) > 60;
  };
  const auto label = middles(io::RenderColour::Label), reason = middles(io::RenderColour::Reason);
  EXPECT_FALSE(apart(label[2], label[3]));  // both are not scored
  for (std::size_t a = 0; a < 4; ++a) {
    for (std::size_t b = a + 1; b < 4; ++b) EXPECT_TRUE(apart(reason[a], reason[b])) << a << " and " << b;
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

/// A board from the tip along +x: 0.6 m long, 0.2 m wide, 0.02 m thick.
ToolGeometry board() {
  const test::Mesh mesh = test::box({0, -0.1f, -0.01f}, {0.6f, 0.1f, 0.01f});
  return ToolGeometry::fromTriangles(mesh.vertices, mesh.triangles, "board");
}

/// Bounds of what is neither paper nor text, which lies in the first 24 rows of a panel.
struct Drawn {
  int left = 1 << 30, right = -1, neutral = 0, green = 0, red = 0, blue = 0;
  Drawn(const Picture& picture, int x_begin, int y_begin) {
    for (int y = y_begin + 24; y < y_begin + 282; ++y) {
      for (int x = x_begin; x < x_begin + 400; ++x) {
        const char colour = picture.colourAt(x, y);
        if (colour == 'w') continue;
        left = std::min(left, x - x_begin);
        right = std::max(right, x - x_begin);
        if (colour == 'r') ++red;
        if (colour == 'n') ++neutral;
        if (colour == 'g') ++(picture.isBlueAt(x, y) ? blue : green);
      }
    }
  }
};

TEST(RenderTool, ShowsItFromFourSidesAtOneScale) {
  const ScratchFolder folder;
  io::renderTool(folder / "tool.png", board(), {.width_px = 800, .height_px = 600, .view_W = {0, 0, 1}});
  const Picture picture(folder / "tool.png");
  // Panels of 400 x 282 pixels below a title of 36 rows. The board is framed by its length: 76 % of 400 pixels.
  const Drawn side(picture, 0, 36), above(picture, 400, 36), front(picture, 0, 318), asked(picture, 400, 318);
  constexpr double kLength_px = 304, kWidth_px = kLength_px / 3;
  EXPECT_GT(above.neutral, 0.7 * kLength_px * kWidth_px);
  EXPECT_LT(above.neutral, 1.1 * kLength_px * kWidth_px);
  EXPECT_NEAR(asked.neutral, above.neutral, 200);         // the same view, the same scale; another title
  EXPECT_LT(side.neutral, 0.2 * kLength_px * kWidth_px);  // seen edge-on
  EXPECT_LT(front.neutral, 0.2 * kLength_px * kWidth_px);
  EXPECT_NEAR(side.right - side.left, kLength_px, 12);  // both show the whole length
  EXPECT_NEAR(above.right - above.left, kLength_px, 12);
  EXPECT_LT(front.right - front.left, 0.6 * kLength_px);  // 0.2 m of board and 0.24 m of the y axis
  // The axes x (red), y (green) and z (blue) are 122 pixels long where they are not seen end-on.
  for (const int pixels : {side.red, side.blue, above.red, above.green, front.green, front.blue})
    EXPECT_GT(pixels, 122);
  for (const int pixels : {side.green, above.blue, front.red}) EXPECT_LT(pixels, 60);
}

TEST(RenderTool, TheTipIsWhereTheBodyBegins) {
  const ScratchFolder folder;
  io::renderTool(folder / "tool.png", board(), {.width_px = 800, .height_px = 600});
  const Picture picture(folder / "tool.png");
  // The tip's yellow disc: near the left end from above, as x runs to the right there.
  std::int64_t sum_x = 0, count = 0;
  for (int y = 36; y < 318; ++y) {
    for (int x = 400; x < 800; ++x) {
      const std::uint8_t* p = picture.rgb.data() + 3 * (y * 800 + x);
      if (p[0] < 200 || p[1] < 140 || p[2] > 90) continue;
      sum_x += x - 400;
      ++count;
    }
  }
  ASSERT_GT(count, 10);
  const Drawn above(picture, 400, 36);
  EXPECT_NEAR(static_cast<double>(sum_x) / static_cast<double>(count), above.left, 8);
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
