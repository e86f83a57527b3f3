#include "goal_region.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <ompl/base/spaces/SE2StateSpace.h>
#include <ompl/util/RandomNumbers.h>

namespace peers {
namespace {

constexpr std::size_t kSamples = 16;
constexpr int kTries = 1000;

using SE2State = ompl::base::SE2StateSpace::StateType;

}  // namespace

std::vector<Pose> draw_free_poses(const Pose &goal, const Tolerance &tolerance,
                                  const Footprint &footprint) {
  ompl::RNG random;
  std::vector<Pose> samples;
  Pose pose = goal;
  for (int tries = 0; tries < kTries && samples.size() < kSamples; ++tries) {
    if (footprint.is_on_grid(pose) && footprint.is_free(pose))
      samples.push_back(pose);
    const double away_m = tolerance.within_m * std::sqrt(random.uniform01());
    const double bearing_rad = random.uniformReal(-M_PI, M_PI);
    pose = {goal.x_m + away_m * std::cos(bearing_rad), goal.y_m + away_m * std::sin(bearing_rad),
            goal.yaw_rad + random.uniformReal(-tolerance.within_rad, tolerance.within_rad)};
  }
  return samples;
}

GoalRegion::GoalRegion(const ompl::base::SpaceInformationPtr &space, const Pose &goal,
                       const Tolerance &tolerance, std::vector<Pose> samples)
    : GoalSampleableRegion(space), goal_(goal), tolerance_(tolerance), samples_(std::move(samples)) {}

double GoalRegion::distanceGoal(const ompl::base::State *state) const {
  const auto *pose = state->as<SE2State>();
  const double away_m = std::hypot(pose->getX() - goal_.x_m, pose->getY() - goal_.y_m);
  const double turned_rad = std::abs(std::remainder(pose->getYaw() - goal_.yaw_rad, 2.0 * M_PI));
  return std::max(away_m - tolerance_.within_m, 0.0) +
         std::max(turned_rad - tolerance_.within_rad, 0.0);
}

void GoalRegion::sampleGoal(ompl::base::State *state) const {
  const Pose &sample = samples_[next_++ % samples_.size()];
  auto *pose = state->as<SE2State>();
  pose->setXY(sample.x_m, sample.y_m);
  pose->setYaw(std::remainder(sample.yaw_rad, 2.0 * M_PI));
}

unsigned int GoalRegion::maxSampleCount() const {
  return static_cast<unsigned int>(samples_.size());
}

}  // namespace peers
