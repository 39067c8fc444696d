//! Kinematics, momentum, generalized Jacobian and forward dynamics of the free-floating tree.
