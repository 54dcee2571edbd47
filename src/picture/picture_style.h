// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Style shared by all pictures: sharpness, light, background and text colours.
#pragma once

#include <Eigen/Core>

#include "io/results/label_colours.h"

namespace accessvdb::internal {

inline constexpr int kSupersampling = 2;
/// Direction towards the light, in the viewer's frame.
inline const Eigen::Vector3f kLight_V = Eigen::Vector3f(-0.35f, 0.55f, 0.75f).normalized();
inline const Eigen::Vector3f kBackground = {0.975f, 0.975f, 0.97f};
inline constexpr Rgb kInk = {40, 44, 52};

}  // namespace accessvdb::internal
