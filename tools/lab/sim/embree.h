// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Embree 3 (Debian 12) or 4 (Ubuntu 24.04), and the calls that differ between them.
#pragma once

#if ACCESSVDB_EMBREE_VERSION >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace accessvdb::sim {

#if ACCESSVDB_EMBREE_VERSION >= 4
using RayContext = RTCRayQueryContext;
inline void initialize(RayContext& context) { rtcInitRayQueryContext(&context); }
inline void occluded(RTCScene scene, RayContext& context, RTCRay& ray) {
  RTCOccludedArguments arguments;
  rtcInitOccludedArguments(&arguments);
  arguments.context = &context;
  rtcOccluded1(scene, &ray, &arguments);
}
inline void intersect(RTCScene scene, RayContext& context, RTCRayHit* rays, unsigned count) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.context = &context;
  for (unsigned i = 0; i < count; ++i) rtcIntersect1(scene, &rays[i], &arguments);
}
#else
using RayContext = RTCIntersectContext;
inline void initialize(RayContext& context) { rtcInitIntersectContext(&context); }
inline void occluded(RTCScene scene, RayContext& context, RTCRay& ray) { rtcOccluded1(scene, &context, &ray); }
inline void intersect(RTCScene scene, RayContext& context, RTCRayHit* rays, unsigned count) {
  rtcIntersect1M(scene, &context, rays, count, sizeof(RTCRayHit));
}
#endif

}  // namespace accessvdb::sim
