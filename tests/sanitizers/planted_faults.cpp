// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Commits one fault, to see that the sanitizer of this build still finds it behind the suppressions:
///
///     planted_faults overflow|cast|leak|race|none
///
/// With "none" it does what is right, in threads of oneTBB: a finding there means that oneTBB itself is not built with
/// the thread sanitizer.
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_group.h>

#include <cstdio>
#include <limits>
#include <memory>
#include <string_view>
#include <thread>
#include <vector>

namespace {

int sum = 0;

/// Keeps the compiler from knowing a value.
template <typename T>
T unknown(T value) {
  volatile T copy = value;
  return copy;
}

int rightWork() {
  for (int round = 0; round < 50; ++round) {
    std::vector<int> squares(10000);
    tbb::parallel_for(0, 10000, [&](int n) { squares[static_cast<std::size_t>(n)] = n * n; });
    int both[2] = {0, 0};
    tbb::task_group group;
    for (int k = 0; k < 2; ++k)
      group.run([&both, &squares, k] {
        for (std::size_t n = 0; n < squares.size(); ++n) both[k] ^= squares[n];
      });
    group.wait();
    if (both[0] != both[1]) return 1;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view fault = argc == 2 ? argv[1] : "";
  if (fault == "none") return rightWork();
  if (fault == "overflow") {
    const auto four = std::make_unique<int[]>(4);
    std::printf("%d\n", four[unknown<std::size_t>(4)]);
  } else if (fault == "cast") {
    std::printf("%d\n", static_cast<int>(unknown(std::numeric_limits<double>::quiet_NaN())));
  } else if (fault == "leak") {
    std::printf("%d\n", *unknown(new int(1)));
  } else if (fault == "race") {
    std::jthread one([] { ++sum; });
    ++sum;
  } else {
    std::fprintf(stderr, "usage: planted_faults overflow|cast|leak|race|none\n");
    return 2;
  }
  return 0;
}
