// What every peer speaks: lines on stdin and stdout, as benches/peers/peer.rs sends them.
//
//   model BODIES            then a line for each body, base first:
//                             parent revolute|prismatic rotation(9, by rows) position(3) axis(3)
//                             mass com(3) inertia about com(xx xy xz yy yz zz)
//                           and a line with the body that carries the tip and the tip's position(3)
//   states COUNT            then a line for each: base attitude(x y z w), base twist(angular, linear; base
//                             axes), q(n), qd(n), efforts(n)
//   ask KERNEL STATE        answers with numbers
//   time KERNEL CALLS       answers with the nanoseconds that a call takes
//
// "ask" of a kernel that the peer does not have answers with an empty line.
#pragma once
#include <chrono>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

namespace peer {

struct Body {
  int parent;
  bool revolute;
  double rotation[9], position[3], axis[3], mass, com[3], inertia[6];
};

struct Robot {
  std::vector<Body> bodies;
  int tip_body;
  double tip[3];
};

struct State {
  double attitude[4], angular[3], linear[3];
  std::vector<double> q, qd, efforts;
};

template <class Range>
void read(Range &&values) {
  for (auto &value : values) std::cin >> value;
}

inline Robot read_robot() {
  size_t count;
  std::cin >> count;
  Robot robot{std::vector<Body>(count), 0, {}};
  for (Body &b : robot.bodies) {
    std::string kind;
    std::cin >> b.parent >> kind;
    b.revolute = kind == "revolute";
    read(b.rotation), read(b.position), read(b.axis);
    std::cin >> b.mass;
    read(b.com), read(b.inertia);
  }
  std::cin >> robot.tip_body;
  read(robot.tip);
  return robot;
}

inline std::vector<State> read_states(size_t n) {
  size_t count;
  std::cin >> count;
  std::vector<State> states(count);
  for (State &s : states) {
    read(s.attitude), read(s.angular), read(s.linear);
    for (auto *values : {&s.q, &s.qd, &s.efforts}) {
      values->resize(n);
      read(*values);
    }
  }
  return states;
}

// Step of the Runge-Kutta kernels [s].
constexpr double DT = 1e-3;

// `Program` is made of a Robot and has set_states(states), ask(kernel, state) -> numbers, and
// call(kernel, calls), which makes the calls on one state after the other.
template <class Program>
int serve() {
  std::ios::sync_with_stdio(false);
  Program *program = nullptr;
  size_t joints = 0;
  for (std::string command; std::cin >> command;) {
    if (command == "model") {
      Robot robot = read_robot();
      joints = robot.bodies.size() - 1;
      delete program;
      program = new Program(robot);
    } else if (command == "states") {
      program->set_states(read_states(joints));
    } else if (command == "ask") {
      std::string kernel;
      size_t state;
      std::cin >> kernel >> state;
      for (double value : program->ask(kernel, state)) std::printf("%.17g ", value);
    } else if (command == "time") {
      std::string kernel;
      size_t calls;
      std::cin >> kernel >> calls;
      auto start = std::chrono::steady_clock::now();
      program->call(kernel, calls);
      std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - start;
      std::printf("%.17g", took.count() / calls);
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  delete program;
  return 0;
}

}  // namespace peer
