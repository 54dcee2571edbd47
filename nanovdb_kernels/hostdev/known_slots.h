// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a point keeps what is known about its directions, eight to a word (known_levels.h, known_counts.h). It only
/// tests directions within its cone, which are an arc. So it has fewer slots than there are words: word w belongs into
/// slot w % slots, and the point notes which word each slot holds. What is not held is not known, which only costs
/// time.
#pragma once

#include <cstdint>

#include "hostdev/known_levels.h"
#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

struct KnownSlots {
  /// Each slot has one digit of the note, which says how often the number of slots goes into its word.
  static constexpr int kMostSlots = 16, kDigitBits = 2, kDigitValues = 3;
  static constexpr std::uint32_t kNothingHeld = ~std::uint32_t{0};  ///< a note: no digit of any word

  int words = 0;  ///< of all directions
  int slots = 0;  ///< per point; as many as words: each word has its own, and nothing is noted

  /// @param arc  most directions in a row that a point tests; 0: they may be any
  ACCESSVDB_HOSTDEV static KnownSlots of(int num_directions, int arc) {
    const int words = (num_directions + kKnownPerWord - 1) / kKnownPerWord;
    if (arc <= 0) return {words, words};
    // Words that hold a part of the arc. The last word may hold few directions.
    const int most = (arc + kKnownPerWord - 2) / kKnownPerWord + (num_directions % kKnownPerWord != 0 ? 2 : 1);
    constexpr int kSector = 4;  // words that a device reads at once
    for (int slots = (most + kSector - 1) / kSector * kSector; slots < words && slots <= kMostSlots; slots += kSector) {
      // An arc that passes from the last word to the first one must not need a slot twice.
      const int last_digit = (words - 1) / slots;
      if (last_digit < kDigitValues && most <= words - last_digit * slots) return {words, slots};
    }
    return {words, words};
  }

  [[nodiscard]] ACCESSVDB_HOSTDEV bool all() const { return slots == words; }
  [[nodiscard]] ACCESSVDB_HOSTDEV int slotOf(int word) const { return word - digitOf(word) * slots; }
  /// Whether a word is in its slot. @param note  of the point; any if each word has its own slot
  [[nodiscard]] ACCESSVDB_HOSTDEV bool holds(std::uint32_t note, int word) const {
    return all() || static_cast<int>(note >> (kDigitBits * slotOf(word)) & kDigit) == digitOf(word);
  }
  /// The word in a slot; -1: none.
  [[nodiscard]] ACCESSVDB_HOSTDEV int wordIn(std::uint32_t note, int slot) const {
    if (all()) return slot;
    const std::uint32_t digit = note >> (kDigitBits * slot) & kDigit;
    return digit < kDigitValues ? slot + static_cast<int>(digit) * slots : -1;
  }
  /// The words that are in their slots, one bit each.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint32_t held(std::uint32_t note) const {
    if (all()) return ~std::uint32_t{0} >> (32 - words);
    std::uint32_t words_held = 0;
    for (int slot = 0; slot < slots; ++slot) {
      const std::uint32_t digit = note >> (kDigitBits * slot) & kDigit;
      if (digit < kDigitValues) words_held |= 1u << (slot + static_cast<int>(digit) * slots);
    }
    return words_held;
  }
  /// Bits of the note that change when the word comes into its slot. Only if there are fewer slots than words.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint32_t changes(std::uint32_t note, int word) const {
    const int shift = kDigitBits * slotOf(word);
    return ((note >> shift & kDigit) ^ static_cast<std::uint32_t>(digitOf(word))) << shift;
  }

 private:
  static constexpr std::uint32_t kDigit = (1u << kDigitBits) - 1;
  /// word / slots, below kDigitValues, without a division.
  [[nodiscard]] ACCESSVDB_HOSTDEV int digitOf(int word) const {
    return (word >= slots ? 1 : 0) + (word >= 2 * slots ? 1 : 0);
  }
};

}  // namespace accessvdb::kernels
