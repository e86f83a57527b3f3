#include "footprint.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace peers {
namespace {

// Farthest that a point of a cell lies from its centre.
const double kHalfDiagonalCells = std::sqrt(0.5);

struct Interval {
  double least = std::numeric_limits<double>::infinity();
  double most = -std::numeric_limits<double>::infinity();

  void add(double value) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
};

}  // namespace

Footprint::Footprint(const Grid &grid, const Vehicle &vehicle) : grid_(grid), vehicle_(vehicle) {
  const double length_m = vehicle.front_m + vehicle.rear_m;
  const double share_m = length_m / kDiscs;
  const double inner_radius_m = std::min(vehicle.half_width_m, length_m / 2.0);
  const double inner_apart_m = (length_m - 2.0 * inner_radius_m) / (kDiscs - 1);
  for (int disc = 0; disc < kDiscs; ++disc) {
    outer_m_[disc] = -vehicle.rear_m + (disc + 0.5) * share_m;
    inner_m_[disc] = -vehicle.rear_m + inner_radius_m + disc * inner_apart_m;
  }
  outer_cells_ = std::hypot(share_m / 2.0, vehicle.half_width_m) / grid.resolution_m;
  inner_cells_ = inner_radius_m / grid.resolution_m;
  before_.assign(static_cast<std::size_t>(grid.rows) * (grid.cols + 1), 0);
  for (int row = 0; row < grid.rows; ++row)
    for (int col = 0; col < grid.cols; ++col)
      before_[row * (grid.cols + 1) + col + 1] =
          occupied_before(row, col) + grid.occupied[row * grid.cols + col];
  measure_clearance(outer_cells_ + 2.0 * kHalfDiagonalCells + 1.0);
}

// Distances along columns first, then the least over the columns near by; both are exact up to the cap.
void Footprint::measure_clearance(double most_cells) {
  const int reach = static_cast<int>(std::ceil(most_cells));
  const int rows = grid_.rows, cols = grid_.cols;
  std::vector<int> along(grid_.occupied.size());
  for (int col = 0; col < cols; ++col) {
    const auto sweep = [&](int first, int step) {
      int distance = reach;
      for (int row = first; row >= 0 && row < rows; row += step) {
        int &cell = along[row * cols + col];
        distance = grid_.occupied[row * cols + col] ? 0 : std::min(distance + 1, reach);
        cell = step > 0 ? distance : std::min(cell, distance);
      }
    };
    sweep(0, 1);
    sweep(rows - 1, -1);
  }
  clearance_cells_.resize(along.size());
  for (int row = 0; row < rows; ++row)
    for (int col = 0; col < cols; ++col) {
      int least = reach * reach;
      for (int near = std::max(0, col - reach); near <= std::min(cols - 1, col + reach); ++near) {
        const int up = along[row * cols + near], aside = near - col;
        least = std::min(least, up * up + aside * aside);
      }
      clearance_cells_[row * cols + col] = std::sqrt(static_cast<float>(least));
    }
}

bool Footprint::is_on_grid(const Pose &pose) const {
  const double row = grid_.row_of(pose.x_m), col = grid_.col_of(pose.y_m);
  return row >= -0.5 && row <= grid_.rows - 0.5 && col >= -0.5 && col <= grid_.cols - 0.5;
}

bool Footprint::is_free(const Pose &pose) const {
  const Verdict verdict = judge_by_discs(pose);
  return verdict == Verdict::kUnclear ? is_free_row_by_row(pose) : verdict == Verdict::kFree;
}

Footprint::Verdict Footprint::judge_by_discs(const Pose &pose) const {
  const double cos = std::cos(pose.yaw_rad), sin = std::sin(pose.yaw_rad);
  struct Place {
    double row, col;
    int near_row, near_col;  // the cell of the grid that is nearest
  };
  const auto place_at = [&](double ahead_m) {
    const double row = grid_.row_of(pose.x_m + ahead_m * cos);
    const double col = grid_.col_of(pose.y_m + ahead_m * sin);
    const auto nearest = [](double at, int count) {
      return static_cast<int>(std::min(std::max(at + 0.5, 0.0), count - 1.0));
    };
    return Place{row, col, nearest(row, grid_.rows), nearest(col, grid_.cols)};
  };
  const auto clearance_at = [&](const Place &place) {
    return clearance_cells_[place.near_row * grid_.cols + place.near_col];
  };
  // A place off the grid is no nearer to any occupied cell than where the grid's edge is nearest to it.
  const auto is_clear = [&](double ahead_m) {
    return clearance_at(place_at(ahead_m)) > outer_cells_ + 2.0 * kHalfDiagonalCells;
  };
  if (std::all_of(outer_m_.begin(), outer_m_.end(), is_clear))
    return Verdict::kFree;
  const auto holds_occupied_centre = [&](double ahead_m) {
    const Place place = place_at(ahead_m);
    const double left_cells = inner_cells_ - clearance_at(place);
    const double row = place.row - place.near_row, col = place.col - place.near_col;
    return left_cells > 0.0 && row * row + col * col < left_cells * left_cells;
  };
  return std::any_of(inner_m_.begin(), inner_m_.end(), holds_occupied_centre) ? Verdict::kHit
                                                                              : Verdict::kUnclear;
}

std::array<Footprint::Corner, 4> Footprint::corners_at(const Pose &pose) const {
  const double cos = std::cos(pose.yaw_rad), sin = std::sin(pose.yaw_rad);
  const auto corner = [&](double ahead_m, double left_m) {
    return Corner{grid_.row_of(pose.x_m + ahead_m * cos - left_m * sin),
                  grid_.col_of(pose.y_m + ahead_m * sin + left_m * cos)};
  };
  const double front_m = vehicle_.front_m, rear_m = vehicle_.rear_m, left_m = vehicle_.half_width_m;
  return {corner(front_m, left_m), corner(front_m, -left_m), corner(-rear_m, -left_m),
          corner(-rear_m, left_m)};
}

bool Footprint::is_free_row_by_row(const Pose &pose) const {
  const std::array<Corner, 4> corners = corners_at(pose);
  Interval rows;
  for (const Corner &corner : corners)
    rows.add(corner.row);
  const int first_row = std::max(0, static_cast<int>(std::lround(rows.least)));
  const int last_row = std::min(grid_.rows - 1, static_cast<int>(std::lround(rows.most)));
  for (int row = first_row; row <= last_row; ++row) {
    const double edges[2] = {row - 0.5, row + 0.5};
    Interval cols;
    for (std::size_t index = 0; index < corners.size(); ++index) {
      const Corner &from = corners[index], &to = corners[(index + 1) % corners.size()];
      if (from.row >= edges[0] && from.row <= edges[1])
        cols.add(from.col);
      for (const double edge : edges)
        if ((from.row - edge) * (to.row - edge) < 0.0)
          cols.add(from.col + (to.col - from.col) * (edge - from.row) / (to.row - from.row));
    }
    const int left = std::max(0, static_cast<int>(std::ceil(cols.least - 0.5)));
    const int right = std::min(grid_.cols - 1, static_cast<int>(std::floor(cols.most + 0.5)));
    if (left <= right && occupied_before(row, right + 1) > occupied_before(row, left))
      return false;
  }
  return true;
}

}  // namespace peers
