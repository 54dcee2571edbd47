// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A short stream of scans and a tool for the properties, and what "the same, bit for bit" means.
#pragma once

#include <gtest/gtest.h>

#include <bit>
#include <cstdlib>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "support/box_tool.h"

namespace accessvdb::test {

/// Cuda if the environment variable says "cuda": a test's fields are then on a GPU, as the test says.
inline BackendKind backendNamedBy(const char* variable) {
  const char* device = std::getenv(variable);
  return device != nullptr && std::string(device) == "cuda" ? BackendKind::Cuda : BackendKind::Cpu;
}

struct Scan {
  std::vector<Eigen::Vector3f> points_S;
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
};

inline double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1.0p-53;
}

/// A rough wall with clutter in front of it, seen while walking by: points of every label. Positions are multiples of
/// 2^-10 m.
inline std::vector<Scan> wallScans(std::uint64_t seed, int scans, int points) {
  std::mt19937_64 random(seed);
  std::vector<Scan> out;
  const auto rounded = [](const Eigen::Vector3d& x) -> Eigen::Vector3d { return (x * 1024).array().round() / 1024; };
  for (int s = 0; s < scans; ++s) {
    Scan& scan = out.emplace_back();
    scan.T_W_S.linear() = Eigen::AngleAxisd(uniform(random, -3, 3), Eigen::Vector3d::UnitZ()).toRotationMatrix();
    scan.T_W_S.translation() = rounded({uniform(random, -0.3, 0.3), 0.3 * s + 0.02, uniform(random, 0.8, 1.2)});
    for (int n = 0; n < points; ++n) {
      Eigen::Vector3d p_W(2 + uniform(random, -0.02, 0.02), uniform(random, -0.5, 1.5), uniform(random, 0.3, 1.7));
      if (n % 4 == 0) p_W.x() = uniform(random, 1, 2);
      if (n % 4 == 1)
        p_W = {1.5 + uniform(random, -0.05, 0.05), 0.5 + uniform(random, -0.05, 0.05), uniform(random, 0.3, 1.7)};
      scan.points_S.push_back((scan.T_W_S.inverse() * rounded(p_W)).cast<float>());
    }
  }
  return out;
}

/// An arm with a body behind and above it.
inline ToolGeometry armTool() { return boxTool({0.0f, -0.06f, -0.05f}, {0.9f, 0.07f, 0.31f}); }

inline bool same(float a, float b) { return std::bit_cast<std::uint32_t>(a) == std::bit_cast<std::uint32_t>(b); }

/// Compares what does not depend on the world's origin.
inline bool sameVerdict(const SurfacePoint& a, const SurfacePoint& b) {
  return a.label == b.label && a.reason == b.reason && a.score == b.score && a.direction == b.direction &&
         a.roll == b.roll && same(a.stability, b.stability) && same(a.weight, b.weight) &&
         same(a.confidence, b.confidence) && same(a.normal_W.x(), b.normal_W.x()) &&
         same(a.normal_W.y(), b.normal_W.y()) && same(a.normal_W.z(), b.normal_W.z()) && a.confident == b.confident &&
         same(a.access_probability, b.access_probability) && same(a.yaw_rad, b.yaw_rad) &&
         a.direction_W == b.direction_W;
}

inline std::string text(const SurfacePoint& p) {
  std::ostringstream out;
  out << name(p.reason) << " " << p.score << " at " << p.direction << ", weight " << p.weight << ", stability "
      << p.stability << ", normal " << p.normal_W.transpose();
  return out.str();
}

/// What a field with more ways to reach points has over one with fewer. None may lose access, or reach with more
/// collisions.
struct AccessGains {
  std::size_t compared = 0, gained = 0, kept = 0;

  void add(const FieldSnapshot& few, const FieldSnapshot& many) {
    ASSERT_EQ(few.points.size(), many.points.size());
    for (std::size_t n = 0; n < few.points.size(); ++n, ++compared) {
      const bool by_few = few.points[n].label == PointLabel::Accessible,
                 by_many = many.points[n].label == PointLabel::Accessible;
      ASSERT_TRUE(!by_few || by_many) << "point " << n;
      if (by_few) {
        ASSERT_LE(many.points[n].score, few.points[n].score);
      }
      gained += !by_few && by_many ? 1 : 0;
      kept += by_few ? 1 : 0;
    }
  }
};

inline void expectSame(const FieldSnapshot& a, const FieldSnapshot& b) {
  ASSERT_EQ(a.points.size(), b.points.size());
  ASSERT_EQ(a.origin_W, b.origin_W);
  for (std::size_t n = 0; n < a.points.size(); ++n) {
    ASSERT_EQ(a.points[n].id, b.points[n].id);
    ASSERT_EQ(a.points[n].position_W, b.points[n].position_W) << n;
    ASSERT_TRUE(sameVerdict(a.points[n], b.points[n])) << n << ": " << text(a.points[n]) << "; " << text(b.points[n]);
  }
}

/// Enough of every kind for "the same" to be meaningful.
inline void expectVaried(const FieldSnapshot& field) {
  EXPECT_GT(field.count(PointLabel::Accessible), 50u);
  EXPECT_GT(field.count(PointLabel::Blocked), 50u);
}

}  // namespace accessvdb::test
