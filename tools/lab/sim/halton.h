// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The low-discrepancy sequence behind the non-repetitive pattern.
#pragma once

#include <cstdint>

namespace accessvdb::sim {

/// The digits of `index` mirrored at the point (van der Corput), in [0, 1); Halton's sequence pairs coprime bases.
template <unsigned kBase>
constexpr double radicalInverse(std::uint64_t index) {
  // Digits are gathered as one integer so that the result is rounded once, whatever the length.
  std::uint64_t mirrored = 0, scale = 1;
  for (; index > 0; index /= kBase) {
    mirrored = mirrored * kBase + index % kBase;
    scale *= kBase;
  }
  return static_cast<double>(mirrored) / static_cast<double>(scale);
}

}  // namespace accessvdb::sim
