// Pinocchio as a peer of the benchmark. With -DSCALAR="long double" it is the reference for precision.
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/centroidal.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/multibody.hpp>

#include "peer.hpp"

#ifndef SCALAR
#define SCALAR double
#endif

using Scalar = SCALAR;
using Model = pinocchio::ModelTpl<Scalar>;
using Data = pinocchio::DataTpl<Scalar>;
using SE3 = pinocchio::SE3Tpl<Scalar>;
using Inertia = pinocchio::InertiaTpl<Scalar>;
using Symmetric3 = pinocchio::Symmetric3Tpl<Scalar>;
using Vector3 = Eigen::Matrix<Scalar, 3, 1>;
using Matrix3 = Eigen::Matrix<Scalar, 3, 3>;
using VectorX = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
using Matrix6X = Eigen::Matrix<Scalar, 6, Eigen::Dynamic>;
using pinocchio::Convention;

static Vector3 vector(const double *v) { return Vector3(v[0], v[1], v[2]); }

// The joint type made for the axis, where there is one: they are the fastest.
static Model::JointModel joint(const peer::Body &b) {
  using namespace pinocchio;
  const double *a = b.axis;
  if (b.revolute) {
    if (a[0] == 1) return JointModelRevoluteTpl<Scalar, 0, 0>();
    if (a[1] == 1) return JointModelRevoluteTpl<Scalar, 0, 1>();
    if (a[2] == 1) return JointModelRevoluteTpl<Scalar, 0, 2>();
    return JointModelRevoluteUnalignedTpl<Scalar, 0>(vector(a));
  }
  if (a[0] == 1) return JointModelPrismaticTpl<Scalar, 0, 0>();
  if (a[1] == 1) return JointModelPrismaticTpl<Scalar, 0, 1>();
  if (a[2] == 1) return JointModelPrismaticTpl<Scalar, 0, 2>();
  return JointModelPrismaticUnalignedTpl<Scalar, 0>(vector(a));
}

struct State {
  VectorX q, v, efforts;
};

class Program {
 public:
  explicit Program(const peer::Robot &robot) : tip_body_(robot.tip_body), tip_(vector(robot.tip)) {
    for (size_t i = 0; i < robot.bodies.size(); ++i) {
      const peer::Body &b = robot.bodies[i];
      const std::string name = "joint" + std::to_string(i);
      Matrix3 rotation;
      for (int k = 0; k < 9; ++k) rotation(k / 3, k % 3) = b.rotation[k];
      const auto id = i == 0 ? model_.addJoint(0, pinocchio::JointModelFreeFlyerTpl<Scalar>(),
                                               SE3::Identity(), name)
                             : model_.addJoint(b.parent + 1, joint(b),
                                               SE3(rotation, vector(b.position)), name);
      const double *I = b.inertia;
      model_.appendBodyToJoint(
          id, Inertia(b.mass, vector(b.com), Symmetric3(I[0], I[1], I[3], I[2], I[4], I[5])),
          SE3::Identity());
    }
    for (const auto &b : robot.bodies) mass_ += b.mass;
    model_.gravity.setZero();
    data_ = Data(model_);
    jacobian_ = Matrix6X::Zero(6, model_.nv - 6);
    for (auto *x : {&v2_, &v3_, &v4_, &a1_, &a2_, &a3_, &average_}) x->resize(model_.nv);
    stage_.resize(model_.nq);
  }

  void set_states(const std::vector<peer::State> &states) {
    states_.clear();
    for (const auto &s : states) {
      const Eigen::Index n = s.q.size();
      State t{VectorX::Zero(model_.nq), VectorX::Zero(model_.nv), VectorX::Zero(model_.nv)};
      for (int k = 0; k < 4; ++k) t.q[3 + k] = s.attitude[k];
      t.q.template segment<4>(3).normalize();
      t.v.template head<3>() = vector(s.linear);
      t.v.template segment<3>(3) = vector(s.angular);
      for (Eigen::Index j = 0; j < n; ++j) {
        t.q[7 + j] = s.q[j];
        t.v[6 + j] = s.qd[j];
        t.efforts[6 + j] = s.efforts[j];
      }
      states_.push_back(t);
    }
  }

  std::vector<double> ask(const std::string &kernel, size_t state) {
    State s = states_[state];
    std::vector<double> answer;
    const Matrix3 R_WB =
        Eigen::Quaternion<Scalar>(s.q.template segment<4>(3).eval()).toRotationMatrix();
    const auto add = [&](const auto &values) {
      for (Eigen::Index k = 0; k < values.size(); ++k) answer.push_back(double(values(k)));
    };
    if (kernel == "forward_local" || kernel == "forward_world") {
      const VectorX &a = forward(kernel == "forward_local", s.q, s.v, s.efforts);
      // Spatial acceleration to that of the origin as a point.
      const Vector3 v = s.v.template head<3>(), w = s.v.template segment<3>(3);
      add(a.template segment<3>(3).eval());
      add((a.template head<3>() + w.cross(v)).eval());
      add(a.tail(a.size() - 6).eval());
    } else if (kernel == "jacobian") {
      generalized_jacobian(s.q);
      Matrix6X in_base = jacobian_;
      in_base.template topRows<3>() = R_WB.transpose() * jacobian_.template topRows<3>();
      in_base.template bottomRows<3>() = R_WB.transpose() * jacobian_.template bottomRows<3>();
      add(in_base.reshaped().eval());
    } else if (kernel == "rk4_local" || kernel == "rk4_world") {
      step(kernel == "rk4_local", s);
      add(s.q.tail(s.q.size() - 7).eval());
      add(s.v.tail(s.v.size() - 6).eval());
    }
    return answer;
  }

  void call(const std::string &kernel, size_t calls) {
    const bool local = kernel == "forward_local" || kernel == "rk4_local";
    if (kernel == "jacobian") {
      for (size_t i = 0; i < calls; ++i) generalized_jacobian(states_[i % states_.size()].q);
    } else if (kernel == "rk4_local" || kernel == "rk4_world") {
      State s = states_[0];
      for (size_t i = 0; i < calls; ++i) step(local, s);
    } else {
      for (size_t i = 0; i < calls; ++i) {
        const State &s = states_[i % states_.size()];
        forward(local, s.q, s.v, s.efforts);
      }
    }
  }

 private:
  const VectorX &forward(bool local, const VectorX &q, const VectorX &v, const VectorX &efforts) {
    return pinocchio::aba(model_, data_, q, v, efforts,
                          local ? Convention::LOCAL : Convention::WORLD);
  }

  // The joints' columns of the centroidal map give the base's answer at zero momentum: its linear part is
  // that of the centre of mass, its angular part needs the inverse of a 3 x 3 inertia. World axes.
  void generalized_jacobian(const VectorX &q) {
    pinocchio::computeCentroidalMap(model_, data_, q);
    const Vector3 &com = data_.com[0];
    const Matrix3 inverse = data_.oYcrb[0].inertia().matrix().inverse();
    const auto tip_joint = static_cast<pinocchio::JointIndex>(tip_body_ + 1);
    const Vector3 tip = data_.oMi[tip_joint].act(tip_);
    const Vector3 arm = tip - com;
    for (Eigen::Index j = 0; j < jacobian_.cols(); ++j) {
      const auto momentum = data_.Ag.col(6 + j);
      const Vector3 w = -(inverse * momentum.template tail<3>());
      jacobian_.col(j).template head<3>() = w.cross(arm) - momentum.template head<3>() / mass_;
      jacobian_.col(j).template tail<3>() = w;
    }
    for (auto i = tip_joint; i > 1; i = model_.parents[i]) {
      const auto twist = data_.J.col(model_.joints[i].idx_v());
      const Vector3 w = twist.template tail<3>();
      auto column = jacobian_.col(model_.joints[i].idx_v() - 6);
      column.template head<3>() += twist.template head<3>() + w.cross(tip);
      column.template tail<3>() += w;
    }
  }

  // As most write it: stages and the step's mean rate are integrated in the base's axes.
  void step(bool local, State &s) {
    const Scalar h = Scalar(peer::DT);
    a1_ = forward(local, s.q, s.v, s.efforts);
    pinocchio::integrate(model_, s.q, (s.v * (h / 2)).eval(), stage_);
    v2_ = s.v + a1_ * (h / 2);
    a2_ = forward(local, stage_, v2_, s.efforts);
    pinocchio::integrate(model_, s.q, (v2_ * (h / 2)).eval(), stage_);
    v3_ = s.v + a2_ * (h / 2);
    a3_ = forward(local, stage_, v3_, s.efforts);
    pinocchio::integrate(model_, s.q, (v3_ * h).eval(), stage_);
    v4_ = s.v + a3_ * h;
    const VectorX &a4 = forward(local, stage_, v4_, s.efforts);
    average_ = (s.v + 2 * v2_ + 2 * v3_ + v4_) * (h / 6);
    pinocchio::integrate(model_, s.q, average_, stage_);
    s.q.swap(stage_);
    s.v += (a1_ + 2 * a2_ + 2 * a3_ + a4) * (h / 6);
  }

  Model model_;
  Data data_;
  int tip_body_;
  Vector3 tip_;
  Scalar mass_ = 0;
  std::vector<State> states_;
  Matrix6X jacobian_;
  VectorX v2_, v3_, v4_, a1_, a2_, a3_, average_, stage_;
};

int main() { return peer::serve<Program>(); }
