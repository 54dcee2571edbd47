// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which kernel serves a tool: one per way of counting, because code for the others would only take up registers.
#pragma once

#include <type_traits>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// How tool collisions are counted. One kernel per form: code for the others would only take up instruction cache.
enum class CountOf { Columns, Samples, Slabs };
/// @tparam kRolls  the tool has parts that roll
/// @tparam kThick  slabs of more than one layer  @tparam kRows  slabs with rows, always if the tool rolls
template <CountOf kOf, bool kRolls = false, bool kThick = false, bool kRows = false>
struct CountForm {
  static constexpr bool rolls = kRolls, thick = kThick, rows = kRows, by_slabs = kOf == CountOf::Slabs,
                        by_columns = kOf == CountOf::Columns;
  using OfPart = CountForm<kOf, false, kThick, kRows>;
};

/// Calls launch(samples, rolls) with constants that say how the tool is counted: std::true_type or std::false_type.
template <class Launch>
void launchByForm(const ToolKernelView& tool, const Launch& launch) {
  const auto withForm = [&](auto samples) {
    tool.parts > 1 ? launch(samples, std::true_type()) : launch(samples, std::false_type());
  };
  tool.use_samples ? withForm(std::true_type()) : withForm(std::false_type());
}

}  // namespace accessvdb::kernels
