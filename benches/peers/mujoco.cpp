// MuJoCo as a peer of the benchmark: a free joint, no gravity, no contacts, no constraints.
#include <mujoco/mujoco.h>

#include <cstdlib>
#include <cstring>

#include "peer.hpp"

class Program {
 public:
  explicit Program(const peer::Robot &robot) {
    mjSpec *spec = mj_makeSpec();
    std::vector<mjsBody *> bodies;
    for (const peer::Body &b : robot.bodies) {
      const bool base = bodies.empty();
      mjsBody *body =
          mjs_addBody(base ? mjs_findBody(spec, "world") : bodies[b.parent], nullptr);
      bodies.push_back(body);
      std::memcpy(body->pos, b.position, sizeof body->pos);
      mju_mat2Quat(body->quat, b.rotation);
      body->explicitinertial = 1;
      body->mass = b.mass;
      std::memcpy(body->ipos, b.com, sizeof body->ipos);
      const double *I = b.inertia;  // xx xy xz yy yz zz
      const bool diagonal = I[1] == 0 && I[2] == 0 && I[4] == 0;
      const double principal[3] = {I[0], I[3], I[5]};
      const double full[6] = {I[0], I[3], I[5], I[1], I[2], I[4]};
      if (diagonal) std::memcpy(body->inertia, principal, sizeof principal);
      else std::memcpy(body->fullinertia, full, sizeof full);
      if (base) {
        mjs_addFreeJoint(body);
      } else {
        mjsJoint *joint = mjs_addJoint(body, nullptr);
        joint->type = b.revolute ? mjJNT_HINGE : mjJNT_SLIDE;
        std::memcpy(joint->axis, b.axis, sizeof joint->axis);
      }
    }
    model_ = mj_compile(spec, nullptr);
    if (!model_) {
      std::fprintf(stderr, "MuJoCo: %s\n", mjs_getError(spec));
      std::exit(1);
    }
    mj_deleteSpec(spec);
    mjOption &opt = model_->opt;
    opt.integrator = mjINT_RK4;
    opt.timestep = peer::DT;
    mju_zero(opt.gravity, 3);
    opt.disableflags = mjDSBL_CONSTRAINT | mjDSBL_EQUALITY | mjDSBL_FRICTIONLOSS | mjDSBL_LIMIT |
                       mjDSBL_CONTACT | mjDSBL_SPRING | mjDSBL_DAMPER | mjDSBL_GRAVITY |
                       mjDSBL_WARMSTART | mjDSBL_ACTUATION | mjDSBL_SENSOR | mjDSBL_AUTORESET |
                       mjDSBL_ISLAND;
    data_ = mj_makeData(model_);
  }

  ~Program() {
    mj_deleteData(data_);
    mj_deleteModel(model_);
  }

  void set_states(const std::vector<peer::State> &states) {
    states_.clear();
    for (const auto &s : states) {
      State t{std::vector<double>(model_->nq), std::vector<double>(model_->nv),
              std::vector<double>(model_->nv), {}};
      const double attitude[4] = {s.attitude[3], s.attitude[0], s.attitude[1], s.attitude[2]};
      std::copy(attitude, attitude + 4, &t.qpos[3]);
      mju_normalize4(&t.qpos[3]);
      mju_quat2Mat(t.R_WB, &t.qpos[3]);
      mju_mulMatVec3(&t.qvel[0], t.R_WB, s.linear);
      std::copy(s.angular, s.angular + 3, &t.qvel[3]);
      std::copy(s.q.begin(), s.q.end(), t.qpos.begin() + 7);
      std::copy(s.qd.begin(), s.qd.end(), t.qvel.begin() + 6);
      std::copy(s.efforts.begin(), s.efforts.end(), t.force.begin() + 6);
      states_.push_back(t);
    }
  }

  std::vector<double> ask(const std::string &kernel, size_t state) {
    const State &s = states_[state];
    std::vector<double> answer;
    if (kernel == "forward" || kernel == "forward_parts") {
      call_on(kernel, s);
      const mjtNum *a = kernel == "forward" ? data_->qacc : data_->qacc_smooth;
      mjtNum linear[3];
      mju_mulMatTVec3(linear, s.R_WB, a);
      answer.assign(a + 3, a + 6);
      answer.insert(answer.end(), linear, linear + 3);
      answer.insert(answer.end(), a + 6, a + model_->nv);
    } else if (kernel == "rk4") {
      set(s);
      mj_step(model_, data_);
      answer.assign(data_->qpos + 7, data_->qpos + model_->nq);
      answer.insert(answer.end(), data_->qvel + 6, data_->qvel + model_->nv);
    }
    return answer;
  }

  void call(const std::string &kernel, size_t calls) {
    if (kernel == "rk4") {
      set(states_[0]);
      for (size_t i = 0; i < calls; ++i) mj_step(model_, data_);
    } else {
      for (size_t i = 0; i < calls; ++i) call_on(kernel, states_[i % states_.size()]);
    }
  }

 private:
  struct State {
    std::vector<double> qpos, qvel, force;
    mjtNum R_WB[9];
  };

  void set(const State &s) {
    mju_copy(data_->qpos, s.qpos.data(), model_->nq);
    mju_copy(data_->qvel, s.qvel.data(), model_->nv);
    mju_copy(data_->qfrc_applied, s.force.data(), model_->nv);
  }

  void call_on(const std::string &kernel, const State &s) {
    set(s);
    if (kernel == "forward") {
      mj_forward(model_, data_);
      return;
    }
    // Only what free motion needs of it.
    mj_kinematics(model_, data_);
    mj_comPos(model_, data_);
    mj_makeM(model_, data_);
    mj_factorM(model_, data_);
    mj_comVel(model_, data_);
    mj_rne(model_, data_, 0, data_->qfrc_bias);
    mju_sub(data_->qfrc_smooth, data_->qfrc_applied, data_->qfrc_bias, model_->nv);
    mj_solveM(model_, data_, data_->qacc_smooth, data_->qfrc_smooth, 1);
  }

  mjModel *model_;
  mjData *data_;
  std::vector<State> states_;
};

int main() { return peer::serve<Program>(); }
