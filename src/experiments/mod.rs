//! Closed loops and published results, run without a ROS graph.
