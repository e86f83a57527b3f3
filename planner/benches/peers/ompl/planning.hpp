// One goal by one planner of the library.
#pragma once

#include <string>
#include <vector>

#include <ompl/base/Planner.h>

#include "footprint.hpp"
#include "problem.hpp"

namespace peers {

enum class Car { kDubins, kReedsShepp };  // forward only, and forward and backward

struct PlannerKind {
  std::string name;
  Car car;
  double range_m;  // longest motion that a tree grows by, for planners that have one
  ompl::base::PlannerPtr (*make)(const ompl::base::SpaceInformationPtr &);
};

// Everything that is compared.
std::vector<PlannerKind> planner_kinds();

struct Answer {
  double cpu_ms, elapsed_ms;
  std::vector<Pose> path;  // empty unless solved
};

// Plans until the first path or the problem's limit.
Answer plan(const PlannerKind &kind, const Problem &problem, const Footprint &footprint,
            const Pose &goal);

}  // namespace peers
