// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/known_tables.h"

#include <algorithm>
#include <utility>

namespace accessvdb::kernels {
namespace {

/// Collisions are counted up to this many times the limit, to remember them. Counting further did not pay off.
constexpr int kCountTo = 2;

}  // namespace

KnownTables::KnownTables(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const ToolTables& tables,
                         int num_directions)
    : memory_(memory) {
  if (tables.cell_directions.empty() && tables.cell_sets.empty()) return;
  const auto load = [&](auto& to, const auto& from) {
    if (from.empty()) return;
    to.grow(memory_, from.size(), 0);
    to.upload(from.data(), from.size());
  };
  try {
    load(more_arcs_, tables.arcs.more);
    load(arcs_of_columns_, tables.arcs.table);
    arcs_ = tables.arcs.shape;
    arcs_.table = arcs_of_columns_.data();
    arcs_.more = more_arcs_.data();
  } catch (const ResourceLimit&) {  // then they age
  }
  try {
    load(cell_directions_, tables.cell_directions);
    load(cell_sets_, tables.cell_sets);
  } catch (const ResourceLimit&) {
    return;
  }
  try {
    load(corridor_table_, tables.corridors);
  } catch (const ResourceLimit&) {  // then blocked corridors are forgotten by leaf
  }
  cells_.table = cell_directions_.data();
  cells_.sets = cell_sets_.data();
  std::copy_n(tables.cell_low, 3, cells_.low);
  std::copy_n(tables.cell_size, 3, cells_.size);
  corridors_ = {corridor_table_.data(), tables.corridor_reach};
  view_.slots = KnownSlots::of(num_directions, tables.arc);
  notes_.emplace(context);
  view_.follows = arcs_.table != nullptr;
  if (view_.follows) {
    counts_.emplace(context);
    counted_bits_.emplace(context);
    stirred_bits_.emplace(context);
    lost_.emplace(std::move(context));
  } else {
    levels_.emplace(context);
    freed_.emplace(std::move(context));
  }
}

void KnownTables::setLimit(int collision_limit) {
  view_.scale = KnownLevels::forLimit(collision_limit);
  view_.count_to = std::min(kCountTo * collision_limit, int{kNoScore});
}

void KnownTables::grow(std::uint32_t points, std::uint32_t groups, cudaStream_t stream) {
  if (!notes_) return;
  const auto slots = static_cast<std::size_t>(view_.slots.slots), words = static_cast<std::size_t>(view_.slots.words);
  if (!view_.slots.all()) {
    notes_->grow(points);
    view_.notes = notes_->data();
  }
  if (view_.follows) {
    counts_->grow(points * slots * kKnownPerWord);
    view_.counts = counts_->data();
    counted_bits_->growFilled((points + std::size_t{31}) / 32, 0, stream);
    view_.counted_bits = counted_bits_->data();
    stirred_bits_->grow((points + std::size_t{31}) / 32);
    view_.stirred_bits = stirred_bits_->data();
    lost_->grow(groups * words * kKnownPerWord);
    view_.lost = lost_->data();
    return;
  }
  levels_->grow(points * slots);
  view_.levels = levels_->data();
  freed_->growFilled(groups * words, 0, stream);
  view_.freed = freed_->data();
}

}  // namespace accessvdb::kernels
