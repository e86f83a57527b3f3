// A goal as what lies near enough to it, of which a few poses are drawn beforehand.
#pragma once

#include <vector>

#include <ompl/base/goals/GoalSampleableRegion.h>

#include "footprint.hpp"
#include "problem.hpp"

namespace peers {

// Poses near the goal at which the vehicle is free, the goal itself first; none if there seem to be
// none. They are finitely many because BIT* asks for all of them before it begins.
std::vector<Pose> draw_free_poses(const Pose &goal, const Tolerance &tolerance,
                                  const Footprint &footprint);

class GoalRegion : public ompl::base::GoalSampleableRegion {
 public:
  // `samples` must not be empty.
  GoalRegion(const ompl::base::SpaceInformationPtr &space, const Pose &goal,
             const Tolerance &tolerance, std::vector<Pose> samples);

  // Metres plus radians that are missing.
  double distanceGoal(const ompl::base::State *state) const override;
  void sampleGoal(ompl::base::State *state) const override;
  unsigned int maxSampleCount() const override;

 private:
  Pose goal_;
  Tolerance tolerance_;
  std::vector<Pose> samples_;
  mutable std::size_t next_ = 0;
};

}  // namespace peers
