// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/agreement_check.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "accessvdb/error.h"
#include "options/options.h"

namespace accessvdb::tools {
namespace {

std::string percent(double share) { return numberText(std::floor(1000 * share) / 10) + " %"; }

struct Doubt {
  std::string problem, cure;
};

std::string inWords(const Doubt& doubt) { return doubt.problem + ". " + doubt.cure; }

std::optional<Doubt> doubtOf(const io::ScanAgreement& agreement) {
  if (agreement.verdict != io::AgreementVerdict::Doubtful && agreement.verdict != io::AgreementVerdict::Disagree)
    return std::nullopt;
  const io::AgreementCounts& counts = agreement.counts;
  const auto score = [](const io::AgreementCounts& of) { return std::to_string(std::lround(100 * of.score())); };
  if (!agreement.outliers.empty() && !agreement.cure) {
    std::string names;
    for (const std::string& name : agreement.outliers) names += (names.empty() ? "" : ", ") + name;
    const bool one = agreement.outliers.size() == 1;
    return Doubt{std::to_string(agreement.outliers.size()) + " of " + std::to_string(agreement.scans) +
                     " scans compared " + (one ? "does" : "do") + " not agree with the others (" + names + ")",
                 one ? "Its pose is wrong, or the scan itself: leave it out, or correct its pose"
                     : "Their poses are wrong, or the scans themselves: leave them out, or correct their poses"};
  }
  Doubt doubt = {"the scans do not agree: of " + std::to_string(counts.asked()) + " returns, " +
                     std::to_string(counts.agreeing) + " lie where another scan has a surface, and " +
                     std::to_string(counts.contradicting) + " where it saw free space",
                 "Check that poses and scans belong together (--pose-format, --calib, --extrinsic, --time-offset)"};
  if (agreement.cure)
    doubt.cure = "They agree better (" + score(agreement.cure->counts) + " instead of " + score(counts) +
                 " of 100) if " + cureInWords(*agreement.cure);
  return doubt;
}

std::string levelFlag(const Eigen::Vector3d& up_W) {
  const io::Level level = io::levelFor(up_W);
  const auto degrees = [](double angle_rad) {
    return numberText(std::round(angle_rad * 18000 / std::numbers::pi) / 100);
  };
  return "--level=" + degrees(level.roll_rad) + "," + degrees(level.pitch_rad);
}

/// Coordinates in which the origin is the middle of the Earth, so that up is away from it. Nothing else is so large.
std::optional<Eigen::Vector3d> upOnEarth(const Eigen::Vector3d& p_W) {
  constexpr double kLeast_m = 6.3e6, kMost_m = 6.4e6;  // from the poles, less 50 km, to the equator, and flights
  const double radius_m = p_W.norm();
  if (!(radius_m > kLeast_m && radius_m < kMost_m)) return std::nullopt;
  return p_W / radius_m;
}

/// Where z is not up, and nothing else is known to be wrong with the poses.
std::optional<std::string> tiltWarning(const io::ScanSequence& scans, const io::AgreementMeter& meter,
                                       const io::ScanAgreement& agreement, bool levelled) {
  const auto& known = scans.warnings();
  const bool said = std::any_of(known.begin(), known.end(), [](const auto& one) { return one.id == "poses.up"; });
  if (agreement.cure || said) return std::nullopt;
  const auto first = scans.size() > 0 && !levelled ? scans.givenPose(0) : std::nullopt;
  if (const auto up_W = first ? upOnEarth(first->translation()) : std::nullopt) {
    return "z is not up: the poses are as far from their origin as the surface of the Earth is from its middle "
           "(ECEF). " +
           levelFlag(*up_W) + " turns the world level; a local frame (east, north, up) is better";
  }
  if (const auto up_W = meter.upBesideZ_W()) {
    const double off_deg = std::acos(std::clamp(up_W->z(), -1.0, 1.0)) * 180 / std::numbers::pi;
    return "most level surfaces are " + numberText(std::round(10 * off_deg) / 10) +
           " degrees off level. Check --extrinsic and the poses; if the world itself is tilted, " + levelFlag(*up_W) +
           " turns it level";
  }
  return std::nullopt;
}

}  // namespace

std::string agreementInWords(const io::ScanAgreement& agreement) {
  if (agreement.verdict == io::AgreementVerdict::NotMeasured)
    return "agreement of the scans: not measured (" + agreement.why_not + ")";
  const io::AgreementCounts& counts = agreement.counts;
  return "agreement of the scans: " + percent(counts.share()) + " of " +
         std::to_string(counts.agreeing + counts.contradicting) +
         " returns lie where another scan has a surface, the others where it saw free space (" +
         std::to_string(agreement.scans) + " scans compared)";
}

std::string cureInWords(const io::PoseCure& cure) {
  switch (cure.fault) {
    case io::PoseFault::QuaternionWFirst:
      return "the quaternions are w x y z: write them as x y z w, or name the columns in a header";
    case io::PoseFault::QuaternionWLast:
      return "the quaternions are x y z w: write them as w x y z, or name the columns in a header";
    case io::PoseFault::Inverse:
      return "the poses are inverse, world to sensor: invert each of them";
    case io::PoseFault::InverseExtrinsic:
      return "--extrinsic is inverse, body to sensor: give the sensor's pose in the body";
    case io::PoseFault::Turned: {
      std::string rpy;
      for (int axis = 0; axis < 3; ++axis) rpy += "," + (axis == cure.axis ? numberText(cure.value) : "0");
      return "the sensor is turned by " + numberText(cure.value) + " degrees about its " + "xyz"[cure.axis] +
             " axis: --extrinsic 0,0,0" + rpy + " (after the one that is given)";
    }
    case io::PoseFault::InWorld:
      return "the scans are in the world frame already: map them without --poses, with --trajectory, --stations or "
             "--sensor-at";
    case io::PoseFault::TimeOffset:
      return "the poses are those of another time: --time-offset " + numberText(cure.value) +
             " more than what is given";
    case io::PoseFault::Unit:
      return "scans and poses are in different units: multiply the positions of the poses by " +
             numberText(cure.value) + ", if the scans are in metres";
    case io::PoseFault::None:
      break;
  }
  return "";
}

io::ScanAgreement checkAgreement(const MapOptions& options, double range_noise_m, io::ScanSequence& scans,
                                 Messages& messages) {
  const io::ScanInputOptions input = scanInputOptions(options);
  const io::AgreementMeter meter = io::measureAgreement(scans, range_noise_m, input.T_B_S);
  io::ScanAgreement agreement = meter.measure();
  messages.notice(agreementInWords(agreement));
  if (const auto tilt = tiltWarning(scans, meter, agreement, input.level.has_value()))
    messages.warning("poses.up", *tilt);
  const auto doubt = doubtOf(agreement);
  if (!doubt) return agreement;
  if (agreement.verdict == io::AgreementVerdict::Disagree && !options.allow_disagreement)
    throw UnusableInput("poses.disagree", options.poses.empty() ? options.scans : options.poses, doubt->problem,
                        doubt->cure + "; --allow-disagreement goes on");
  messages.warning("poses.disagree", inWords(*doubt));
  return agreement;
}

std::optional<std::string> agreementWarning(const io::ScanAgreement& agreement) {
  const auto doubt = doubtOf(agreement);
  return doubt ? std::optional(inWords(*doubt)) : std::nullopt;
}

}  // namespace accessvdb::tools
