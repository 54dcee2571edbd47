// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The eigenvector of a covariance's smallest eigenvalue, for one or several covariances at a time: in terms of Real
// (one or several doubles), Flag, and the functions of either. Included inside a namespace after these, hence no
// include guard. Every operation rounds once, in the same order, so all of them give the same bits.

/// Whether all further rotations would leave v as it is, to the bit. They are by angles below off-diagonal / gap, so
/// their cosines round to 1, and what they add to an entry of v is below a quarter of its last place. Each sweep leaves
/// less off the diagonal than the one before, so this holds for all that follow.
/// @param a  nearly diagonal  @param v  rotation so far
ACCESSVDB_HOSTDEV inline bool rotationsAreDone(const Real (&a)[3][3], const Real (&v)[3][3]) {
  const Real most = higher(higher(magnitude(a[0][1]), magnitude(a[0][2])), magnitude(a[1][2]));
  const Real gap = lower(lower(magnitude(minus(a[1][1], a[0][0])), magnitude(minus(a[2][2], a[0][0]))),
                         magnitude(minus(a[2][2], a[1][1])));
  Real least = magnitude(v[0][0]);
  for (int k = 0; k < 3; ++k) {
    for (int n = 0; n < 3; ++n) least = lower(least, magnitude(v[k][n]));
  }
  constexpr double kFar = 72057594037927936.0;                        // 2^56: a double has 53 digits
  return areAll(atMost(times(most, real(kFar)), times(gap, least)));  // also if nothing at all is off the diagonal
}

/// Cyclic Jacobi with a fixed number of sweeps, as far as they matter: the same operations on every machine, only +, -,
/// *, / and sqrt.
/// @param a  covariance, symmetric  @param normal  unit eigenvector of the smallest eigenvalue; for equal eigenvalues,
///   of the lower axis
ACCESSVDB_HOSTDEV inline void smallestOf(Real (&a)[3][3], Real (&normal)[3]) {
  const Real zero = real(0), one = real(1);
  Real v[3][3] = {{one, zero, zero}, {zero, one, zero}, {zero, zero, one}};
  constexpr int kSweeps = 8;  // quadratic convergence: 5 sweeps reach double precision
  for (int sweep = 0; sweep < kSweeps && !rotationsAreDone(a, v); ++sweep) {
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        const Real apq = a[p][q];
        const Flag turns = differ(apq, zero);
        if (areNone(turns)) continue;
        const Real theta = over(minus(a[q][q], a[p][p]), times(real(2), apq));
        const Flag below = isBelow(theta, zero);
        const Real sign = choose(below, real(-1), one), size = choose(below, negative(theta), theta);
        const Real t = choose(isBelow(real(1e150), size), over(real(0.5), theta),
                              over(sign, plus(size, root(plus(times(theta, theta), one)))));
        const Real cosine = over(one, root(plus(times(t, t), one))), sine = times(t, cosine);
        const int r = 3 - p - q;
        a[p][p] = choose(turns, minus(a[p][p], times(t, apq)), a[p][p]);
        a[q][q] = choose(turns, plus(a[q][q], times(t, apq)), a[q][q]);
        a[p][q] = a[q][p] = choose(turns, zero, apq);
        const Real arp = a[r][p], arq = a[r][q];
        a[r][p] = a[p][r] = choose(turns, minus(times(cosine, arp), times(sine, arq)), arp);
        a[r][q] = a[q][r] = choose(turns, plus(times(sine, arp), times(cosine, arq)), arq);
        for (int k = 0; k < 3; ++k) {
          const Real vkp = v[k][p], vkq = v[k][q];
          v[k][p] = choose(turns, minus(times(cosine, vkp), times(sine, vkq)), vkp);
          v[k][q] = choose(turns, plus(times(sine, vkp), times(cosine, vkq)), vkq);
        }
      }
    }
  }
  const Flag second = isBelow(a[1][1], a[0][0]);
  const Flag third = isBelow(a[2][2], choose(second, a[1][1], a[0][0]));
  for (int k = 0; k < 3; ++k) normal[k] = choose(third, v[k][2], choose(second, v[k][1], v[k][0]));
  const Real length =
      root(plus(plus(times(normal[0], normal[0]), times(normal[1], normal[1])), times(normal[2], normal[2])));
  for (Real& of_axis : normal) of_axis = over(of_axis, length);
}
