// Plans to every goal of a problem with planners of the Open Motion Planning Library.
//
// Reads a problem from standard input (problem.hpp) and prints a line for each planner and goal:
// planner, number of the goal, what became of it (solved, none, overran, crashed), processor and
// elapsed milliseconds, and the poses of the first path that was found, x y yaw each.

#include <cerrno>
#include <chrono>
#include <csignal>
#include <exception>
#include <iostream>
#include <system_error>

#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include "planning.hpp"

namespace peers {
namespace {

// A planner that does not heed its limit is ended at this multiple of it.
constexpr double kOverrun = 1.25;

double millis(const timeval &time) {
  return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_usec) * 1e-3;
}

// Sends this process SIGPROF once it has used so much processor time.
void end_after(double cpu_s) {
  itimerval timer{};
  timer.it_value.tv_sec = static_cast<time_t>(cpu_s);
  timer.it_value.tv_usec =
      static_cast<suseconds_t>((cpu_s - static_cast<double>(timer.it_value.tv_sec)) * 1e6);
  setitimer(ITIMER_PROF, &timer, nullptr);
}

void print(const Answer &answer) {
  std::cout << (answer.path.empty() ? "none " : "solved ") << answer.cpu_ms << ' '
            << answer.elapsed_ms;
  for (const Pose &pose : answer.path)
    std::cout << ' ' << pose.x_m << ' ' << pose.y_m << ' ' << pose.yaw_rad;
  std::cout << std::endl;
}

// Runs in a process of its own: assertions of the library's Dubins space fail now and then, BIT*
// crashes, and RRTConnect may extend its trees to each other for ever.
void print_attempt(const PlannerKind &kind, const Problem &problem, const Footprint &footprint,
                   const Pose &goal) {
  const auto begin = std::chrono::steady_clock::now();
  std::cout.flush();
  const pid_t child = fork();
  if (child < 0)
    throw std::system_error(errno, std::generic_category(), "fork");
  if (child == 0) {
    end_after(problem.limit_s * kOverrun);
    print(plan(kind, problem, footprint, goal));
    _exit(0);
  }
  int status = 0;
  rusage usage{};
  if (wait4(child, &status, 0, &usage) < 0)
    throw std::system_error(errno, std::generic_category(), "wait4");
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
    return;
  const bool overran = WIFSIGNALED(status) && WTERMSIG(status) == SIGPROF;
  const std::chrono::duration<double, std::milli> elapsed =
      std::chrono::steady_clock::now() - begin;
  std::cout << (overran ? "overran " : "crashed ")
            << millis(usage.ru_utime) + millis(usage.ru_stime) << ' ' << elapsed.count() << '\n';
}

}  // namespace
}  // namespace peers

int main() try {
  const peers::Problem problem = peers::read_problem(std::cin);
  const peers::Footprint footprint(problem.grid, problem.vehicle);
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  ompl::RNG::setSeed(1);
  std::cout.precision(12);
  for (const peers::PlannerKind &kind : peers::planner_kinds())
    for (std::size_t goal = 0; goal < problem.goals.size(); ++goal) {
      std::cout << kind.name << ' ' << goal << ' ';
      peers::print_attempt(kind, problem, footprint, problem.goals[goal]);
    }
} catch (const std::exception &error) {
  std::cerr << error.what() << '\n';
  return 1;
}
