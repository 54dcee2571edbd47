// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/neighbourhood.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <utility>

#include "hostdev/neighbour_rule.h"
#include "points/normal_kernels.h"

namespace accessvdb::internal {

double neighbourRadius_m(double voxel_size_m) { return std::max(10.0 * voxel_size_m, 0.1); }

NeighbourhoodSearch::NeighbourhoodSearch(const PointStore& points, const FieldParams& resolved)
    : points_(points),
      k_(resolved.scoring.neighbours),
      join_views_(resolved.scoring.join_neighbour_views),
      voxel_size_m_(resolved.tsdf.voxel_size_m),
      radius_m_(neighbourRadius_m(resolved.tsdf.voxel_size_m)),
      choice_(surfaceChoice(resolved)) {}

void NeighbourhoodSearch::compute(std::span<const std::uint32_t> ids, std::span<Neighbourhood> out,
                                  std::uint64_t* wide_seen) const {
  // Group by block: points of one block share the positions gathered around it.
  struct Job {
    std::uint32_t block, slot;
  };
  std::vector<Job> jobs(ids.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), 1024), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      jobs[n] = {points_.blockOf(ids[n]), static_cast<std::uint32_t>(n)};
    }
  });
  tbb::parallel_sort(jobs.begin(), jobs.end(), [](const Job& a, const Job& b) {
    return a.block != b.block ? a.block < b.block : a.slot < b.slot;
  });
  std::vector<std::size_t> begin;
  for (std::size_t n = 0; n < jobs.size(); ++n) {
    if (n == 0 || jobs[n].block != jobs[n - 1].block) begin.push_back(n);
  }
  begin.push_back(jobs.size());
  struct Scratch {
    NearestPoints nearest;
    SurfaceColumns columns;
    std::vector<std::uint32_t> ids;
    // Of those with enough neighbours for a normal.
    std::vector<std::uint32_t> jobs;
    std::vector<kernels::Covariance> covariances;
    std::vector<float> normals;
    Scratch(NearestPoints&& search, SurfaceColumns&& choice) : nearest(std::move(search)), columns(std::move(choice)) {}
  };
  const NormalKernels& normal_kernels = normalKernels();
  tbb::enumerable_thread_specific<Scratch> scratches([this] {
    return Scratch(NearestPoints(points_, static_cast<std::size_t>(k_), kViewNeighbours, voxel_size_m_, radius_m_),
                   SurfaceColumns(points_, choice_));
  });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, begin.size() - 1), [&](const auto& range) {
    Scratch& scratch = scratches.local();
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      scratch.ids.clear();
      for (std::size_t n = begin[g]; n < begin[g + 1]; ++n) {
        scratch.ids.push_back(ids[jobs[n].slot]);
        points_.prefetch(scratch.ids.back());
      }
      const Index3& leaf = points_.index().blocks()[jobs[begin[g]].block].leaf;
      scratch.jobs.clear();
      scratch.covariances.clear();
      scratch.nearest.forEach(leaf, scratch.ids, [&](std::uint32_t n, const Neighbours& neighbours) {
        const auto job = static_cast<std::uint32_t>(begin[g] + n);
        Neighbourhood& found = out[jobs[job].slot] =
            fromNeighbours(scratch.ids[n], neighbours, scratch.nearest.stepsPerMetre());
        if (wide_seen != nullptr) {
          const std::size_t row = std::size_t{scratch.ids[n]} * static_cast<std::size_t>(points_.directionWords());
          found.wide_views_changed = joinWide(scratch.ids[n], neighbours, wide_seen + row);
        }
        if (neighbours.sums.count < kernels::kFewestForNormal) return;
        scratch.jobs.push_back(job);
        scratch.covariances.push_back(kernels::neighbourCovariance(neighbours.sums));
      });
      scratch.normals.resize(3 * scratch.covariances.size());
      normal_kernels.smallest_eigenvectors(scratch.covariances.data(), scratch.covariances.size(),
                                           scratch.normals.data());
      for (std::size_t n = 0; n < scratch.jobs.size(); ++n) {
        const std::uint32_t slot = jobs[scratch.jobs[n]].slot;
        float* normal = scratch.normals.data() + 3 * n;
        kernels::turnTowards(points_.toSensor_L(ids[slot]).data(), normal);
        if (choice_.isMade()) {
          const int axis = kernels::mainAxis(normal);
          if (!scratch.columns.isOnSurface(ids[slot], axis)) kernels::writeBesideSurface(axis, normal);
        }
        out[slot].normal_L = Eigen::Map<const Eigen::Vector3f>(normal);
      }
    }
  });
}

/// All but the normal.
Neighbourhood NeighbourhoodSearch::fromNeighbours(std::uint32_t id, const Neighbours& neighbours,
                                                  double steps_per_m) const {
  Neighbourhood result;
  result.reach_m = kernels::neighbourReach_m(neighbours.farthest, steps_per_m);
  result.seen = points_.seen(id);
  if (join_views_) {
    for (const std::uint32_t near : neighbours.nearest) result.seen = result.seen | points_.seen(near);
  }
  return result;
}

/// @param joined  of this point  @return whether that changed them
bool NeighbourhoodSearch::joinWide(std::uint32_t id, const Neighbours& neighbours, std::uint64_t* joined) const {
  std::array<std::uint64_t, kernels::kMostWideDirections / 64> seen = {};
  const std::span<std::uint64_t> words = std::span(seen).first(static_cast<std::size_t>(points_.directionWords()));
  points_.joinSeen(id, words);
  if (join_views_) {
    for (const std::uint32_t near : neighbours.nearest) points_.joinSeen(near, words);
  }
  if (std::equal(words.begin(), words.end(), joined)) return false;
  std::copy(words.begin(), words.end(), joined);
  return true;
}

}  // namespace accessvdb::internal
