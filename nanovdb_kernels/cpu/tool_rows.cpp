// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cpu/tool_rows.h"

#include <limits>

#if defined(__x86_64__) && defined(__GNUC__)
#define ACCESSVDB_X86_ROWS 1
#include <immintrin.h>
#else
#define ACCESSVDB_X86_ROWS 0
#endif

namespace accessvdb::kernels {

#if ACCESSVDB_X86_ROWS
namespace {

[[gnu::target("avx2")]] std::uint32_t rowOfAvx2(const ToolBitmapView& tool, const float* y, const float* step) {
  const __m256 up = _mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7), zero = _mm256_setzero_ps();
  __m256i node[3], inside = _mm256_set1_epi32(-1);
  for (int a = 0; a < 3; ++a) {
    const __m256 at = _mm256_add_ps(_mm256_set1_ps(y[a]), _mm256_mul_ps(up, _mm256_set1_ps(step[a])));
    node[a] = _mm256_cvttps_epi32(at);
    const __m256i from = _mm256_castps_si256(_mm256_cmp_ps(at, zero, _CMP_GE_OQ));
    inside =
        _mm256_and_si256(inside, _mm256_and_si256(from, _mm256_cmpgt_epi32(_mm256_set1_epi32(tool.size[a]), node[a])));
  }
  if (_mm256_testz_si256(inside, inside) != 0) return 0;
  const __m256i column = _mm256_add_epi32(_mm256_mullo_epi32(node[0], _mm256_set1_epi32(tool.size[1])), node[1]);
  const __m256i word =
      _mm256_add_epi32(_mm256_mullo_epi32(column, _mm256_set1_epi32(2 * tool.words_z)), _mm256_srli_epi32(node[2], 5));
  const __m256i bits =
      _mm256_mask_i32gather_epi32(_mm256_setzero_si256(), reinterpret_cast<const int*>(tool.words), word, inside, 4);
  const __m256i bit = _mm256_srlv_epi32(bits, _mm256_and_si256(node[2], _mm256_set1_epi32(31)));
  return static_cast<std::uint32_t>(_mm256_movemask_ps(_mm256_castsi256_ps(_mm256_slli_epi32(bit, 31))));
}

}  // namespace
#endif

ToolRow fastToolRow([[maybe_unused]] const ToolBitmapView& tool) {
#if ACCESSVDB_X86_ROWS
  const double half_words = 2.0 * tool.size[0] * tool.size[1] * tool.words_z;
  if (half_words < std::numeric_limits<std::int32_t>::max() && __builtin_cpu_supports("avx2") != 0) return &rowOfAvx2;
#endif
  return nullptr;
}

}  // namespace accessvdb::kernels
