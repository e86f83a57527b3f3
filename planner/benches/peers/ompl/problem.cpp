#include "problem.hpp"

#include <istream>
#include <stdexcept>
#include <string>

namespace peers {
namespace {

// Largest side of a grid, and most goals.
constexpr int kMostCells = 4096;
constexpr int kMostGoals = 100'000;

void expect(std::istream &input, const std::string &word) {
  std::string found;
  if (!(input >> found) || found != word)
    throw std::runtime_error("problem: found \"" + found + "\", expected \"" + word + "\"");
}

void require(bool holds, const std::string &what) {
  if (!holds)
    throw std::runtime_error("problem: " + what);
}

Grid read_grid(std::istream &input) {
  Grid grid{};
  expect(input, "grid");
  input >> grid.rows >> grid.cols >> grid.resolution_m >> grid.ego_row >> grid.ego_col;
  const auto is_side = [](int cells) { return cells > 0 && cells <= kMostCells; };
  require(input && is_side(grid.rows) && is_side(grid.cols) && grid.resolution_m > 0.0,
          "the grid has no size");
  for (int row = 0; row < grid.rows; ++row) {
    std::string cells;
    input >> cells;
    require(cells.size() == static_cast<std::size_t>(grid.cols), "a row is too short or too long");
    for (const char cell : cells)
      grid.occupied.push_back(cell == '1');
  }
  return grid;
}

}  // namespace

Problem read_problem(std::istream &input) {
  Problem problem{};
  problem.grid = read_grid(input);
  Vehicle &vehicle = problem.vehicle;
  expect(input, "vehicle");
  input >> vehicle.front_m >> vehicle.rear_m >> vehicle.half_width_m >> vehicle.turning_radius_m;
  expect(input, "tolerance");
  input >> problem.tolerance.within_m >> problem.tolerance.within_rad;
  expect(input, "limit");
  input >> problem.limit_s;
  expect(input, "tested_every");
  input >> problem.tested_every_m;
  require(problem.tested_every_m > 0.0, "poses must be tested at some distance");
  int count = 0;
  expect(input, "goals");
  input >> count;
  require(count >= 0 && count <= kMostGoals, "too many goals");
  for (int index = 0; index < count; ++index) {
    Pose goal{};
    input >> goal.x_m >> goal.y_m >> goal.yaw_rad;
    problem.goals.push_back(goal);
  }
  require(static_cast<bool>(input), "a number is missing");
  return problem;
}

}  // namespace peers
