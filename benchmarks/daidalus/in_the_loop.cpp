// DAIDALUS in the loop: states in, a track to steer out (benchmarks/daidalus/in_the_loop.py).
//
//   in_the_loop VOLUME TURN_RATE MIN_SPEED MAX_SPEED       deg/s, m/s
//
// VOLUME: do365_en_route, do365_non_cooperative (DAIDALUS's DO-365B without sensor uncertainty
// mitigation, its alerters 1 and 3), or f3442 (the same with a cylinder of 2000 ft and 250 ft).
// A request is the number of encounters, then for each of them its number, the time, s, the ownship
// (x, y, altitude, m; track, deg; ground speed, vertical speed, m/s), the track to its goal, the
// number of intruders, and these likewise. The answer is a track for each, deg. DAIDALUS remembers
// each encounter by its number; one whose time is 0 begins anew.

#include <cmath>
#include <iostream>
#include <map>
#include <string>

#include "Daidalus.h"
#include "WCV_TAUMOD.h"

using namespace larcfm;

namespace {

Daidalus configured(const std::string& volume, double turn_rate, double slow, double fast) {
  Daidalus daa;
  daa.set_DO_365B(true, false);
  daa.setTurnRate(turn_rate, "deg/s");
  daa.setMinHorizontalSpeed(slow, "m/s");
  daa.setMaxHorizontalSpeed(fast, "m/s");
  if (volume == "f3442") {
    WCVTable cylinder;
    cylinder.setDTHR(2000.0, "ft");
    cylinder.setZTHR(250.0, "ft");
    cylinder.setTTHR(0.0);
    cylinder.setTCOA(0.0);
    const WCV_TAUMOD volume_of_all("F3442", cylinder);
    Alerter alerter("F3442");
    alerter.addLevel(AlertThresholds(volume_of_all, 55.0, 75.0, BandsRegion::NONE));
    alerter.addLevel(AlertThresholds(volume_of_all, 55.0, 75.0, BandsRegion::MID));
    alerter.addLevel(AlertThresholds(volume_of_all, 25.0, 55.0, BandsRegion::NEAR));
    daa.clearAlerters();
    daa.addAlerter(alerter);
    daa.setMinHorizontalRecovery(2000.0, "ft");
    daa.setMinVerticalRecovery(250.0, "ft");
  }
  return daa;
}

struct Aircraft {
  double x, y, altitude, track, speed, climb;
  Position position() const {
    return Position::makeXYZ(x, "m", y, "m", altitude, "m");
  }
  Velocity velocity() const {
    return Velocity::makeTrkGsVs(track, "deg", speed, "m/s", climb, "m/s");
  }
};

std::istream& operator>>(std::istream& in, Aircraft& a) {
  return in >> a.x >> a.y >> a.altitude >> a.track >> a.speed >> a.climb;
}

// The course to the goal where the present course and that one are free; the present one where it
// alone is; else DAIDALUS's resolution to the side that it prefers, where it has none to the other.
double steer(Daidalus& daa, double track, double goal) {
  const bool closed = BandsRegion::isConflictBand(daa.regionOfHorizontalDirection(track, "deg"));
  if (!closed) {
    const auto ahead = daa.regionOfHorizontalDirection(goal, "deg");
    return BandsRegion::isConflictBand(ahead) ? track : goal;
  }
  const bool right = daa.preferredHorizontalDirectionRightOrLeft();
  for (const bool side : {right, !right}) {
    const double resolution = daa.horizontalDirectionResolution(side, "deg");
    if (std::isfinite(resolution)) return resolution;
  }
  return track;
}

}  // namespace

int main(int count, char** words) {
  if (count != 5) {
    std::cerr << "expected VOLUME TURN_RATE MIN_SPEED MAX_SPEED" << std::endl;
    return 2;
  }
  const std::string volume = words[1];
  const Daidalus fresh =
      configured(volume, std::stod(words[2]), std::stod(words[3]), std::stod(words[4]));
  const int alerter = volume == "do365_non_cooperative" ? 3 : 1;
  std::map<int, Daidalus> encounters;
  std::cout.precision(12);
  int asked = 0;
  while (std::cin >> asked) {
    for (int n = 0; n < asked; ++n) {
      int number = 0, intruders = 0;
      double time = 0.0, goal = 0.0;
      Aircraft own{};
      std::cin >> number >> time >> own >> goal >> intruders;
      auto place = encounters.find(number);
      if (place == encounters.end() || time == 0.0) {
        place = encounters.insert_or_assign(number, fresh).first;
      }
      Daidalus& daa = place->second;
      daa.setOwnshipState("ownship", own.position(), own.velocity(), time);
      for (int i = 0; i < intruders; ++i) {
        Aircraft other{};
        std::cin >> other;
        const int index = daa.addTrafficState(
            "intruder_" + std::to_string(i), other.position(), other.velocity(), time);
        daa.setAlerterIndex(index, alerter);
      }
      std::cout << steer(daa, own.track, goal) << "\n";
    }
    std::cout.flush();
  }
  return 0;
}
