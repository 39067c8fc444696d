//! `fuyu inspect`
