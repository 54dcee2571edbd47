// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How likely it is that the tool reaches a point, beside the label that says whether it does.
///
///   const float p = accessvdb::accessProbability(point, field.collisionLimit(), field.params());
///
/// SurfacePoint::access_probability has it for the points of a field. It is the share of points like this one, in
/// simulated scenes, that the exact tool reaches (docs/evaluation.md, "How sure a label is"): like in label and reason,
/// collisions against the limit, observations, range noise, and, of a field with margins, room. The normal is taken as
/// given, as by the label: how well it is known is not in it.
#pragma once

#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/types.h"

namespace accessvdb {

/// Names the constants: files with the column access_probability say which they are from.
inline constexpr const char* kProbabilityFit = "1";

/// @param point  its label, reason, score, weight, normal, direction, and margin_m, as a field or its files have them
/// @param collision_limit  AccessibilityField::collisionLimit() of the tool that stands for the point
/// @param resolved  FieldParams::resolved(), of the field
/// @return in [0, 1], in whole thousandths; -1: nothing is said: the point is unscored, or its reason is Normal, which
/// the normal alone decides, or Unseen, which the scenes of the fit hardly have
/// @throws InvalidArgument "probability.profile" for the paper's update policy, whose scores are the least there ever
/// were; "probability.limit"
[[nodiscard]] ACCESSVDB_API float accessProbability(const SurfacePoint& point, int collision_limit,
                                                    const FieldParams& resolved);

}  // namespace accessvdb
