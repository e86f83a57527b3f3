// A problem as the bench writes it to standard input: words, and numbers in metres and radians.
#pragma once

#include <iosfwd>
#include <vector>

namespace peers {

// x forward, y left, from the middle of the vehicle's rear axle at the start.
struct Pose {
  double x_m, y_m, yaw_rad;
};

// Row 0 is farthest ahead, column 0 farthest left; a cell is the square around its centre.
struct Grid {
  int rows, cols;
  double resolution_m;
  int ego_row, ego_col;
  std::vector<char> occupied;  // row by row, 0 or 1

  double row_of(double x_m) const { return ego_row - x_m / resolution_m; }
  double col_of(double y_m) const { return ego_col - y_m / resolution_m; }
};

// A rectangle around the rear axle.
struct Vehicle {
  double front_m, rear_m, half_width_m, turning_radius_m;
};

// How near to a goal is near enough.
struct Tolerance {
  double within_m, within_rad;
};

struct Problem {
  Grid grid;
  Vehicle vehicle;
  Tolerance tolerance;
  double limit_s;  // processor time for one goal
  double tested_every_m;
  std::vector<Pose> goals;
};

// Throws std::runtime_error that names the word which was expected.
Problem read_problem(std::istream &input);

}  // namespace peers
