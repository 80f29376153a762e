//! Recorded frames: rosbag2 MCAP bags, image folders and KITTI.
