// Whether the vehicle's rectangle, its inside included, touches an occupied cell.
#pragma once

#include <array>
#include <vector>

#include "problem.hpp"

namespace peers {

// Most poses are decided by the distance to the nearest occupied cell at a few places along the
// vehicle's axis; the others by the columns that the rectangle covers in each row. What lies beyond
// the grid's edge is free.
class Footprint {
 public:
  Footprint(const Grid &grid, const Vehicle &vehicle);

  bool is_free(const Pose &pose) const;

  // Whether the rear axle's middle is on the grid.
  bool is_on_grid(const Pose &pose) const;

 private:
  enum class Verdict { kFree, kHit, kUnclear };
  struct Corner {
    double row, col;
  };

  void measure_clearance(double most_cells);
  Verdict judge_by_discs(const Pose &pose) const;
  bool is_free_row_by_row(const Pose &pose) const;
  std::array<Corner, 4> corners_at(const Pose &pose) const;
  int occupied_before(int row, int col) const { return before_[row * (grid_.cols + 1) + col]; }

  static constexpr int kDiscs = 4;

  const Grid &grid_;
  const Vehicle vehicle_;
  std::vector<float> clearance_cells_;  // from a cell's centre to the nearest occupied one's, capped
  std::vector<int> before_;             // occupied cells left of a column, in each row
  std::array<double, kDiscs> outer_m_;  // centres along the axis of discs that cover the rectangle
  std::array<double, kDiscs> inner_m_;  // and of discs inside it
  double outer_cells_;                  // their radii
  double inner_cells_;
};

}  // namespace peers
