//! rosbag2 bags in MCAP: writing, reading, their metadata.
