// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/due_lists.h"

#include <algorithm>

#include "cuda/memory/growing.h"
#include "cuda/search/score_kernels.h"

namespace accessvdb::kernels {

void DueLists::growBlocks(std::uint32_t blocks, cudaStream_t stream) {
  growFilled(heads_, memory_, blocks, 0xff, stream);
  growFilled(busy_, memory_, blocks, 0, stream);
  growFilled(places_, memory_, blocks, 0, stream);
  view_.head = heads_.data();
  view_.busy = busy_.data();
  view_.place = places_.data();
}

void DueLists::growItems(std::uint32_t points) {
  // Room for all points of a small map, else for parts of a map, of which few points are due.
  const auto within = [](std::size_t items) { return std::clamp<std::size_t>(items, kLeastItems, kMaxItems); };
  if (items_.size() < within(points)) {
    const std::size_t items = within(roomFor(points));
    items_.grow(memory_, items, 0);
    order_.grow(memory_, items, 0);
    whole_.grow(memory_, items, 0);
  }
  view_.items = items_.data();
  view_.order = order_.data();
  view_.whole = whole_.data();
}

DueView DueLists::ordered(const BlockIndexView& index, std::uint32_t busy, cudaStream_t stream) {
  DueView view = view_;
  if (busy == 0) return view;
  for (auto* list : {&keys_, &sorted_, &block_order_}) list->growWithRoom(memory_, busy, roomFor(busy), 0);
  const auto order = [&](void* scratch, std::size_t& bytes) {
    launchBlockOrder(index.leaf, view_.busy, busy, keys_.data(), sorted_.data(), block_order_.data(), scratch, bytes,
                     stream);
  };
  std::size_t bytes = 0;
  order(nullptr, bytes);
  scratch_.growWithRoom(memory_, bytes, roomFor(bytes), 0);
  order(scratch_.data(), bytes);
  view.busy = block_order_.data();
  return view;
}

}  // namespace accessvdb::kernels
