#include "planning.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <memory>
#include <string>

#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/spaces/DubinsStateSpace.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/informedtrees/BITstar.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/geometric/planners/rrt/RRTstar.h>

#include "goal_region.hpp"

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace peers {
namespace {

// Farthest that two poses of a path that is handed over lie apart.
constexpr double kSpacingM = 0.05;
// With 3 m, or any length, RRTConnect and RRT* solve fewer goals of s_road, and later.
constexpr double kRangeM = 8.0;
// RRTConnect's tree from the goal cuts its motions short as if they were driven the other way round:
// with 3, 6, 8 or 12 m it solves no goal of s_road for a Dubins car, uncut 22 of 50.
constexpr double kAnyRangeM = 1e6;

using SE2State = ob::SE2StateSpace::StateType;

template <typename Planner>
ob::PlannerPtr make(const ob::SpaceInformationPtr &space) {
  return std::make_shared<Planner>(space);
}

class Stopwatch {
 public:
  double cpu_ms() const { return processor_ms() - cpu_ms_; }
  double elapsed_ms() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - begin_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;

  static double processor_ms() {
    timespec time{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
  }

  double cpu_ms_ = processor_ms();
  Clock::time_point begin_ = Clock::now();
};

Pose pose_of(const ob::State *state) {
  const auto *pose = state->as<SE2State>();
  return {pose->getX(), pose->getY(), pose->getYaw()};
}

// The car's own space, with positions that the grid holds.
ob::StateSpacePtr space_of(Car car, const Problem &problem) {
  const double radius_m = problem.vehicle.turning_radius_m;
  std::shared_ptr<ob::SE2StateSpace> space;
  if (car == Car::kDubins)
    space = std::make_shared<ob::DubinsStateSpace>(radius_m);
  else
    space = std::make_shared<ob::ReedsSheppStateSpace>(radius_m);
  const Grid &grid = problem.grid;
  ob::RealVectorBounds bounds(2);
  bounds.setLow(0, (grid.ego_row - grid.rows + 0.5) * grid.resolution_m);
  bounds.setHigh(0, (grid.ego_row + 0.5) * grid.resolution_m);
  bounds.setLow(1, (grid.ego_col - grid.cols + 0.5) * grid.resolution_m);
  bounds.setHigh(1, (grid.ego_col + 0.5) * grid.resolution_m);
  space->setBounds(bounds);
  return space;
}

std::vector<Pose> poses_along(const og::PathGeometric &path) {
  const ob::SpaceInformationPtr &information = path.getSpaceInformation();
  const ob::StateSpacePtr &space = information->getStateSpace();
  ob::State *between = information->allocState();
  std::vector<Pose> poses{pose_of(path.getState(0))};
  for (std::size_t index = 1; index < path.getStateCount(); ++index) {
    const ob::State *from = path.getState(index - 1), *to = path.getState(index);
    const double pieces = std::max(1.0, std::ceil(space->distance(from, to) / kSpacingM));
    for (double piece = 1.0; piece <= pieces; piece += 1.0) {
      space->interpolate(from, to, piece / pieces, between);
      poses.push_back(pose_of(between));
    }
  }
  information->freeState(between);
  return poses;
}

}  // namespace

std::vector<PlannerKind> planner_kinds() {
  return {
      {"rrt-connect/dubins", Car::kDubins, kAnyRangeM, make<og::RRTConnect>},
      {"rrt-star/dubins", Car::kDubins, kRangeM, make<og::RRTstar>},
      {"bit-star/dubins", Car::kDubins, kRangeM, make<og::BITstar>},
      {"rrt-connect/reeds-shepp", Car::kReedsShepp, kRangeM, make<og::RRTConnect>},
      {"rrt-star/reeds-shepp", Car::kReedsShepp, kRangeM, make<og::RRTstar>},
      {"bit-star/reeds-shepp", Car::kReedsShepp, kRangeM, make<og::BITstar>},
  };
}

Answer plan(const PlannerKind &kind, const Problem &problem, const Footprint &footprint,
            const Pose &goal) {
  const Stopwatch stopwatch;
  std::vector<Pose> samples = draw_free_poses(goal, problem.tolerance, footprint);
  if (samples.empty())
    return {stopwatch.cpu_ms(), stopwatch.elapsed_ms(), {}};

  const ob::StateSpacePtr space = space_of(kind.car, problem);
  og::SimpleSetup setup(space);
  const ob::SpaceInformationPtr &information = setup.getSpaceInformation();
  setup.setStateValidityChecker([&](const ob::State *state) {
    const Pose pose = pose_of(state);
    return footprint.is_on_grid(pose) && footprint.is_free(pose);
  });
  information->setStateValidityCheckingResolution(problem.tested_every_m /
                                                  space->getMaximumExtent());
  ob::ScopedState<ob::SE2StateSpace> start(space);
  start->setXY(0.0, 0.0);
  start->setYaw(0.0);
  setup.setStartState(start);
  setup.setGoal(std::make_shared<GoalRegion>(information, goal, problem.tolerance, samples));
  const ob::PlannerPtr planner = kind.make(information);
  if (planner->params().hasParam("range"))
    planner->params().setParam("range", std::to_string(kind.range_m));
  setup.setPlanner(planner);
  // Any path satisfies: RRT* and BIT* would go on to shorten theirs until the limit.
  const auto objective = std::make_shared<ob::PathLengthOptimizationObjective>(information);
  objective->setCostThreshold(objective->infiniteCost());
  setup.setOptimizationObjective(objective);
  setup.setup();
  setup.solve(ob::PlannerTerminationCondition([&] {
    return setup.getProblemDefinition()->hasExactSolution() ||
           stopwatch.cpu_ms() >= problem.limit_s * 1e3;
  }));

  Answer answer{stopwatch.cpu_ms(), stopwatch.elapsed_ms(), {}};
  if (setup.haveExactSolutionPath())
    answer.path = poses_along(setup.getSolutionPath());
  return answer;
}

}  // namespace peers
