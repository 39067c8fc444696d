//! Control laws: from joint states and base-frame measurements to joint efforts.
